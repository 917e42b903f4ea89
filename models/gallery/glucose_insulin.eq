model GlucoseInsulin "Minimal model of glucose and insulin: a diabetic patient with meals and an insulin pump"

# R. N. Bergman, L. S. Phillips, C. Cobelli, Physiologic evaluation of factors controlling glucose tolerance in man, Journal of
# Clinical Investigation 68 (1981) 1456-1467; meals and numbers as in M. E. Fisher, A semiclosed-loop algorithm for the control of
# blood glucose levels in diabetics, IEEE Transactions on Biomedical Engineering 38 (1991) 57-61, and S. M. Lynch, B. W. Bequette,
# Model predictive control of blood glucose in type I diabetics using subcutaneous glucose measurements, ACC 2002.
#
# Task: keep the glucose near 4.5 mmol/L by the insulin pump in spite of a meal every six hours, of random size. Too much insulin is
# worse than too little.
#
# Checked: the basal infusion of 16.667 mU/min (1 unit/h) holds glucose and insulin; trajectories of SciPy.

time t : min

param p_1      : 1/min          = 0.028735             "uptake of glucose without insulin"
param p_2      : 1/min          = 0.028344             "decay of the action of insulin"
param p_3      : L/(unit min^2) = 5.035e-2             "action of insulin"
param k        : 1/min          = 5/54                 "decay of insulin"
param V_1      : L              = 12                   "volume of distribution of insulin"
param G_b      : mmol/L         = 4.5                  "basal glucose"
param I_b      : unit/L         = 0.015                "basal insulin"
param meal     : mmol/(L min)   = 0.4       in 0..1    "largest rate at which a meal appears"
param emptying                  = 0.78      in 0..1    "share of the rate that remains after a step, exp(-0.05 [1/min]*step)"

action U : unit/h = 1 in 0..8    "infusion of insulin"

state G : mmol/L = 4.5    in 0.5..30                   "glucose"
state X : 1/min  = 0      in -0.05..0.5  scale 1e-2    "action of insulin beyond the basal one"
state I : unit/L = 0.015  in 0..1        scale 1e-2    "insulin"

disturbance D : mmol/(L min) = 0 ~ emptying*D + (if mod(n, 72) == 12 then meal*uniform(0.3, 1) else 0) in 0..2    "glucose from meals"

eq d/dt G = -p_1*(G - G_b) - X*G + D
eq d/dt X = -p_2*X + p_3*(I - I_b)
eq d/dt I = -k*I + U/V_1

steady { U = 1 }
initial x = value(steady(x))    for x in states

observe G, X, I
level online "a sensor under the skin: two steps late, with noise" { observe G delay 2 noise normal(0, 0.15) }

reward control default = -sq((G - G_b)/1 [mmol/L]) - (if G < 4 [mmol/L] then 20*sq((4 [mmol/L] - G)/1 [mmol/L]) else 0)
    "deviation of the glucose, low values weigh more"
constraint hypo when G < 4 [mmol/L]
constraint hyper when G > 10 [mmol/L]
fail coma when G < 1.5 [mmol/L]
episode { step = 5 [min], max_steps = 288, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/glucose_insulin.eq`, against Bergman 1981 ----

test "the basal infusion holds the patient" {
  start steady
  expect G within 1e-3 of 4.5
  expect I within 1e-6 of 0.015
}
