model RecycleCascade "Two cooled stirred tanks in series with recycle"

# The system cstr_series_recycle of pc-gym (M. Bloor et al., arXiv:2410.22093), with its parameters; volumes of litres,
# coefficients as of the hydrolysis of acetic anhydride. The reaction is exothermic; pc-gym has the other sign, which the
# variant pcgym repeats.
#
# Task: keep the conversion while temperature and concentration of the feed vary.
#
# Checked: trajectories of SciPy; heat and reactant balance at rest.

time t : s

param V_1  : L         = 1          "volume of the first tank"
param V_2  : L         = 2          "volume of the second tank"
param UA_1 : kJ/(s K)  = 0.461      "heat transfer of the first tank"
param UA_2 : kJ/(s K)  = 0.732      "heat transfer of the second tank"
param rho  : kg/m^3    = 1.05e3     "density"
param c_p  : kJ/(kg K) = 3.766      "heat capacity"
param k_0  : 1/s       = 3.118e5    "pre-exponential factor"
param E    : kJ/mol    = 46.14      "activation energy"
param dH   : kJ/mol    = -58.41     "heat of reaction (negative: exothermic)"
param R    : J/(mol K) = 8.3145     "gas constant"

action F    : mL/s = 10   in 2..40       "feed"
action L    : mL/s = 5    in 0..20       "recycle from the second tank"
action T_c1 : K    = 300  in 280..350    "coolant of the first tank"
action T_c2 : K    = 300  in 280..350    "coolant of the second tank"

state C_1 : mol/m^3 = 70   in 0..200      "reactant in the first tank"
state T_1 : K       = 300  in 260..400    "temperature of the first tank"
state C_2 : mol/m^3 = 50   in 0..200      "reactant in the second tank"
state T_2 : K       = 300  in 260..400    "temperature of the second tank"

disturbance C_0 : mol/m^3 = 97.35 ~ 97.35 [mol/m^3] + 0.95*(C_0 - 97.35 [mol/m^3]) + 1 [mol/m^3]*normal(0, 1) clip bounds  in 80..115    "reactant in the feed"
disturbance T_0 : K       = 298   ~ 298 [K] + 0.95*(T_0 - 298 [K]) + 0.3 [K]*normal(0, 1) clip bounds  in 285..310    "temperature of the feed"

let r_1 : mol/(m^3 s) = k_0*exp(-E/(R*T_1))*C_1    "rate in the first tank"
let r_2 : mol/(m^3 s) = k_0*exp(-E/(R*T_2))*C_2    "rate in the second tank"

eq V_1 * d/dt C_1 = F*C_0 + L*C_2 - (F + L)*C_1 - V_1*r_1
eq V_1 * d/dt T_1 = F*T_0 + L*T_2 - (F + L)*T_1 - UA_1/(rho*c_p)*(T_1 - T_c1) - V_1*dH/(rho*c_p)*r_1
eq V_2 * d/dt C_2 = (F + L)*(C_1 - C_2) - V_2*r_2
eq V_2 * d/dt T_2 = (F + L)*(T_1 - T_2) - UA_2/(rho*c_p)*(T_2 - T_c2) - V_2*dH/(rho*c_p)*r_2

steady { F = 10, L = 5, T_c1 = 300, T_c2 = 300 }
initial x = value(steady(x))    for x in states

observe C_1, T_1, C_2, T_2, C_0 in 60..140
level online "thermometers, and the reactant that leaves every three steps" {
  observe T_1 noise normal(0, 0.1), T_2 noise normal(0, 0.1), C_2 every 3 delay 1 noise normal(0, 0.5)
}

reward conversion default = -sq((C_2 - steady(C_2))/1 [mol/m^3]) - sq((F - nominal(F))/10 [mL/s])
    "deviation of the reactant that leaves, and of the production"
constraint unreacted when C_2 > 60 [mol/m^3]
fail state_box when outside bounds(C_1, T_1, C_2, T_2)
episode { step = 20 [s], max_steps = 150, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

variant pcgym "heat of reaction with the sign of pc-gym: endothermic" { param dH : kJ/mol = 58.41    "heat of reaction" }
