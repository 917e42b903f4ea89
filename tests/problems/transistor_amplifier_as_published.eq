model TransistorAmplifier "as published: M y' = f with a singular matrix M; Test Set for IVP Solvers, problem TRANSAMP"

# Two equations for each condenser give the rate of its voltage and a balance of currents.
time t : s
let U_e = 0.1*sin(200*pi*value(t))
param U_b = 6, U_F = 0.026, alpha = 0.99, beta = 1e-6, R_0 = 1000, R = 9000
param C : s = 1e-6
def g(x) = beta*(exp(x/U_F) - 1)
state y_1 = 0 in -10..10
state y_2 = 3 in -10..10
state y_3 = 3 in -10..10
state y_4 = 6 in -10..10
state y_5 = 3 in -10..10
state y_6 = 3 in -10..10
state y_7 = 6 in -10..10
state y_8 = 0 in -10..10
eq C*(d/dt y_2 - d/dt y_1) = -(U_e - y_1)/R_0
eq C*(d/dt y_1 - d/dt y_2) = -(U_b/R - 2*y_2/R - (1 - alpha)*g(y_2 - y_3))
eq 2*C*d/dt y_3 = g(y_2 - y_3) - y_3/R
eq 3*C*(d/dt y_5 - d/dt y_4) = -((U_b - y_4)/R - alpha*g(y_2 - y_3))
eq 3*C*(d/dt y_4 - d/dt y_5) = -(U_b/R - 2*y_5/R - (1 - alpha)*g(y_5 - y_6))
eq 4*C*d/dt y_6 = g(y_5 - y_6) - y_6/R
eq 5*C*(d/dt y_8 - d/dt y_7) = -((U_b - y_7)/R - alpha*g(y_5 - y_6))
eq 5*C*(d/dt y_7 - d/dt y_8) = y_8/R
observe y_8 in -10..10
episode { step = 0.2 [s], max_steps = 1 }
solver  { rtol = 1e-8, atol_factor = 0.1, max_steps = 5000 }
