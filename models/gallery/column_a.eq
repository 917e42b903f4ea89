model ColumnA "Binary distillation column: forty theoretical stages and a total condenser, reflux and boilup as actions"

# Column A: S. Skogestad, I. Postlethwaite, Multivariable Feedback Control (Wiley 1996), section 12.4; S. Skogestad, Dynamics and
# control of distillation columns: a tutorial introduction, Trans IChemE 75 A (1997) 539-562. Stage 1 is the reboiler, stage N the
# condenser. Relative volatility and molar flows are constant, the liquid has linear hydraulics, the vapour no holdup. Reflux and
# boilup are free (LV configuration); distillate and bottoms hold the levels.
#
# Task: keep both products at 99 % while flow and composition of the feed vary. The gain matrix is ill-conditioned.
#
# Checked: x_D = 0.99 and x_B = 0.01 at the nominal point; steady-state gains 0.8754, -0.8618, 1.0846, -1.0982; dominant time
# constant 194 min; trajectories of SciPy.

time t : min
param N                = 41         "number of stages"
param n_F              = 21         "feed stage"
param alpha            = 1.5        "relative volatility"
param tau_L : min      = 0.063      "time constant of the liquid flow"
param M_0   : kmol     = 0.5        "nominal holdup of each stage"
param L_0   : kmol/min = 2.70629    "nominal reflux"
param F_0   : kmol/min = 1          "nominal feed, boiling liquid"
param D_0   : kmol/min = 0.5        "nominal distillate and bottoms"
param K_c   : 1/min    = 10         "gain of the level controllers"
set trays = 1..N

action L : kmol/min = 2.70629  in 2..3.5    "reflux"
action V : kmol/min = 3.20629  in 2.5..4    "boilup"

state x[i in trays]        = 0.5  in 0..1    "light component in the liquid"
state M[i in trays] : kmol = 0.5  in 0..5    "holdup"

disturbance F   : kmol/min = 1   ~ F_0 + 0.9*(F - F_0) + 0.02 [kmol/min]*normal(0, 1) clip bounds  in 0.8..1.2    "feed"
disturbance z_F            = 0.5 ~ 0.5 + 0.9*(z_F - 0.5) + normal(0, 0.01) clip bounds             in 0.4..0.6    "light component in the feed"

let y[i in trays]            = alpha*x[i] / (1 + (alpha - 1)*x[i])
let D             : kmol/min = D_0 + K_c*(M[N] - M_0)    "distillate"
let B             : kmol/min = D_0 + K_c*(M[1] - M_0)    "bottoms"
# Liquid that leaves a stage and vapour that rises from below: liquid feed does not change the vapour.
let L_[i in trays]     : kmol/min = if i == N then L else if i == 1 then B else (if i <= n_F then L_0 + F_0 else L_0) + (M[i] - M_0)/tau_L
let fed[i in trays]    : kmol/min = if i == n_F then F else 0 [kmol/min]
let out[i in trays]    : kmol/min = if i == N then D else V
let up[i in trays]     : kmol/min = if i == 1 then 0 [kmol/min] else V
let down[i in trays]   : kmol/min = if i == N then 0 [kmol/min] else L_[i+1]
let y_out[i in trays]             = if i == N then x[N] else y[i]
let x_down[i in trays]            = if i == N then 0 else x[i+1]
let y_up[i in trays]              = if i == 1 then 0 else y[i-1]

eq d/dt M[i]        = down[i] - L_[i] + up[i] - out[i] + fed[i]    for i in trays
eq M[i] * d/dt x[i] = down[i]*(x_down[i] - x[i]) + up[i]*(y_up[i] - x[i]) - out[i]*(y_out[i] - x[i]) + fed[i]*(z_F - x[i])    for i in trays

invariant light = sum(M[i]*x[i] for i in trays) rate F*z_F - D*x[N] - B*x[1]    "light component"

steady { L = 2.70629, V = 3.20629 }
initial s = value(steady(s))    for s in states

observe x_D = x[N] in 0..1, x_B = x[1] in 0..1, F in 0.5..1.5, D in 0..2, B in 0..2
level online "analysers with noise, a step late; flows" {
  observe x_D = x[N] in 0..1 delay 1 noise normal(0, 0.0005), x_B = x[1] in 0..1 delay 1 noise normal(0, 0.0005)
  observe F in 0.5..1.5 noise normal(0, 0.01), D in 0..2 noise normal(0, 0.01), B in 0..2 noise normal(0, 0.01)
}

reward purity default = -sq((x[N] - 0.99)/0.01) - sq((x[1] - 0.01)/0.01)    "squared deviations of both products, in per cent"
constraint top when x[N] < 0.98
constraint bottom when x[1] > 0.02
fail off_specification when x[N] < 0.9 or x[1] > 0.1
fail holdup when outside bounds(M)
episode { step = 1 [min], max_steps = 600, error_reward = -1000 }
solver  { rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/column_a.eq`, against Skogestad 1997 ----

test "the published products" {
  start steady
  expect x[N] within 1e-6 of 0.99
  expect x[1] within 1e-6 of 0.01
}
