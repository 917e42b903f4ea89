model Tank "a tank that drains, 20 °C"
time t : min

param  A : m^2       = 0.5               "cross-section"
param  k : m^2.5/min = 0.1               "valve constant"
action q : m^3/min   = 0.1 in 0..0.3     "inflow"
state  h : m         = 1   in 0..2       "level 😀²"
let    out           = k*sqrt(h)

eq d/dt h = (q - out) / A

initial h ~ uniform(0.5, 1.5)
observe h
reward setpoint default = -sq((h - 1 [m]) / 1 [m])
fail   overflow when outside bounds(h)
episode { step = 1 [min], max_steps = 50, error_reward = -100 }
