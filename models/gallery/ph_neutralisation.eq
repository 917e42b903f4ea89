model PHNeutralisation "Neutralisation of acid by base in a stirred tank with buffer; level and pH"

# M. A. Henson, D. E. Seborg, Adaptive nonlinear control of a pH neutralization process, IEEE Transactions on Control Systems
# Technology 2 (1994) 169-182. Reaction invariants of nitric acid, sodium hydroxide and sodium bicarbonate.
#
# Task: keep the pH at 7 and the level at 14 cm by base and acid while the buffer flow, which is not measured, varies.
#
# Checked: the published operating point, pH 7.0, level 14.0 cm, W_a = -4.32e-4 M, W_b = 5.28e-4 M (the printed flows give
# pH 7.03 and -4.36e-4 M); the printed invariants have pH 7.0; trajectories of SciPy with a root finder for the pH.

time t : s

param A    : cm^2          = 207         "cross-section of the tank"
param C_v  : mL/(s cm^0.5) = 8.75        "constant of the outlet valve"
param pK_1                 = 6.35        "first dissociation constant of carbonic acid"
param pK_2                 = 10.25       "second dissociation constant of carbonic acid"
param W_a1 : M             = 3e-3        "charge of the acid"
param W_a2 : M             = -3e-2       "charge of the buffer"
param W_a3 : M             = -3.05e-3    "charge of the base"
param W_b1 : M             = 0           "carbonate in the acid"
param W_b2 : M             = 3e-2        "carbonate in the buffer"
param W_b3 : M             = 5e-5        "carbonate in the base"
param q_20 : mL/s          = 0.55        "mean flow of the buffer"

action q_3 : mL/s = 15.6  in 0..30    "flow of the base"
action q_1 : mL/s = 16.6  in 0..30    "flow of the acid"

state W_a : mM = -0.432  in -5..5      "charge of the liquid"
state W_b : mM = 0.528   in 0..30      "carbonate in the liquid"
state h   : cm = 14      in 0.1..40    "level"
var   pH = 7 in 0..14    "acidity"

disturbance dq_2 : mL/s = 0 ~ 0.95*dq_2 + 0.04 [mL/s]*normal(0, 1) clip bounds in -0.5..1    "deviation of the buffer flow"
let q_2 : mL/s = q_20 + dq_2    "flow of the buffer"
let q_4 : mL/s = C_v*sqrt(h)    "outflow"

eq A*h * d/dt W_a = q_1*(W_a1 - W_a) + q_2*(W_a2 - W_a) + q_3*(W_a3 - W_a)
eq A*h * d/dt W_b = q_1*(W_b1 - W_b) + q_2*(W_b2 - W_b) + q_3*(W_b3 - W_b)
eq A * d/dt h     = q_1 + q_2 + q_3 - q_4
eq 0 [M]          = W_a + (10^(pH - 14) - 10^(-pH))*1 [M] + W_b*(1 + 2*10^(pH - pK_2))/(1 + 10^(pK_1 - pH) + 10^(pH - pK_2))

steady { q_1 = 16.6, q_3 = 15.6 }
initial x = value(steady(x))    for x in states

observe pH in 0..14, h
level online "electrode, half a minute late, and level gauge" {
  observe pH in 0..14 delay 2 noise normal(0, 0.02), h noise normal(0, 0.05)
}

reward neutral default = -sq(pH - 7) - sq((h - 14 [cm])/5 [cm])    "squared deviations of pH and level"
constraint acid when pH < 6
constraint alkaline when pH > 8
fail state_box when outside bounds(W_a, W_b, h)
episode { step = 15 [s], max_steps = 200, error_reward = -1000 }
solver  { rtol = 1e-9 }

# ---- Tests: `smpl test models/gallery/ph_neutralisation.eq`, against Henson and Seborg 1994 ----

test "the published operating point" {
  start steady
  expect pH within 0.05 of 7.0
  expect h within 0.05 of 14.0
}
