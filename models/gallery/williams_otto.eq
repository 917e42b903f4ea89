model WilliamsOtto "Williams-Otto reactor: A + B -> C, B + C -> P + E, C + P -> G at a profit"

# T. J. Williams, R. E. Otto, A generalized chemical processing model for the investigation of computer control, AIEE Transactions
# 79 (1960) 458-473; the reactor and its numbers as in J. F. Forbes, T. E. Marlin, Design cost: a systematic approach to
# technology selection for model-based real-time optimization systems, Computers and Chemical Engineering 20 (1996) 717-734.
#
# Task: maximise the profit by feed of B and temperature of the reactor while the feed of A varies. Little A and little of the
# by-product G may leave the reactor.
#
# Checked: the profit has its steady maximum at F_B = 4.787 kg/s and T_R = 89.70 degC, as published; trajectories of SciPy.

time t : s

param W    : kg   = 2104.7       "mass in the reactor"
param F_A0 : kg/s = 1.8275       "mean feed of A"
param k_10 : 1/s  = 1.6599e6     "A + B -> C"
param k_20 : 1/s  = 7.2117e8     "B + C -> P + E"
param k_30 : 1/s  = 2.6745e12    "C + P -> G"
param E_1  : K    = 6666.7       "activation temperature of A + B -> C"
param E_2  : K    = 8333.3       "activation temperature of B + C -> P + E"
param E_3  : K    = 11111        "activation temperature of C + P -> G"

action F_B : kg/s = 4.5  in 3..6       "feed of B"
action T_R : degC = 86   in 70..100    "temperature of the reactor"

state X_A = 0.087  in 0..1    "mass fraction of A"
state X_B = 0.390  in 0..1    "mass fraction of B"
state X_C = 0.015  in 0..1    "mass fraction of the intermediate C"
state X_E = 0.291  in 0..1    "mass fraction of the product E"
state X_G = 0.108  in 0..1    "mass fraction of the waste G"
state X_P = 0.109  in 0..1    "mass fraction of the product P"

disturbance dF_A : kg/s = 0 ~ 0.95*dF_A + 0.03 [kg/s]*normal(0, 1) clip bounds in -0.5..0.5    "deviation of the feed of A"
let F_A : kg/s = F_A0 + dF_A    "feed of A"
let F   : kg/s = F_A + F_B      "outflow"

let r_1 : kg/s = k_10*exp(-E_1/kelvin(T_R))*X_A*X_B*W    "consumption of A"
let r_2 : kg/s = k_20*exp(-E_2/kelvin(T_R))*X_B*X_C*W    "consumption of B by C"
let r_3 : kg/s = k_30*exp(-E_3/kelvin(T_R))*X_C*X_P*W    "consumption of C by P"

eq W * d/dt X_A = F_A - F*X_A - r_1
eq W * d/dt X_B = F_B - F*X_B - r_1 - r_2
eq W * d/dt X_C = -F*X_C + 2*r_1 - 2*r_2 - r_3
eq W * d/dt X_E = -F*X_E + 2*r_2
eq W * d/dt X_G = -F*X_G + 1.5*r_3
eq W * d/dt X_P = -F*X_P + r_2 - 0.5*r_3

steady { F_B = 4.5, T_R = 86 }
initial x = value(steady(x))    for x in states

let profit : 1/s = 1143.38 [1/kg]*X_P*F + 25.92 [1/kg]*X_E*F - 76.23 [1/kg]*F_A - 114.34 [1/kg]*F_B    "profit, $/s"

observe X_A, X_B, X_C, X_E, X_G, X_P, F_A in 1..3
level online "flow of A, and an analysis every four steps, two steps late" {
  observe F_A in 1..3 noise normal(0, 0.01), X_P every 4 delay 2 noise normal(0, 0.002), X_E every 4 delay 2 noise normal(0, 0.005)
  observe X_G every 4 delay 2 noise normal(0, 0.002)
}

reward economy default = integral(profit)    "profit of the step, $"
constraint unreacted when X_A > 0.12
constraint waste when X_G > 0.12
fail state_box when outside bounds(X_A, X_B, X_C, X_E, X_G, X_P)
episode { step = 60 [s], max_steps = 120, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }
