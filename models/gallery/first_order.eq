model FirstOrder "First-order system: one state that follows its input"

# The system first_order_system of pc-gym (M. Bloor et al., arXiv:2410.22093), with its gain and time constant.
#
# Task: follow a set-point that changes every 20 steps while a disturbance acts on the input.
#
# Checked: the step response is 1 - exp(-t/tau).

time t : min

param K            = 1               "gain"
param tau    : min = 0.5             "time constant"
param change       = 1    in 0..2    "largest deviation of the set-point"

action u = 0 in -5..5    "input"
state  x = 0 in -10..10    "output"

disturbance d = 0 ~ 0.9*d + normal(0, 0.05) clip bounds                             in -1..1    "disturbance of the input"
disturbance r = 0 ~ if mod(n, 20) == 0 and n > 0 then change*uniform(-1, 1) else r  in -2..2    "set-point"

eq tau * d/dt x = K*(u + d) - x

steady { u = 0 }
initial x = value(steady(x))

observe x, e = r - x in -12..12
level online "the output with noise" { observe x noise normal(0, 0.02), r in -2..2 }

reward tracking default = -sq(r - x)    "squared deviation from the set-point"
constraint input_high when abs(u) > 3
fail state_box when outside bounds(x)
episode { step = 0.1 [min], max_steps = 100, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/first_order.eq`, against the closed form ----

test "the step response is an exponential" {
  start nominal
  x = 0
  d = 0
  u = 2
  for 1 [min]
  expect x within 1e-6 of 2*(1 - exp(-2))
}
