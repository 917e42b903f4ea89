model Cascade "two jacketed reactors in series, cooled through control valves"
time t : h
set species = { A, B }
set stage = 1..2
action T_set : degC = 60 in 50..80    "set-point of both temperatures"
param F : m^3/h = 1    "flow through both reactors"
param c_0[i in species] : mol/m^3 = { A: 2000, B: 0 }    "feed"
param T_0    : degC       = 55      "its temperature"
param k_0    : 1/h        = 5e9     "pre-exponential factor"
param dH     : kJ/mol     = 90      "heat of reaction"
param rho_cp : kJ/(m^3 K) = 4180    "heat capacity of all liquids by volume"
param UA     : kW/K       = 3       "heat transfer of a jacket"
param V_j    : m^3        = 0.2     "volume of a jacket"
param T_w    : degC       = 15      "coolant"
param K_v    : m^3/h      = 10      "flow of coolant at 1 bar, valve open"
param dp     : bar        = 2       "pressure drop of a valve"
param range               = 50      "rangeability of a valve"
param tau    : s          = 10      "time constant of a thermometer"
param K                   = -2      "gain of a controller"
param T_i    : s          = 300     "its integral time"
state V[stage] : m^3 = 1 in 0..inf    "volumes"
state c[k in stage, i in species] : mol/m^3 = 0 in 0..inf scale 1    "concentrations"
state T[stage]   : degC = 60   in -50..500  scale 100    "temperatures"
state T_j[stage] : degC = 25   in -50..500  scale 100    "temperatures of the jackets"
state y[stage]          = 0.5  in -1..2     scale 1      "measured temperatures over 100 K"
state I[stage]          = 0.5  in -10..10   scale 1      "integral parts"
let c_in[k in stage, i in species] = if k == 1 then c_0[i] else c[k-1, i]
let T_in[k in stage]                  = if k == 1 then T_0 else T[k-1]
let r[k in stage]       : mol/(m^3 h) = k_0*exp(-7200 [K]/kelvin(T[k]))*c[k, A]        "rate"
let heat[k in stage]    : kW          = UA*(T[k] - T_j[k])                             "heat to the jacket"
let error[k in stage]                 = (T_set - 0 [degC])/100 [K] - y[k]
let free[k in stage]                  = K*error[k] + I[k]                              "output without limits"
let opening[k in stage]               = clip(free[k], 0, 1)
let F_j[k in stage]     : m^3/h       = K_v*range^(opening[k] - 1)*sqrt(dp/1 [bar])    "coolant"
eq d/dt V[k]    = 0                                                                   for k in stage
eq d/dt c[k, i] = F*(c_in[k, i] - c[k, i])/V[k] + (if i == A then -1 else 1)*r[k]     for k in stage, i in species
eq d/dt T[k]    = F*(T_in[k] - T[k])/V[k] + dH*r[k]/rho_cp - heat[k]/(rho_cp*V[k])    for k in stage
eq d/dt T_j[k]  = F_j[k]*(T_w - T_j[k])/V_j + heat[k]/(rho_cp*V_j)                    for k in stage
eq d/dt y[k]    = ((T[k] - 0 [degC])/100 [K] - y[k])/tau                              for k in stage
eq d/dt I[k]    = K*error[k]/T_i + (opening[k] - free[k])/T_i                         for k in stage
observe T in 0..100, c_B : mol/m^3 = c[2, B] in 0..2000
episode { step = 0.05 [h], max_steps = 60 }
