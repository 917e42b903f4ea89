model Bioreactor "Continuous fermenter with inhibition by substrate and product"

# M. A. Henson, D. E. Seborg, Nonlinear control strategies for continuous fermenters, Chemical Engineering Science 47 (1992)
# 821-835; P. Agrawal, H. C. Lim, Analyses of various control schemes for continuous bioreactors, Advances in Biochemical
# Engineering 30 (1984) 61-90.
#
# Task: keep the biomass by the dilution rate while yield and feed vary; too fast a dilution washes the cells out.
#
# Checked: the published steady state X = 6.0, S = 5.0, P = 19.14 g/L at D = 0.202 1/h; trajectories of SciPy.

time t : h

param mu_m  : 1/h = 0.48    "largest growth rate"
param K_m   : g/L = 1.2     "half-saturation"
param K_i   : g/L = 22      "inhibition by substrate (Haldane)"
param P_m   : g/L = 50      "product that stops growth"
param alpha       = 2.2     "product by growth"
param beta  : 1/h = 0.2     "product by biomass"
param Y_0         = 0.4     "mean yield of biomass"

action D : 1/h = 0.202 in 0.05..0.45    "dilution rate"

state X : g/L = 6      in 0..20    "biomass"
state S : g/L = 5      in 0..40    "substrate"
state P : g/L = 19.14  in 0..50    "product"

disturbance S_f : g/L = 20 ~ 20 [g/L] + 0.98*(S_f - 20 [g/L]) + 0.1 [g/L]*normal(0, 1) clip bounds  in 17..23         "substrate in the feed"
disturbance dY        = 0  ~ 0.98*dY + normal(0, 0.002) clip bounds                                 in -0.05..0.05    "deviation of the yield"
disturbance dr  : g/L = 0  ~ if mod(n, 100) == 0 and n > 0 then 0.5 [g/L]*uniform(-1, 0.4) else dr  in -1..1          "change of the set-point"

let Y  : 1   = Y_0 + dY                                      "yield of biomass"
let mu : 1/h = mu_m*(1 - P/P_m)*S / (K_m + S + sq(S)/K_i)    "growth rate"
let r  : g/L = steady(X) + dr                                "set-point"

eq d/dt X = (mu - D)*X
eq d/dt S = D*(S_f - S) - mu*X/Y
eq d/dt P = (alpha*mu + beta)*X - D*P

steady { D = 0.202 }
initial x = value(steady(x))    for x in states

observe X, S, P, e : g/L = r - X in -20..20
level online "turbidity, and substrate every ten steps, four steps late" {
  observe X noise normal(0, 0.05), S every 10 delay 4 noise normal(0, 0.1), r in 0..20
}

reward biomass default = -sq((r - X)/0.2 [g/L])     "squared deviation from the set-point"
reward productivity    = integral(D*P)/(1 [g/L])    "product that leaves"
constraint unused when S > 8 [g/L]
fail washout when X < 0.5 [g/L]
episode { step = 0.5 [h], max_steps = 400, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/bioreactor.eq`, against Henson and Seborg 1992 ----

test "the published operating point" {
  start steady
  expect X within 0.05 of 6.0
  expect S within 0.05 of 5.0
  expect P within 0.02 of 19.14
}
test "a dilution above the growth rate washes the cells out" {
  start nominal
  D = 0.4 for 200 [h]
  expect failure washout
}
