model TransistorAmplifier "eight voltages, three of them at each transistor; Test Set for IVP Solvers, problem TRANSAMP"

# The voltages of the condensers are the states, so that the index is 1; the nodes follow from the balances of currents.
time t : s
let U_e = 0.1*sin(200*pi*value(t))
param U_b = 6, U_F = 0.026, alpha = 0.99, beta = 1e-6, R_0 = 1000, R = 9000
let c = 1e-6 [s]
def g(x) = beta*(exp(x/U_F) - 1)

state v_1 = 3 in -10..10
state y_3 = 3 in -10..10
state v_3 = -3 in -10..10
state y_6 = 3 in -10..10
state v_5 = -6 in -10..10
var   y_1 = 0, y_2 = 3, y_4 = 6, y_5 = 3, y_7 = 6, y_8 = 0

eq y_2 = y_1 + v_1
eq y_5 = y_4 + v_3
eq y_8 = y_7 + v_5
eq d/dt v_1 = -(U_e - y_1)/R_0 / c
eq 0 = (U_e - y_1)/R_0 + U_b/R - 2*y_2/R - (1 - alpha)*g(y_2 - y_3)
eq d/dt y_3 = (g(y_2 - y_3) - y_3/R) / (2*c)
eq 0 = (U_b - y_4)/R - alpha*g(y_2 - y_3) + U_b/R - 2*y_5/R - (1 - alpha)*g(y_5 - y_6)
eq d/dt v_3 = -((U_b - y_4)/R - alpha*g(y_2 - y_3)) / (3*c)
eq d/dt y_6 = (g(y_5 - y_6) - y_6/R) / (4*c)
eq d/dt v_5 = -((U_b - y_7)/R - alpha*g(y_5 - y_6)) / (5*c)
eq 0 = (U_b - y_7)/R - alpha*g(y_5 - y_6) - y_8/R

observe y_8 in -10..10
episode { step = 0.2 [s], max_steps = 1 }
solver  { rtol = 1e-8, atol_factor = 0.1, max_steps = 5000 }    # with the algebraic nodes in the error test it takes 73 000
