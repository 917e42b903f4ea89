model ChyllaHaase "Semibatch polymerisation of the Chylla-Haase benchmark: jacketed reactor with coolant recirculation, product A"

# R. W. Chylla, D. R. Haase, Temperature control of semibatch polymerization reactors, Computers and Chemical Engineering 17 (1993)
# 257-264, in the form of K. Graichen, V. Hagenmeyer, M. Zeitz, Feedforward control with online parameter estimation applied to the
# Chylla-Haase reactor benchmark, Journal of Process Control 16 (2006) 733-745. The transport delays of the jacket (22.8 s) and of the
# recirculation (15 s) are chains of ten lags each here.
#
# Task: bring the reactor to 355.382 K and hold it by the split-range valve of coolant and steam, while monomer is fed from minute 30 to
# 100. Reactivity and fouling differ from batch to batch; the viscosity rises and the heat transfer falls.
#
# Checked: monomer fed is monomer left and polymer made; trajectories of SciPy.

time t : min

param m_W   : kg         = 42.750                                         "water in the reactor"
param m_C   : kg         = 21.455                                         "coolant in the jacket"
param w_C   : kg/s       = 0.9412                                         "circulation of the coolant"
param C_M   : kJ/(kg K)  = 1.675                                          "heat capacity of the monomer"
param C_P   : kJ/(kg K)  = 3.140                                          "heat capacity of the polymer"
param C_W   : kJ/(kg K)  = 4.187                                          "heat capacity of water and coolant"
param rho_M : kg/m^3     = 900                                            "density of the monomer"
param rho_P : kg/m^3     = 1040                                           "density of the polymer"
param rho_W : kg/m^3     = 1000                                           "density of water"
param dH    : kJ/kmol    = -70152.16                                      "heat of reaction (negative: exothermic)"
param M_M   : kg/kmol    = 104                                            "molar mass of the monomer"
param k_0   : 1/s        = 55                                             "rate constant: factor"
param k_1   : m s/kg     = 1000                                           "rate constant: factor of the viscosity"
param k_2                = 0.4                                            "rate constant: exponent of the viscosity (gel effect)"
param E     : J/mol      = 29560.89                                       "activation energy"
param R     : J/(mol K)  = 8.314                                          "gas constant"
param c_0   : kg/(m s)   = 5.2e-5                                         "viscosity: factor"
param c_1                = 16.4                                           "viscosity: exponent of the polymer"
param c_2                = 2.3                                            "viscosity: exponent of the temperature"
param c_3                = 1.563                                          "viscosity: offset of the temperature"
param a_0   : K          = 555.556                                        "viscosity: temperature"
param d_0   : kW/(m^2 K) = 0.814                                          "heat transfer of the film: factor"
param d_1   : m s/kg     = -5.13                                          "heat transfer of the film: exponent"
param per   : m          = 1.594                                          "perimeter of the jacket"
param B_1   : m^2        = 0.193                                          "bottom of the reactor"
param B_2   : m^2        = 0.167                                          "bottom of the jacket"
param UA    : kW/K       = 0.00567567                                     "heat losses"
param tau_p : s          = 40.2                                           "time constant of heating and cooling"
param th_1  : s          = 22.8                                           "delay of the jacket"
param th_2  : s          = 15                                             "delay of the recirculation"
param T_in  : K          = 294.26                                         "coolant"
param T_st  : K          = 449.82                                         "steam"
param T_amb : K          = 305.382                                        "surroundings and feed"
param T_set : K          = 355.382                                        "set-point"
param i     : 1          = 1          ~ uniform(0.8, 1.2)  in 0.5..1.5    "reactivity of the batch, by impurities"
param foul  : m^2 K/kW   = 0.352      ~ uniform(0, 0.704)  in 0..1        "resistance of the fouled wall"
table feed : kg/s over time : min until { 30: 0, 100: 7.560e-3, 250: 0 }
set stages = 1..10

action c : % = 50 in 0..100    "valve: coolant below 50 %, steam above"

state m_M  : kg = 0        in 0..60     scale 1    "monomer"
state m_P  : kg = 11.227   in 0..80                "polymer"
state T    : K  = 305.382  in 270..420             "reactor"
state T_jo : K  = 305.382  in 270..450             "jacket, outlet"
state T_ji : K  = 305.382  in 270..450             "jacket, inlet"
state x[j in stages] : K = 305.382  in 270..450    "inlet on its way through the jacket"
state y[j in stages] : K = 305.382  in 270..450    "outlet on its way through the recirculation"

disturbance dT_in : K = 0 ~ 0.98*dT_in + 0.2 [K]*normal(0, 1) clip bounds in -5..5    "deviation of the coolant"

def viscosity(at) = c_0*exp(c_1*f)*10^(c_2*(a_0/at - c_3))
let f                 = m_P/(m_M + m_P + m_W)
let T_j  : K          = (T_ji + T_jo)/2                                       "jacket"
let k    : 1/s        = k_0*exp(-E/(R*T))*(k_1*viscosity(T))^k_2              "rate constant"
let r    : kg/s       = i*k*m_M                                               "polymerisation"
let Q    : kW         = -dH/M_M*r                                             "heat of reaction"
let area : m^2        = (m_M/rho_M + m_P/rho_P + m_W/rho_W)*per/B_1 + B_2     "wetted jacket"
let U    : kW/(m^2 K) = 1/(1/(d_0*exp(d_1*viscosity((T + T_j)/2))) + foul)    "heat transfer"
let K : K = if c < 50 [%] then 0.8*30^(-c/50 [%])*(T_in + dT_in - T_ji)
            else if c > 50 [%] then 0.15*30^(c/50 [%] - 2)*(T_st - T_ji) else 0    "heating and cooling"

eq d/dt m_M = feed(t) - r
eq d/dt m_P = r
eq (m_M*C_M + m_P*C_P + m_W*C_W) * d/dt T = feed(t)*C_M*(T_amb - T) - U*area*(T - T_j) - UA*(T - T_amb) + Q
eq m_C*C_W * d/dt T_jo = w_C*C_W*(x[10] - T_jo) + U*area*(T - T_j)
eq d/dt T_ji           = (y[9] - y[10])*10/th_2 + (y[10] - T_ji)/tau_p + K/tau_p
eq th_1/10 * d/dt x[j] = (if j == 1 then T_ji else x[j-1]) - x[j]    for j in stages
eq th_2/10 * d/dt y[j] = (if j == 1 then T_jo else y[j-1]) - y[j]    for j in stages

invariant material = m_M + m_P rate feed(t)    "monomer and polymer"

observe T, T_jo, T_ji, m_M, m_P, left = 1 - n/450 in 0..1
level online "thermometers, and the clock" {
  observe T noise normal(0, 0.05), T_jo noise normal(0, 0.05), T_ji noise normal(0, 0.05), left = 1 - n/450 in 0..1
}

reward temperature default = -min(sq((T - T_set)/0.6 [K]), 100)/100    "squared deviation over the tolerance of 0.6 K, limited"
constraint off when abs(T - T_set) > 0.6 [K] and clock >= 30 [min]
fail runaway when T > 380 [K]
episode { step = 20 [s], max_steps = 450, error_reward = -500 }
solver  { method = auto, rtol = 1e-8 }
