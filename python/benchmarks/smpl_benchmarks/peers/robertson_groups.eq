model Robertson "groups of Robertson's autocatalytic reaction, one like the other"

# H. H. Robertson, in: Numerical Analysis: An Introduction (1966) 178-182. One group has the reference value of tests/problems at t = 1e11.

time t : s

param groups        = 100     "groups"
param sampling : s  = 4e10    "length of the integration"
param k_1      : 1/s = 0.04
param k_2      : 1/s = 3e7
param k_3      : 1/s = 1e4

set group = 1..groups

state x[group] = 1 scale 1
state y[group] = 0 scale 1e-4
state z[group] = 0 scale 1

eq d/dt x[i] = -k_1*x[i] + k_3*y[i]*z[i]                  for i in group
eq d/dt y[i] = k_1*x[i] - k_3*y[i]*z[i] - k_2*y[i]^2      for i in group
eq d/dt z[i] = k_2*y[i]^2                                 for i in group

observe x[1] in 0..1
reward rest default = x[1]

episode { step = sampling, max_steps = 1 }
solver  { rtol = 1e-4, max_steps = 100000 }
