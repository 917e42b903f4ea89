model Distillation "Binary distillation in seven plates with reflux drum and reboiler at constant holdups"

# The system distillation_column of pc-gym (M. Bloor et al., arXiv:2410.22093), with its parameters; constant distillate and
# relative volatility, saturated liquid feed.
#
# Task: keep the purity of the distillate by reflux ratio and feed while the composition of the feed varies.
#
# Checked: the balance F z = D x_D + W x_B at rest; trajectories of SciPy.

time t : h

param D     : kmol/h = 100     "distillate"
param q              = 1       "liquid share of the feed"
param alpha          = 5       "relative volatility"
param M_0   : kmol   = 2000    "holdup of the reflux drum"
param M     : kmol   = 2000    "holdup of a plate"
param M_b   : kmol   = 2000    "holdup of the reboiler"
set trays = 0..8    # 0: reflux drum, 4: feed plate, 8: reboiler

action R          = 4    in 1..10        "reflux ratio"
action F : kmol/h = 500  in 300..1000    "feed"

state x[i in trays] = 0.3 in 0..1    "light component in the liquid"

disturbance z = 0.2 ~ 0.2 + 0.95*(z - 0.2) + normal(0, 0.002) clip bounds in 0.15..0.25    "light component in the feed"

let y[i in trays]          = alpha*x[i]/(1 + (alpha - 1)*x[i])
let L             : kmol/h = R*D              "liquid above the feed"
let V             : kmol/h = (R + 1)*D        "vapour above the feed"
let L_s           : kmol/h = L + q*F          "liquid below the feed"
let V_s           : kmol/h = V - (1 - q)*F    "vapour below the feed"
let W             : kmol/h = F - D            "bottoms"

eq M_0 * d/dt x[0] = V*(y[1] - x[0])
eq M * d/dt x[i]   = L*(x[i-1] - x[i]) + V*(y[i+1] - y[i])        for i in 1..3
eq M * d/dt x[4]   = L*x[3] - L_s*x[4] + V_s*y[5] - V*y[4] + F*z
eq M * d/dt x[i]   = L_s*(x[i-1] - x[i]) + V_s*(y[i+1] - y[i])    for i in 5..7
eq M_b * d/dt x[8] = L_s*x[7] - W*x[8] - V_s*y[8]

steady { R = 4, F = 500 }
initial x[i] = value(steady(x[i]))    for i in trays

observe x_D = x[0] in 0..1, x_B = x[8] in 0..1, z in 0..1
level online "analyser of the distillate, two steps late" { observe x_D = x[0] in 0..1 delay 2 noise normal(0, 0.001) }

reward purity default = -sq((x[0] - steady(x[0]))/0.01) - 0.1*sq((F - nominal(F))/50 [kmol/h])
    "deviations of the distillate and of the production"
constraint impure when x[0] < 0.8
fail off_specification when x[0] < 0.5
episode { step = 1 [h], max_steps = 200, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/distillation.eq`, against balances ----

test "the products contain the feed" {
  start steady
  expect 100*x[0] + 400*x[8] within 1e-8 of 500*0.2
}
