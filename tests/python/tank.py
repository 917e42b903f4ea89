"""A tank whose level of 1 m is the steady state of its nominal inflow: a model outside the package."""

TANK = """
model Tank
action q : m^3/s = 0.2 in 0..0.5
state h : m = 1 in 0..4
eq d/dt h = (q - 0.2 [m^2.5/s]*sqrt(h)) / (1 [m^2])
observe h
reward level default = -sq((h - 1 [m]) / 1 [m])
reward height = h / 1 [m]
policy full { q = 0.4 }
episode { step = 1 [s], max_steps = 6 }
"""
# Its episodes begin at a level that is drawn.
DRAWN = TANK.replace("= 1 in", "= 1 ~ uniform(0.5, 1.5) in")
