model Robertson "Robertson's autocatalytic reaction as ordinary differential equations"

# H. H. Robertson, in: Numerical Analysis: An Introduction (1966) 178-182. Reference values at t = 1e11: Test Set for Initial Value
# Problem Solvers, release 2.4, problem ROBER.

time t : s

param k_1 : 1/s = 0.04
param k_2 : 1/s = 3e7
param k_3 : 1/s = 1e4

state y_1 = 1 scale 1e-4
state y_2 = 0 scale 1e-10
state y_3 = 0

eq d/dt y_1 = -k_1*y_1 + k_3*y_2*y_3
eq d/dt y_2 = k_1*y_1 - k_3*y_2*y_3 - k_2*y_2^2
eq d/dt y_3 = k_2*y_2^2

invariant mass = y_1 + y_2 + y_3

episode { step = 1e11, max_steps = 1 }
solver  { rtol = 1e-9, max_steps = 100000 }
