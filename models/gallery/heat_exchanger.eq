model HeatExchanger "Shell-and-tube heat exchanger in counter-current: eight segments of tube, wall and shell"

# The system heat_exchanger of pc-gym (M. Bloor et al., arXiv:2410.22093), with its parameters; J. Ingham et al., Chemical
# Engineering Dynamics (Wiley-VCH), example on a dynamic heat exchanger.
#
# Task: keep the outlet of the tubes by the flow through the shell while both inlets vary.
#
# Checked: heat lost by the tubes equals heat gained by the shell, at rest; trajectories of SciPy.

time t : s

param U_t : kW/(m^2 K) = 1    "heat transfer from tube to wall"
param U_s : kW/(m^2 K) = 1    "heat transfer from wall to shell"
param l   : m          = 1    "length of a segment"
param D_t : m          = 1    "inner diameter of the wall, as pc-gym counts it"
param D_m : m          = 2    "outer diameter of the wall"
param D_s : m          = 3    "diameter of the shell"
param C_t : kJ/(m^3 K) = 1    "heat capacity of the fluid in the tubes, per volume"
param C_m : kJ/(m^3 K) = 1    "heat capacity of the wall"
param C_s : kJ/(m^3 K) = 1    "heat capacity of the fluid in the shell"
param c_t : kJ/(kg K)  = 1    "heat capacity of the fluid in the tubes, per mass"
param c_s : kJ/(kg K)  = 1    "heat capacity of the fluid in the shell"
set segments = 1..8

action F_t : kg/s = 10  in 5..20    "flow through the tubes"
action F_s : kg/s = 10  in 1..40    "flow through the shell"

state T_t[i in segments] : degC = 60  in 0..120    "tubes"
state T_m[i in segments] : degC = 50  in 0..120    "wall"
state T_s[i in segments] : degC = 40  in 0..120    "shell"

disturbance T_hot  : degC = 90 ~ 90 [degC] + 0.95*(T_hot - 90 [degC]) + 0.5 [K]*normal(0, 1) clip bounds  in 80..100    "inlet of the tubes"
disturbance T_cold : degC = 20 ~ 20 [degC] + 0.95*(T_cold - 20 [degC]) + 0.3 [K]*normal(0, 1) clip bounds  in 10..30    "inlet of the shell"

let Q_t[i in segments] : kW = U_t*pi*D_t*l*(T_t[i] - T_m[i])    "heat from the tube to the wall"
let Q_m[i in segments] : kW = U_s*pi*D_m*l*(T_m[i] - T_s[i])    "heat from the wall to the shell"

eq C_t*pi*l*sq(D_t) * d/dt T_t[i]             = F_t*c_t*((if i == 1 then T_hot else T_t[i-1]) - T_t[i]) - Q_t[i]     for i in segments
eq C_m*pi*l*(sq(D_m) - sq(D_t)) * d/dt T_m[i] = Q_t[i] - Q_m[i]                                                      for i in segments
eq C_s*pi*l*(sq(D_s) - sq(D_m)) * d/dt T_s[i] = F_s*c_s*((if i == 8 then T_cold else T_s[i+1]) - T_s[i]) + Q_m[i]    for i in segments

steady { F_t = 10, F_s = 10 }
initial x = value(steady(x))    for x in states

observe T_t[8], T_s[1], T_hot in 0..120, T_cold in 0..120
level online "thermometers of both outlets" { observe T_t[8] noise normal(0, 0.2), T_s[1] noise normal(0, 0.2) }

reward outlet default = -sq((T_t[8] - steady(T_t[8]))/1 [K]) - sq((F_t - nominal(F_t))/5 [kg/s]) - 0.01*sq((F_s - nominal(F_s))/5 [kg/s])
    "deviation of the outlet, of the throughput, and use of coolant"
constraint hot when T_s[1] > 80 [degC]
fail state_box when outside bounds(T_t, T_m, T_s)
episode { step = 2 [s], max_steps = 200, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/heat_exchanger.eq`, against balances ----

test "the heat that one side loses warms the other" {
  start steady
  expect 90 [degC] - T_t[8] within 1e-6 of T_s[1] - 20 [degC]
}
