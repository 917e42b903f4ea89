model NAME "A heated tank with an outlet: keep level and temperature where they should be"

# This file is a whole model. Change it, then try:
#
#   smpl check FILE                                        # names, units, structure
#   smpl simulate FILE --plot run.svg                      # one episode, drawn
#   smpl simulate FILE --policy random --episodes 20       # many
#   smpl steady FILE --action heat=21                      # where it comes to rest
#
# A `#` begins a comment. The order of the statements does not matter.

# The independent variable and its unit: every rate of change is per minute.
time t : min

# Parameters are constant over an episode: name : unit = value in bounds "text".
param A     : m^2        = 0.8               "cross-section of the tank"
param k_out : m^2.5/min  = 0.05              "outflow over the root of the level"
param T_in  : degC       = 20                "temperature of the feed"
param rho_c : kJ/(m^3 K) = 4180              "heat capacity of the liquid by volume"
param UA    : kW/K       = 0.5   in 0..10    "heat loss over the difference to the air"
param T_air : degC       = 15                "temperature around the tank"

# A distribution draws the value anew for every episode.
param T_set : degC = 40 ~ uniform(35, 45) in 20..60    "wished temperature"

# Actions are held over a step: nominal value and bounds. Units convert by themselves: here L/min and kW, above m^3 and kJ.
action q_in : L/min = 50  in 0..200    "feed"
action heat : kW    = 80  in 0..200    "heating"

# States have a rate of change. Bounds are used by `fail` below and to scale observations.
state h : m    = 1   in 0.05..2    "level"
state T : degC = 25  in 0..95      "temperature"

# Named expressions; one with a unit is an output of the model.
let q_out : L/min = k_out * sqrt(h)     "outflow"
let loss  : kW    = UA * (T - T_air)    "loss of heat"

# The balances of volume and heat. `smpl check` refuses an equation whose sides have different dimensions.
eq d/dt h = (q_in - q_out) / A
eq d/dt T = q_in / (A * h) * (T_in - T) + (heat - loss) / (rho_c * A * h)

# Where the episode begins.
initial h ~ uniform(0.8, 1.2)

# What the controller sees, and what it is paid for.
observe h, T noise normal(0, 0.1), T_set in 20..60

reward tracking default = -sq((T - T_set) / 10 [K]) - sq((h - 1 [m]) / 0.5 [m])    "distance of temperature and level to where they should be"

# What ends an episode: a state outside of its bounds.
fail state_box when outside bounds(h, T)

# A policy is a rule that needs no learning: here a proportional controller.
policy hand {
  q_in = 50 - 60*(value(h) - 1)
  heat = clip(80 + 15*(value(T_set) - value(T)), 0, 200)
}

# A step of a minute, 120 of them.
episode { step = 1 [min], max_steps = 120 }
