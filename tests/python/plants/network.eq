model Network "a cold stream is heated by two hot streams in three exchangers"
time t : h
action share  : 1     = 0.5  in 0.1..0.9    "share of the cold stream that goes to A"
action F_cold : m^3/h = 8    in 4..12       "cold stream"
param UA_a   : kW/K       = 2       "heat transfer in A"
param UA_b   : kW/K       = 3       "heat transfer in B"
param UA_c   : kW/K       = 4       "heat transfer in C"
param V      : m^3        = 0.1     "volume of each side"
param rho_cp : kJ/(m^3 K) = 4180    "heat capacity of both streams by volume"
param F_a    : m^3/h      = 5       "hot stream to A"
param F_c    : m^3/h      = 6       "hot stream to C, then B"
param T_a_in : degC       = 90      "temperature of the hot stream to A"
param T_c_in : degC       = 120     "temperature of the hot stream to C"
param T_in   : degC       = 20      "temperature of the cold stream"
domain z in 0..1 cells 20 scheme upwind    "share of the length, from the inlet of the hot stream"
state H_a[z] : K = 330  in 200..800  scale 100    "hot side of A"
state C_a[z] : K = 290  in 200..800  scale 100    "cold side of A"
state H_b[z] : K = 330  in 200..800  scale 100    "hot side of B"
state C_b[z] : K = 290  in 200..800  scale 100    "cold side of B"
state H_c[z] : K = 330  in 200..800  scale 100    "hot side of C"
state C_c[z] : K = 290  in 200..800  scale 100    "cold side of C"
let Q_a   : m^3/h = share*F_cold                                    "cold stream through A"
let Q_b   : m^3/h = (1 - share)*F_cold                              "cold stream through B"
let T_mix : K     = (Q_a*C_a[z.first] + Q_b*C_b[z.first])/F_cold    "cold stream to C"
flux JH_a[z] = F_a/V*H_a[z], low = F_a/V*kelvin(T_a_in)
flux JC_a[z] = -Q_a/V*C_a[z], high = -Q_a/V*kelvin(T_in)
flux JH_b[z] = F_c/V*H_b[z], low = F_c/V*H_c[z.last]
flux JC_b[z] = -Q_b/V*C_b[z], high = -Q_b/V*kelvin(T_in)
flux JH_c[z] = F_c/V*H_c[z], low = F_c/V*kelvin(T_c_in)
flux JC_c[z] = -F_cold/V*C_c[z], high = -F_cold/V*T_mix
eq d/dt H_a[z] = -div(JH_a[z]) - UA_a*(H_a[z] - C_a[z])/(rho_cp*V)    for z
eq d/dt C_a[z] = -div(JC_a[z]) + UA_a*(H_a[z] - C_a[z])/(rho_cp*V)    for z
eq d/dt H_b[z] = -div(JH_b[z]) - UA_b*(H_b[z] - C_b[z])/(rho_cp*V)    for z
eq d/dt C_b[z] = -div(JC_b[z]) + UA_b*(H_b[z] - C_b[z])/(rho_cp*V)    for z
eq d/dt H_c[z] = -div(JH_c[z]) - UA_c*(H_c[z] - C_c[z])/(rho_cp*V)    for z
eq d/dt C_c[z] = -div(JC_c[z]) + UA_c*(H_c[z] - C_c[z])/(rho_cp*V)    for z
observe T_out : degC = celsius(C_c[z.first]) in 0..150, T_a : degC = celsius(H_a[z.last]) in 0..150, T_b : degC = celsius(H_b[z.last]) in 0..150
episode { step = 0.02 [h], max_steps = 50 }
