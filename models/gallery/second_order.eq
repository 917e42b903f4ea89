model SecondOrder "Second-order system with a bounded input, for control by switching"

# The system nonsmooth_control of pc-gym (M. Bloor et al., arXiv:2410.22093), with its matrices: eigenvalues -1 and -2.
#
# Task: bring the position to a set-point that changes every 30 steps; the input is between -1 and 1.
#
# Checked: the step response (1 - exp(-t))^2/2; trajectories of SciPy.

time t : min

param a_21   : 1/min^2 = -2                "stiffness, negative"
param a_22   : 1/min   = -3                "damping, negative"
param change           = 0.4  in 0..0.5    "largest deviation of the set-point"

action u : 1/min^2 = 0 in -1..1    "input"

state x_1         = 0  in -5..5    "position"
state x_2 : 1/min = 0  in -5..5    "velocity"

disturbance d : 1/min^2 = 0 ~ 0.9*d + 0.02 [1/min^2]*normal(0, 1) clip bounds                 in -0.5..0.5    "disturbance of the input"
disturbance r           = 0 ~ if mod(n, 30) == 0 and n > 0 then change*uniform(-1, 1) else r  in -1..1        "set-point"

eq d/dt x_1 = x_2
eq d/dt x_2 = a_21*x_1 + a_22*x_2 + u + d

steady { u = 0 }
initial x = value(steady(x))    for x in states

observe x_1, x_2, e = r - x_1 in -6..6
level online "the position with noise" { observe x_1 noise normal(0, 0.005), r in -1..1 }

reward tracking default = -sq((r - x_1)/0.1)    "squared deviation from the set-point"
constraint fast when abs(x_2) > 1 [1/min]
fail state_box when outside bounds(x_1, x_2)
episode { step = 0.1 [min], max_steps = 120, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/second_order.eq`, against the closed form ----

test "the step response is half a squared exponential" {
  start nominal
  x_1 = 0
  x_2 = 0
  d = 0
  u = 1
  for 1 [min]
  expect x_1 within 1e-6 of 0.5*sq(1 - exp(-1))
}
