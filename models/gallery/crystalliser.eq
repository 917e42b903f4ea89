model Crystalliser "Continuous crystalliser (MSMPR): four moments and the solute, with a limit cycle"

# T. Chiu, P. D. Christofides, Nonlinear control of particulate processes, AIChE Journal 45 (1999) 1279-1297; D. Shi, N. H. El-Farra,
# M. Li, P. Mhaskar, P. D. Christofides, Predictive control of particle size distribution in particulate processes, Chemical
# Engineering Science 61 (2006) 268-281. Moments and solute are dimensionless, time counts residence times.
#
# Task: hold the unstable steady state by the solute in the feed; left alone the crystalliser oscillates.
#
# Checked: the published steady state x_0 = 0.0471, x_1 = 0.0283, x_2 = 0.0169, x_3 = 0.0102, y = 0.5996, which is unstable;
# trajectories of SciPy.

time t : h
param tau   : h = 1      "residence time"
param F         = 3      "nucleation: exponent"
param alpha     = 40     "density of crystals over the range of the solute"
param Da        = 200    "nucleation: rate times residence time"

action u = 0 in -0.5..0.5    "solute in the feed, deviation"

state x_0 = 0.0471  in 0..1    "number of crystals"
state x_1 = 0.0283  in 0..1    "their length"
state x_2 = 0.0169  in 0..1    "their area"
state x_3 = 0.0102  in 0..1    "their volume"
state y   = 0.5996  in 0..2    "solute, supersaturation"

disturbance d = 0 ~ 0.8*d + normal(0, 0.003) clip bounds in -0.1..0.1    "deviation of the feed"

eq tau * d/dt x_0 = -x_0 + (1 - x_3)*Da*exp(-F/sq(y))
eq tau * d/dt x_1 = -x_1 + y*x_0
eq tau * d/dt x_2 = -x_2 + y*x_1
eq tau * d/dt x_3 = -x_3 + y*x_2
eq tau * d/dt y   = (1 - y - (alpha - y)*y*x_2 + u + d) / (1 - x_3)

steady { u = 0 }
initial x = value(steady(x))    for x in states

observe x_0, x_1, x_2, x_3, y
level online "solute and number of crystals with noise" { observe y noise normal(0, 0.002), x_0 noise normal(0, 0.0005) }

reward hold default = -sq((x_1 - steady(x_1))/0.005) - sq((y - steady(y))/0.02) - sq(u/0.2)
    "deviations of length and solute, and use of the feed"
constraint many when x_0 > 0.07
fail state_box when outside bounds(x_0, x_1, x_2, x_3, y)
episode { step = 0.1 [h], max_steps = 300, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/crystalliser.eq`, against Chiu and Christofides 1999 ----

test "the published steady state, about which the crystals oscillate without control" {
  start steady
  expect x_0 within 6e-5 of 0.0471
  expect x_3 within 6e-5 of 0.0102
  expect y within 6e-5 of 0.5996
}
