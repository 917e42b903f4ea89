model HIRES "High irradiance responses of photomorphogenesis: eight reactants"

# E. Schaefer, Journal of Mathematical Biology 2 (1975) 41-56. Reference values at t = 321.8122: Test Set for Initial Value Problem
# Solvers, release 2.4, problem HIRES.

state y[i in 1..8] named "y{}" = if i == 1 then 1 else if i == 8 then 0.0057 else 0 scale 1e-4

let r = 280 * y[6] * y[8]

eq d/dt y[1] * 1 [s] = -1.71*y[1] + 0.43*y[2] + 8.32*y[3] + 0.0007
eq d/dt y[2] * 1 [s] = 1.71*y[1] - 8.75*y[2]
eq d/dt y[3] * 1 [s] = -10.03*y[3] + 0.43*y[4] + 0.035*y[5]
eq d/dt y[4] * 1 [s] = 8.32*y[2] + 1.71*y[3] - 1.12*y[4]
eq d/dt y[5] * 1 [s] = -1.745*y[5] + 0.43*y[6] + 0.43*y[7]
eq d/dt y[6] * 1 [s] = -r + 0.69*y[4] + 1.71*y[5] - 0.43*y[6] + 0.69*y[7]
eq d/dt y[7] * 1 [s] = r - 1.81*y[7]
eq d/dt y[8] * 1 [s] = -r + 1.81*y[7]

episode { step = 321.8122, max_steps = 1 }
solver  { rtol = 1e-10, max_steps = 100000 }
