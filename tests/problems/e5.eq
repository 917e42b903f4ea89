model E5 "Chemical pyrolysis: four species whose amounts fall by twenty orders of magnitude"

# Problem E5 of W. H. Enright, T. E. Hull, B. Lindberg, BIT 15 (1975) 10-48, over the interval of E. Hairer, G. Wanner, Solving Ordinary
# Differential Equations II, section IV.10. Reference values at t = 1e13: Test Set for Initial Value Problem Solvers, release 2.4, problem E5. Those
# at earlier times are from SciPy's Radau method at rtol 1e-12 and 1e-10 and its BDF at 1e-12, which agree in the digits given.

time t : s

param A : 1/s = 7.89e-10
param B : 1/s = 1.1e7
param C : 1/s = 1.13e3
param M       = 1e6

state y1 = 1.76e-3  scale 1e-16
state y2 = 0        scale 1e-16
state y3 = 0        scale 1e-16
state y4 = 0        scale 1e-16

eq d/dt y1 = -A*y1 - B*y1*y3
eq d/dt y2 = A*y1 - M*C*y2*y3
eq d/dt y4 = B*y1*y3 - C*y4
eq d/dt y3 = der(y2) - der(y4)

episode { step = 1e13 [s], max_steps = 1 }
solver  { rtol = 1e-10, max_steps = 100000 }
