model Extraction "Multistage extraction: five stages of liquid and gas in counter-current"

# The system multistage_extraction of pc-gym (M. Bloor et al., arXiv:2410.22093), with its parameters; J. Ingham et al.,
# Chemical Engineering Dynamics (Wiley-VCH), example on extraction with a nonlinear equilibrium.
#
# Task: keep the solute in the leaving liquid at a set-point that changes every 30 steps, by the flows of both phases, while
# the feed varies.
#
# Checked: what the liquid loses the gas takes up, at rest; trajectories of SciPy.

time t : h

param V_l    : m^3    = 5                  "liquid of a stage"
param V_g    : m^3    = 5                  "gas of a stage"
param m      : kg/m^3 = 1                  "constant of the equilibrium X = Y^2/m"
param Kla    : 1/h    = 5                  "transfer coefficient"
param change : kg/m^3 = 0.05  in 0..0.1    "largest deviation of the set-point"
set stages = 1..5

action L : m^3/h = 50   in 5..500      "flow of the liquid"
action G : m^3/h = 100  in 10..1000    "flow of the gas"

state X[i in stages] : kg/m^3 = 0.4  in 0..2    "solute in the liquid"
state Y[i in stages] : kg/m^3 = 0.3  in 0..2    "solute in the gas"

disturbance X_0 : kg/m^3 = 0.6  ~ 0.6 [kg/m^3] + 0.9*(X_0 - 0.6 [kg/m^3]) + 0.01 [kg/m^3]*normal(0, 1) clip bounds  in 0.4..0.8    "solute in the feed of liquid"
disturbance Y_6 : kg/m^3 = 0.05 ~ 0.05 [kg/m^3] + 0.9*(Y_6 - 0.05 [kg/m^3]) + 0.002 [kg/m^3]*normal(0, 1) clip bounds  in 0..0.1    "solute in the feed of gas"
disturbance dr  : kg/m^3 = 0    ~ if mod(n, 30) == 0 and n > 0 then change*uniform(-1, 1) else dr  in -0.1..0.1    "change of the set-point"

let Q[i in stages] : kg/h = Kla*V_l*(X[i] - sq(Y[i])/m)    "transfer to the gas"
let r : kg/m^3 = steady(X[5]) + dr    "set-point of the leaving liquid"

eq V_l * d/dt X[i] = L*((if i == 1 then X_0 else X[i-1]) - X[i]) - Q[i]    for i in stages
eq V_g * d/dt Y[i] = G*((if i == 5 then Y_6 else Y[i+1]) - Y[i]) + Q[i]    for i in stages

steady { L = 50, G = 100 }
initial x = value(steady(x))    for x in states

observe X[5], Y[1], X_0 in 0..1, e : kg/m^3 = r - X[5] in -2..2
level online "analysis of the leaving liquid" { observe X[5] noise normal(0, 0.003), r in 0..1 }

reward tracking default = -sq((r - X[5])/0.02 [kg/m^3]) - 0.01*sq((G - nominal(G))/100 [m^3/h])
    "deviation from the set-point, and use of gas"
constraint lost when X[5] > 0.5 [kg/m^3]
fail state_box when outside bounds(X, Y)
episode { step = 0.1 [h], max_steps = 120, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/extraction.eq`, against balances ----

test "what leaves the feed is in the solvent" {
  start steady
  expect 50*(0.6 [kg/m^3] - X[5]) within 1e-8 of 100*(Y[1] - 0.05 [kg/m^3])
}
