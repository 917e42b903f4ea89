model VanDeVusse "Van de Vusse reactor: A -> B -> C, 2 A -> D in a stirred tank with a cooled jacket"

# K.-U. Klatt, S. Engell, Gain-scheduling trajectory control of a continuous stirred tank reactor, Computers and Chemical
# Engineering 22 (1998) 491-502.
#
# Task: keep the product B at its set-point, which changes every 50 steps, by feed and cooling. The static gain from the feed
# to B changes its sign near the operating point. The temperature of the feed is an unmeasured disturbance.
#
# Checked: the published operating point c_A = 2.14 mol/L, c_B = 1.09 mol/L, T = 114.2 degC, T_K = 112.9 degC; trajectories of
# SciPy.

time t : h

param k_10   : 1/h          = 1.287e12               "A -> B"
param k_20   : 1/h          = 1.287e12               "B -> C"
param k_30   : L/(mol h)    = 9.043e9                "2 A -> D"
param E_1    : K            = 9758.3                 "activation energy of A -> B over the gas constant"
param E_2    : K            = 9758.3                 "activation energy of B -> C over the gas constant"
param E_3    : K            = 8560                   "activation energy of 2 A -> D over the gas constant"
param H_1    : kJ/mol       = 4.2                    "heat of reaction of A -> B"
param H_2    : kJ/mol       = -11.0                  "heat of reaction of B -> C"
param H_3    : kJ/mol       = -41.85                 "heat of reaction of 2 A -> D"
param rho    : kg/L         = 0.9342                 "density"
param C_p    : kJ/(kg K)    = 3.01                   "heat capacity"
param k_w    : kJ/(h m^2 K) = 4032                   "heat-transfer coefficient of the jacket"
param A_R    : m^2          = 0.215                  "area of the jacket"
param V_R    : L            = 10                     "volume"
param m_K    : kg           = 5                      "mass of the coolant"
param C_pK   : kJ/(kg K)    = 2                      "heat capacity of the coolant"
param c_0    : mol/L        = 5.1                    "A in the feed"
param T_in   : degC         = 104.9                  "mean temperature of the feed"
param change : mol/L        = 0.1       in 0..0.3    "largest decrease of the set-point"

action f   : 1/h  = 14.19    in 3..35       "feed flow over the volume"
action Q_K : kJ/h = -1113.5  in -9000..0    "heat taken from the coolant"

state c_A : mol/L = 2.14   in 0..6       "A"
state c_B : mol/L = 1.09   in 0..4       "B, the product"
state T   : degC  = 114.2  in 50..200    "temperature of the reactor"
state T_K : degC  = 112.9  in 50..200    "temperature of the coolant"

disturbance dT_0 : K     = 0 ~ 0.95*dT_0 + 0.5 [K]*normal(0, 1) clip bounds                     in -10..10    "deviation of the feed temperature"
disturbance dr   : mol/L = 0 ~ if n > 0 and mod(n, 50) == 0 then -change*uniform(0, 1) else dr  in -0.3..0    "change of the set-point"

let k_1  : 1/h       = k_10 * exp(-E_1 / kelvin(T))
let k_2  : 1/h       = k_20 * exp(-E_2 / kelvin(T))
let k_3  : L/(mol h) = k_30 * exp(-E_3 / kelvin(T))
let heat : kJ/(L h)  = k_1*c_A*H_1 + k_2*c_B*H_2 + k_3*sq(c_A)*H_3    "heat consumed by the reactions"

eq d/dt c_A = f*(c_0 - c_A) - k_1*c_A - k_3*sq(c_A)
eq d/dt c_B = -f*c_B + k_1*c_A - k_2*c_B
eq d/dt T   = f*(T_in + dT_0 - T) - heat/(rho*C_p) + k_w*A_R/(rho*C_p*V_R)*(T_K - T)
eq d/dt T_K = (Q_K + k_w*A_R*(T - T_K)) / (m_K*C_pK)

steady { f = 14.19, Q_K = -1113.5 }
initial x = value(steady(x))    for x in states

let r : mol/L = steady(c_B) + dr    "set-point of the product"

observe c_A, c_B, T, T_K, e : mol/L = r - c_B in -4..4
level online "thermometers, and the product every five steps, two steps late" {
  observe T noise normal(0, 0.1), T_K noise normal(0, 0.1), c_B every 5 delay 2 noise normal(0, 0.01), r in 0..4
}

reward product default = -sq((r - c_B) / 0.1 [mol/L]) - 0.01*sq((T - steady(T)) / 1 [K])
    "deviation of the product and of the temperature"
constraint hot when T > 120 [degC]
fail state_box when outside bounds(c_A, c_B, T, T_K)
episode { step = 0.005 [h], max_steps = 200, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/van_de_vusse.eq`, against Klatt and Engell 1998 ----

test "the published operating point" {
  start steady
  expect c_A within 5e-3 of 2.14
  expect c_B within 5e-3 of 1.09
  expect T within 0.05 of 114.2
  expect T_K within 0.05 of 112.9
}
