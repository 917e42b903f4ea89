model VanDerPol "Van der Pol's oscillator, stiff"

# Test Set for Initial Value Problem Solvers, release 2.4, problem VDPOL: epsilon = 1e-6, reference values at t = 2.

time t : s

param epsilon : s^2 = 1e-6

state x = 2
state v : 1/s = 0

eq d/dt x = v
eq d/dt v = ((1 - x^2) * v * 1 [s] - x) / epsilon

episode { step = 2, max_steps = 1 }
solver  { rtol = 1e-10, max_steps = 100000 }
