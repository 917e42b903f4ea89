model RobertsonDAE "Robertson's reaction with the conservation law in place of the third rate"

# As robertson.eq; the third concentration is algebraic.

time t : s

param k_1 : 1/s = 0.04
param k_2 : 1/s = 3e7
param k_3 : 1/s = 1e4

state y_1 = 1 scale 1e-4
state y_2 = 0 scale 1e-10
var   y_3 : 1 = 0

eq d/dt y_1 = -k_1*y_1 + k_3*y_2*y_3
eq d/dt y_2 = k_1*y_1 - k_3*y_2*y_3 - k_2*y_2^2
eq 1 = y_1 + y_2 + y_3

observe y_1 in 0..1, y_2 in 0..1, y_3 in 0..1

episode { step = 1e11, max_steps = 1 }
solver  { rtol = 1e-9, max_steps = 100000 }
