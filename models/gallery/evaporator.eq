model Evaporator "Forced-circulation evaporator: level, product composition and pressure"

# R. B. Newell, P. L. Lee, Applied Process Control: A Case Study (Prentice Hall, 1989).
#
# Task: keep composition and pressure, and the level, which integrates, by product flow, steam pressure and cooling water, while
# flow and composition of the feed vary.
#
# Checked: the published steady state (X_2 = 25 %, P_2 = 50.5 kPa, F_4 = F_5 = 8 kg/min, T_2 = 84.6 degC, T_3 = 80.6 degC,
# F_100 = 9.3 kg/min, T_100 = 119.9 degC, Q_100 = 339 kW, T_201 = 46.1 degC, Q_200 = 307.9 kW); trajectories of SciPy.

time t : min

param M     : kg/m          = 20      "area of the separator times density"
param M_X   : kg            = 20      "liquid in the evaporator"
param C     : kg/kPa        = 4       "vapour per pressure"
param lam   : kW min/kg     = 38.5    "heat of evaporation of the product"
param lam_s : kW min/kg     = 36.6    "heat of condensation of the steam"
param C_p   : kW min/(kg K) = 0.07    "heat capacity"
param UA_2  : kW/K          = 6.84    "heat transfer of the condenser"
param F_3   : kg/min        = 50      "circulation"
param T_1   : degC          = 40      "temperature of the feed"
param T_200 : degC          = 25      "inlet of the cooling water"

action F_2   : kg/min = 2      in 0..4        "product"
action P_100 : kPa    = 194.7  in 100..400    "pressure of the steam"
action F_200 : kg/min = 208    in 50..400     "cooling water"

state L_2 : m   = 1     in 0..2       "level of the separator"
state X_2 : %   = 25    in 5..60      "composition of the product"
state P_2 : kPa = 50.5  in 20..100    "pressure"

disturbance F_1 : kg/min = 10 ~ 10 [kg/min] + 0.95*(F_1 - 10 [kg/min]) + 0.1 [kg/min]*normal(0, 1) clip bounds  in 8..12    "feed"
disturbance X_1 : %      = 5  ~ 5 [%] + 0.95*(X_1 - 5 [%]) + 0.05 [%]*normal(0, 1) clip bounds  in 4..6     "composition of the feed"

let T_2   : degC   = 48.43 [degC] + 0.5616 [K/kPa]*P_2 + 0.3126 [K/%]*X_2    "product"
let T_3   : degC   = 55 [degC] + 0.507 [K/kPa]*P_2                           "vapour"
let T_100 : degC   = 90 [degC] + 0.1538 [K/kPa]*P_100                        "steam"
let UA_1  : kW/K   = 0.16 [kW min/(K kg)]*(F_1 + F_3)                        "heat transfer of the evaporator"
let Q_100 : kW     = UA_1*(T_100 - T_2)                                      "heat of the steam"
let F_4   : kg/min = (Q_100 - C_p*F_1*(T_2 - T_1)) / lam                     "vapour"
let F_100 : kg/min = Q_100 / lam_s                                           "steam"
let Q_200 : kW     = UA_2*(T_3 - T_200) / (1 + UA_2/(2*C_p*F_200))           "heat to the cooling water"
let T_201 : degC   = T_200 + Q_200/(C_p*F_200)                               "outlet of the cooling water"
let F_5   : kg/min = Q_200 / lam                                             "condensate"

eq M * d/dt L_2   = F_1 - F_4 - F_2
eq M_X * d/dt X_2 = F_1*X_1 - F_2*X_2
eq C * d/dt P_2   = F_4 - F_5

steady { F_2 = 2, P_100 = 194.7, F_200 = 208, L_2 = 1 }
initial x = value(steady(x))    for x in states

let cost : 1/h = 0.6 [1/kg]*F_100 + 0.01 [1/kg]*F_200    "utilities, relative prices"

observe L_2, X_2, P_2, F_1 in 5..15, X_1 in 2..8
level online "gauges of level, pressure and flow; composition every five steps" {
  observe L_2 noise normal(0, 0.005), P_2 noise normal(0, 0.1), F_1 in 5..15 noise normal(0, 0.05), X_2 every 5 delay 1 noise normal(0, 0.1)
}

reward regulation default = -sq((X_2 - 25 [%])/1 [%]) - sq((P_2 - 50.5 [kPa])/2 [kPa]) - sq((L_2 - 1 [m])/0.2 [m])    "squared deviations"
reward economy            = -integral(cost)    "utilities of the step"
constraint dilute when X_2 < 24 [%]
constraint pressure when P_2 > 70 [kPa]
fail state_box when outside bounds(L_2, X_2, P_2)
episode { step = 1 [min], max_steps = 200, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/evaporator.eq`, against Newell and Lee 1989 ----

test "the published steady state" {
  start steady
  expect X_2 within 0.11 of 25
  expect P_2 within 0.11 of 50.5
  expect T_2 within 0.11 of 84.6
  expect F_4 within 0.11 of 8
  expect T_201 within 0.11 of 46.1
}
