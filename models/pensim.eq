model PenSim "Fed-batch penicillin fermentation: six feeds set every twelve minutes, yield of 230 hours"

# S. Goldrick et al., Journal of Biotechnology 193 (2015) 70-82 (IndPenSim); biomass regions and vacuoles after
# G. C. Paul and C. R. Thomas, Biotechnology and Bioengineering 51 (1996) 558-572.
# A dagger after a text marks a constant whose equation does not balance: there the unit is taken off and put on.

time t : h

choice paa_schedule = hours | minutes    "feed of phenylacetic acid before step 50; minutes: a table in hours read in minutes"
choice disturbances = true | false       "eight parameters follow a filtered noise"

# ---- Parameters drawn for each batch ----

random zeta_1 ~ normal(0, 1)    "shared by the inoculum and its growth rate"

param c_0        : g/L  = 0.5    ~ 0.5 + 0.05*zeta_1        "biomass at the start"
param mux_max    : 1/h  = 0.41   ~ 0.41 + 0.025*zeta_1      "largest specific growth rate"
param mu_p       : 1/h  = 0.041  ~ normal(0.041, 0.0025)    "largest specific rate of penicillin formation"
param alpha_kla  : 1/h  = 85     ~ normal(85, 10)           "factor of the oxygen transfer coefficient †"
param PAA_c      : mg/L = 530000 ~ normal(530000, 20000)    "phenylacetic acid in its feed"
param N_conc_paa : mg/L = 150000 ~ normal(150000, 2000)     "nitrogen in the phenylacetic acid feed"

# ---- Growth, vacuoles, product ----

param ratio_branch           = 0.4           "branching rate over extension rate"
param mu_v         : g/(L h) = 1.71e-4       "rate of vacuole formation"
param mu_a         : 1/h     = 3.5e-3        "rate of autolysis"
param mu_diff      : 1/h     = 5.36e-3       "rate of differentiation †"
param K_b          : g/L     = 0.05          "saturation of branching and of maintenance in a1"
param K_e          : g/L     = 0.009         "saturation of extension"
param K_vac        : g/L     = 0.05          "saturation of vacuole formation"
param K_diff0      : g/L     = 0.75          "differentiation constant of a young culture"
param K_diff_min   : g/L     = 0.09          "its floor"
param beta_1       : g/(L h) = 0.006         "its decrease with age"
param S_opt        : g/L     = 0.002         "substrate concentration of fastest product formation"
param S_width      : g/L     = 0.0015        "width of that optimum"
param k_S                    = 2.5           "factor of that optimum"
param dr           : cm      = 0.75e-4       "width of a vacuole size class"
param r_0          : cm      = 1.5e-4        "radius of the first class"
param delta_0      : cm      = 1e-4          "radius offset of a newborn vacuole"
param k_v          : cm/h    = 3.22e-5       "growth of the vacuole radius; of newborn ones as a rate †"
param D_v          : cm^2/h  = 2.66e-11      "dispersion of the vacuole radius"
param rho_a0       : g/cm^3  = 0.35          "density of the hyphae"
param rho_d        : g/cm^3  = 0.18          "density of the degenerated region"
param Y_sX         : g/g     = 1.85          "substrate per biomass"
param Y_sP         : g/g     = 0.9           "substrate per penicillin"
param m_s          : g/(g h) = 0.029         "maintenance †"
param B_1                    = -64.29        "hydrolysis of penicillin"
param B_2                    = -1.825        "hydrolysis: pH"
param B_3          : 1/K     = 0.3649        "hydrolysis: temperature"
param B_4                    = 0.1280        "hydrolysis: pH squared"
param B_5          : 1/K^2   = -4.9496e-4    "hydrolysis: temperature squared"

# ---- Inhibition ----

param DO_frac_X         = 0.1                      "critical oxygen saturation for growth"
param DO_frac_P         = 0.3                      "critical oxygen saturation for penicillin"
param N_crit     : mg/L = 150                      "critical nitrogen"
param PAA_crit_X : mg/L = 2400                     "phenylacetic acid that stops growth"
param PAA_crit_P : mg/L = 200                      "phenylacetic acid that penicillin needs"
param CO2_crit   : ug/L = 7570                     "dissolved CO2 that stops growth"
param k_sw       : L/mg = 1                        "steepness of the switches"
param k_sw_CO2   : L/ug = value(k_sw) as [L/ug]    "steepness of the switch by CO2"

# ---- Feeds ----

param c_s0       : g/L    = 600     "sugar in the sugar feed"
param c_oil0     : g/L    = 1000    "substrate in the oil feed"
param rho_sugar  : kg/m^3 = 1540    "density of sugar"
param rho_oil    : kg/m^3 = 900     "density of oil"
param rho_w      : kg/m^3 = 1000    "density of water"
param rho_paa    : kg/m^3 = 1000    "density of the phenylacetic acid feed"
param Fpaa_start : L/h    = 5       "phenylacetic acid feed of steps 1 to 25, schedule hours"

# ---- Oxygen and CO2 ----

param Y_O2X    : mg/g        = 650              "oxygen per biomass"
param Y_O2P    : mg/g        = 160              "oxygen per penicillin"
param m_O2X    : mg/(g h)    = 17.5             "oxygen for maintenance"
param a_kla                  = 0.38             "exponent of the gas velocity"
param b_kla                  = 0.34             "exponent of the power"
param c_kla                  = -0.38            "exponent of the viscosity"
param d_kla                  = 0.25             "exponent of the oil"
param H_O2     : bar L/mg    = 0.0251           "Henry constant of oxygen"
param eps_gas                = 0.1              "gas hold-up"
param r_tank   : m           = 2.1              "radius of the vessel"
param r_imp    : m           = 0.85             "radius of an impeller"
param n_imp                  = 3                "number of impellers"
param Po                     = 5                "power number"
param RPM      : 1/min       = 100              "stirrer speed"
param g_bar    : bar m^2/kg  = 9.81e-5          "gravity"
param R_gas    : J/(mol K)   = 8.314            "gas constant"
param V_mol    : m^3/kmol    = 22.4             "molar volume of a gas"
param q_CO2    : %/h         = 0.1353           "CO2 formation †"
param CO2_in   : %           = 0.033            "CO2 in the air"
param delta_c0               = 0.89             "CO2 transfer over O2 transfer"
param O2_in0                 = 0.21             "oxygen in the air"
param N2_in                  = 0.79             "nitrogen in the air"
param c_O2     : g s/(m^3 h) = 60000*32/22.4    "oxygen of an air flow †"
param c_CO2    : g s/(m^3 h) = 60000*44/22.4    "CO2 of an air flow †"
param rho_air  : g/m^3       = 28970/22.4       "density of air †"

# ---- Heat ----

param T_feed    : K            = 288        "temperature of the sugar feed"
param T_w       : K            = 288        "temperature of the water"
param T_cin0    : K            = 285        "coolant inlet"
param T_hot     : K            = 333        "heating water inlet"
param T_air     : K            = 290        "surroundings"
param T_ref     : K            = 273        "melting point of water"
param T_vap     : K            = 373        "boiling point of water"
param C_ps      : kJ/(kg K)    = 5.9        "heat capacity of the feed"
param C_pw      : kJ/(kg K)    = 4.18       "heat capacity of water and broth †"
param dH_evap   : kJ/kg        = 2430.7     "heat of evaporation"
param U_jacket  : kJ/(h m^2 K) = 36         "heat loss coefficient"
param A_jacket  : m^2          = 105        "heat loss area"
param E_g       : J/mol        = 14880      "activation energy of growth"
param E_d       : J/mol        = 173250     "activation energy of thermal death"
param k_g                      = 450        "factor of growth"
param k_d                      = 2.5e29     "factor of thermal death"
param Y_QX      : kJ/g         = 25         "heat per oxygen taken up"
param alpha_1                  = 2451.8     "jacket factor †"
param beta_T                   = 2.88       "jacket exponent"
param alpha_evp : 1/h          = 5.24e-4    "evaporation factor"
param beta_evp                 = 2.5        "evaporation exponent"

# ---- pH, nitrogen, phenylacetic acid, viscosity ----

param abc0       : mol/L     = 0.033        "concentration of acid and of base"
param gamma_1    : mol/g     = 0.0325e-5    "acid made by growth"
param gamma_2    : mol/L^2   = 2.5e-11      "acid brought by the flows"
param m_pH       : 1/h       = 0.0025       "acid made by maintenance"
param K_pH1      : mol/L     = 1e-5         "pH optimum of growth, acid side"
param K_pH2      : mol/L     = 2.5e-8       "pH optimum of growth, basic side"
param K_w        : mol^2/L^2 = 1e-14        "ion product of water"
param h_ode      : h         = 0.005        "duration of ion addition; a constant of the model"
param k_pH       : 1/h       = 1            "relaxation rate of H"
param N_conc_oil : mg/L      = 20000        "nitrogen in oil"
param Y_NX       : mg/g      = 10           "nitrogen per biomass"
param Y_NP       : mg/g      = 80           "nitrogen per penicillin"
param m_N        : mg/(g h)  = 0.03         "nitrogen for maintenance"
param Y_PAAP     : mg/g      = 187.5        "phenylacetic acid per penicillin"
param Y_PAAX     : mg/g      = 45           "phenylacetic acid per biomass"
param m_PAA      : mg/(g h)  = 1.05         "phenylacetic acid for maintenance"
param visc_gain  : cP/h      = 3            "rise of viscosity †"
param visc_exp               = 1/3          "exponent of the biomass in the viscosity equation"
param k_1        : 1/h       = 0.001        "slope of the first logistic term"
param k_2        : 1/h       = 0.0001       "slope of the second"
param t_1        : h         = 1            "midpoint of the first logistic term"
param t_2        : h         = 250          "midpoint of the second"
param k_3        : cP/L      = 0.005        "dilution of viscosity by water"
param visc_crit  : cP        = 4            "threshold of the effective viscosity"

# ---- Inputs ----

action discharge : kg/h    = 0    in 0..4100     "broth taken out"
action Fs        : L/h     = 8    in 7..151      "sugar feed"
action Foil      : L/h     = 22   in 21..36      "soybean oil feed"
action Fg        : m^3/min = 30   in 29..76      "aeration"
action pressure  : bar     = 0.6  in 0.5..1.2    "head pressure above 1 bar"
action Fw        : L/h     = 0    in 0..510      "water"

disturbance z = 0 ~ 0.995*z + 0.005*normal(0, 1)    "filtered noise of eight parameters"

# ---- States ----

set class = 1..9

state S    : g/L   = 1                      ~ normal(1, 0.1)          in 0..inf  scale 1e-3    "substrate, sugar and oil"
state DO2  : mg/L  = 15                     ~ normal(15, 0.5)         in 0..inf  scale 10      "dissolved oxygen"
state O2           = 0.20                   ~ normal(0.20, 0.05)      in 0..inf  scale 0.2     "oxygen fraction in the off-gas"
state P    : g/L   = 0                                                in 0..inf  scale 1e-3    "penicillin"
state V    : L     = 58000                  ~ normal(58000, 500)      in 0..inf  scale 6e4     "broth volume"
state Wt   : kg    = 62000                  ~ normal(62000, 500)      in 0..inf  scale 6e4     "broth weight"
state H    : mol/L = 10^(-6.5)              ~ 10^(-normal(6.5, 0.1))  in 0..inf  scale 1e-7    "hydrogen ions"
state T    : K     = 297                    ~ normal(297, 0.5)        in 0..inf  scale 300     "temperature"
state Q    : kJ    = 0                                                in 0..inf  scale 1e5     "integral of the heat balance"
state visc : cP    = 4                                                in 0..inf  scale 10      "viscosity"
state age  : g h/L = 0                                                in 0..inf  scale 1       "integral of the biomass"
state a0   : g/L   = c_0*0.3333333333333333                           in 0..inf  scale 0.1     "growing region, tips"
state a1   : g/L   = c_0*0.6666666666666666                           in 0..inf  scale 0.1     "non-growing region"
state a3   : g/L   = 0                                                in 0..inf  scale 1e-3    "degenerated region"
state a4   : g/L   = 0                                                in 0..inf  scale 1e-3    "autolysed region"
state n0   : 1/L   = 0                                                in 0..inf  scale 1e3     "number density of newborn vacuoles †"
state nv[class] named "n{}" : 1/(cm L) = 0 in 0..inf scale 1e3    "number densities of vacuoles by size"
state nm      : 1/(cm L) = 0                             in 0..inf  scale 1e3     "number density of the largest vacuoles †"
state phi0    : cm^3/L   = 0                             in 0..inf  scale 1e-5    "volume of newborn vacuoles"
state CO2out  : %        = 0.038 ~ normal(0.038, 0.001)  in 0..inf  scale 0.1     "CO2 in the off-gas"
state CO2d    : mg/L     = 0                             in 0..inf  scale 0.1     "dissolved CO2"
state PAA     : mg/L     = 1400  ~ normal(1400, 50)      in 0..inf  scale 1e3     "phenylacetic acid"
state NH3     : mg/L     = 1700  ~ normal(1700, 50)      in 0..inf  scale 1e3     "ammonia nitrogen"
state int_mup            = 0                             in 0..inf  scale 1e-2    "integral of the product rate over the step"
state int_mue            = 0                             in 0..inf  scale 1e-2    "integral of the growth rate over the step"

# ---- Disturbed parameters ----

let mux     : 1/h   = if mux_ratchet > 0 then mux_ratchet else mux_max    "largest growth rate in force"
let mu_p_d  : 1/h   = mu_p + 0.03 [1/h] * z
let mux_d   : 1/h   = mux + 0.25 [1/h] * z
let c_s_d   : g/L   = c_s0 + 1500 [g/L] * z
let c_oil_d : g/L   = c_oil0 + 300 [g/L] * z
let abc_d   : mol/L = abc0 + 0.2 [mol/L] * z
let PAA_c_d : mg/L  = PAA_c + 300000 [mg/L] * z
let T_cin_d : K     = T_cin0 + 100 [K] * z
let O2_in_d : 1     = O2_in0 + 0.02 * z

# ---- Broth, pressure, dilution ----

let water : L/h    = max(Fw, 0 [L/h])                                                     "water, never negative"
let X     : g/L    = a0 + a1 + a3 + a4                                                    "total biomass"
let rho_b : kg/m^3 = 1100 [kg/m^3] + P + X                                                "density of the broth"
let rho_f : kg/m^3 = c_s_d/1000 [g/L] * rho_sugar + (1 - c_s_d/1000 [g/L]) * rho_w        "density of the sugar feed"
let A_v   : m^2    = pi * r_tank^2                                                        "cross-section"
let V_m   : m^3    = V                                                                    "volume"
let h_b   : m      = (1 - eps_gas) * V_m / A_v                                            "liquid height"
let p_top : bar    = 1 [bar] + pressure                                                   "pressure above the broth"
let p_bot : bar    = p_top + g_bar * rho_b * h_b                                          "pressure at the bottom"
let p_lm  : bar    = (p_bot - p_top) / ln(p_bot/p_top)                                    "log-mean pressure"
let F_evp : L/h    = alpha_evp * V * (exp(beta_evp * (T - T_ref)/(T_vap - T_ref)) - 1)    "evaporation"
let F_dil : L/h    = Fs + Fb + Fa + water - F_evp + Fpaa                                  "diluting flow, without oil"
let k_dil : 1/h    = F_dil / V                                                            "dilution rate"

# ---- Inhibition ----

def passed(x) = (1 + tanh(x)) / 2

let pH     : 1    = -log10(H / 1 [mol/L])
let DO_sat : mg/L = p_lm * O2_in_d / H_O2                                      "oxygen saturation"
let f_pH   : 1    = 1 / (1 + H/K_pH1 + K_pH2/H)
let f_N    : 1    = passed(k_sw * (NH3 - N_crit))
let f_T    : 1    = k_g * exp(-E_g/(R_gas*T)) - k_d * exp(-E_d/(R_gas*T))
let f_CO2  : 1    = passed(k_sw_CO2 * (CO2_crit - CO2d))
let f_O2X  : 1    = passed(k_sw * (DO2 - DO_frac_X*DO_sat))
let f_O2P  : 1    = passed(k_sw * (DO2 - DO_frac_P*DO_sat))
let f_PAAX : 1    = passed(k_sw * (PAA_crit_X - PAA))
let f_PAAP : 1    = passed(k_sw * (PAA - PAA_crit_P))
let f_S    : 1    = k_S/sqrt(2*pi) * exp(-sq((S - S_opt)/S_width)/2)
let mu_h   : 1/h  = exp(B_1 + B_2*pH + B_3*T + B_4*pH^2 + B_5*T^2) as [1/h]    "hydrolysis"

# ---- Growth and differentiation ----

let mu_e   : 1/h     = mux_d * f_pH * f_N * f_T * f_O2X * f_CO2 * f_PAAX    "extension rate"
let mu_b   : 1/h     = ratio_branch * mu_e                                  "branching rate"
let r_b    : g/(L h) = mu_b * a1 * S/(K_b + S)                              "branching"
let r_e    : g/(L h) = mu_e * a0 * S/(K_e + S)                              "extension"
let K_diff : g/L     = max(K_diff0 - beta_1*age/X, K_diff_min)              "differentiation constant"
let r_d    : g/(L h) = (value(mu_diff) as [g/(L h)]) * a0/(K_diff + S)      "differentiation †"
let r_m0   : g/(L h) = (value(m_s) as [g/(L h)]) * a0/(K_diff + S)          "substrate for maintenance of a0 †"
let r_a    : g/(L h) = mu_a * a3                                            "autolysis"

# ---- Vacuoles and penicillin ----

let v_2   : cm^3/L     = phi0 + sum(4*pi/3 * (r_0 + (j - 1)*dr)^3 * nv[j] * dr for j in class)    "vacuole volume"
let v_a1  : cm^3/L     = (a1/rho_a0 - v_2) / 2                                                    "active volume of a1"
let r_s   : g/(L h)    = mu_p_d * rho_a0 * v_a1 * f_S * f_O2P * f_PAAP                            "penicillin made"
let r_P   : g/(L h)    = r_s - mu_h*P                                                             "penicillin net of hydrolysis"
let r_m1  : g/(L h)    = m_s * rho_a0 * v_a1 * S/(K_vac + S)                                      "substrate for maintenance of a1"
let g_v   : cm^3/(L h) = mu_v * v_a1 / (K_vac + S)                                                "new vacuole volume"
let r_k   : cm         = r_0 + 8*dr
let r_m   : cm         = r_0 + 10*dr
let r_deg : g/(L h)    = pi/6 * (r_k + r_m)^3 * rho_d * k_v * nv[9]                               "degeneration"

let k_v0 = value(k_v) as [1/h]    # †
def size_class(below, own, above) = -k_v*(above - below)/(2*dr) + D_v*(above - 2*own + below)/dr^2

eq d/dt n0    = g_v * 6/pi / (r_0 + delta_0)^3 - k_v0*n0
eq d/dt nv[1] = size_class(value(n0) as [1/(cm L)], nv[1], nv[2])    # †
eq d/dt nv[j] = size_class(nv[j-1], nv[j], nv[j+1])    for j in 2..8
eq d/dt nv[9] = size_class(nv[8], nv[9], nm)
eq d/dt nm    = k_v * der(nv[9]) / (r_m - r_k) * 1 [h] - mu_a*nm    # †, the derivative where nv[9] was meant
eq d/dt phi0  = g_v - k_v0*n0 * pi*(r_0 + delta_0)^3/6

# ---- Biomass, product, volume, weight ----

eq d/dt a0 = r_b - r_d - k_dil*a0
eq d/dt a1 = r_e - r_b + r_d - r_deg - k_dil*a1
eq d/dt a3 = r_deg - r_a - k_dil*a3
eq d/dt a4 = r_a - k_dil*a4
let dX : g/(L h) = der(a0) + der(a1) + der(a3) + der(a4)

eq d/dt P   = r_P - k_dil*P
eq d/dt age = X
eq d/dt V   = F_dil - discharge/rho_b
eq d/dt Wt  = Fs*rho_f + Foil*rho_oil + (Fb + Fa + water - F_evp) * 1 [kg/L] + Fpaa*rho_paa - discharge
eq d/dt S   = -Y_sX*(r_e + r_b) - r_m0 - r_m1 - Y_sP*r_s + (Fs*c_s_d + Foil*c_oil_d)/V - k_dil*S

# What oxygen, heat, nitrogen and phenylacetic acid are charged with, dilution included.
let dX_charged : g/(L h) = dX
let dP_charged : g/(L h) = der(P)

# ---- Viscosity ----

let visc_e : cP = if visc <= visc_crit then 1 [cP] else visc    "effective viscosity"
eq d/dt visc = visc_gain * value(a0)^visc_exp / ((1 + exp(-k_1*(t - t_1))) * (1 + exp(-k_2*(t - t_2)))) - k_3*water    # †

# ---- Oxygen and CO2 ----

let q_g   : m^3/s = Fg                                                             "aeration"
let N_s   : 1/s   = RPM                                                            "stirrer speed"
let D_imp : m     = 2*r_imp                                                        "diameter of an impeller"
let P_u   : W     = n_imp * Po * rho_b * N_s^3 * D_imp^5                           "power without air"
let P_g   : kW    = (0.706*(value(P_u)^2*value(N_s)*value(D_imp)^3/value(q_g)^0.56)^0.45) as [W]    "power with air †"
let v_s   : m/s   = q_g / A_v                                                      "superficial gas velocity"
let P_air : kW    = v_s*R_gas*T*V_m/(V_mol*h_b) * ln(1 + g_bar*rho_b*h_b/p_top)    "power of the air"
let P_t   : kW    = P_g + P_air                                                    "total power"
let kLa : 1/h = alpha_kla * value(v_s)^a_kla * (value(P_t)/value(V_m))^b_kla
                * (value(visc_e)/100)^c_kla * (1 - (value(Foil)/value(V))^d_kla)    "oxygen transfer coefficient †"
let OTR   : mg/(L h)   = kLa * (DO_sat - DO2)                                             "oxygen transfer"
let V_g   : m^3        = eps_gas * V_m                                                    "gas volume"
let H_CO2 : bar % L/mg = (exp(11.25 - 395.9 [K]/(T - 175.9 [K]))/4400) as [bar % L/mg]    "Henry constant of CO2"

eq d/dt DO2    = -Y_O2X*dX_charged - m_O2X*X - Y_O2P*dP_charged + OTR - k_dil*DO2
eq d/dt O2     = (c_O2*q_g*O2_in_d - c_O2*q_g*(N2_in/(1 - O2 - CO2out))*O2 - 0.06*OTR*V_m) / (V_g*rho_air)
eq d/dt CO2out = (c_CO2*q_g*CO2_in + q_CO2*V*(a0 + a1) - c_CO2*q_g*CO2out) / (V_g*rho_air)
eq d/dt CO2d   = delta_c0*kLa*(p_lm*CO2out/H_CO2 - CO2d) - k_dil*CO2d

# ---- Phenylacetic acid and nitrogen ----

eq d/dt PAA = Fpaa*PAA_c_d/V - Y_PAAP*dP_charged - Y_PAAX*dX_charged - m_PAA*P - k_dil*PAA
eq d/dt NH3 = (N_conc_paa*Fpaa + N_conc_oil*Foil)/V - Y_NX*(r_b + r_e + r_d + r_a) - Y_NP*dP_charged - m_N*X - k_dil*NH3

# ---- Balances of the whole broth ----

let harvest   = discharge/rho_b
let precursor = PAA + Y_PAAP*P + Y_PAAX*X

# Dilution takes away what was built in, and the original does not charge for that much: a third of what the recipe feeds. `gross_uptake` closes the balance.
let invented = Y_PAAP*(r_P - dP_charged) + Y_PAAX*(r_e - dX_charged)

invariant biomass   = V*X rate V*r_e - harvest*X            "regions only turn into each other"
invariant precursor = V*precursor rate Fpaa*PAA_c_d - V*m_PAA*P - harvest*precursor + V*invented    "phenylacetic acid, free and built in; what dilution invents counts as a source (none with `gross_uptake`)"
invariant vacuoles  = phi0 - n0 * pi*(r_0 + delta_0)^3/6    "newborn vacuoles: their volume is their number times that of one"

# ---- pH ----

let charge : mol/L = H    "what the balance of ions counts"
let ions   : L     = V + (Fa + Fb)*h_ode
let B      : mol/L = -(charge*V + abc_d*(Fa - Fb)*h_ode) / ions
let g_H : mol/(L h) = gamma_1*(r_b + r_e + r_a + r_d + m_pH*X + r_P)
                      + gamma_2*(Fs + Foil + Fb + Fa - discharge/1 [kg/L] + water)    "acid made and brought"
eq d/dt H = g_H + k_pH*((-B + sqrt(sq(B) + 4*K_w))/2 - H)

# ---- Heat ----

def jacket(F, T_i) = (alpha_1/1000 * value(F)^(beta_T + 1) * (value(T) - value(T_i))
                      / (value(F)/1000 + alpha_1*(value(F)/1000)^beta_T/2 * value(rho_b)*value(C_ps))) as [kJ/h]    # †

let Q_r : kJ/h = max(0 [kJ/h], Y_QX*V_m*(Y_O2X*dX_charged + Y_O2P*dP_charged))    "heat of respiration"
eq d/dt Q = Fs*rho_f*C_ps*(T_feed - T) + water*rho_w*C_pw*(T_w - T)
            - F_evp*rho_b*C_pw * 1 [K] - dH_evap*F_evp*rho_w + Q_r + (value(P_t) as [kJ/h])    # † twice
            - jacket(Fc, T_cin_d) - jacket(Fh, T_hot) - U_jacket*A_jacket*(T - T_air)
eq d/dt T = der(Q) / (V_m*C_pw*rho_b)

# ---- Integrals over the step ----

eq d/dt int_mup = mu_p_d
eq d/dt int_mue = mu_e
at start { reset int_mup = 0; reset int_mue = 0 }

# ---- Inner controllers, in velocity form ----

discrete Fa   : L/h = 0    "acid"
discrete Fb   : L/h = 0    "base"
discrete Fc   : L/h = 0    "cooling water"
discrete Fh   : L/h = 0    "heating water"
discrete Fpaa : L/h = 0    "phenylacetic acid feed"

discrete k            = 0      "present step"
discrete pH_1         = pH     "pH one sample ago"
discrete pH_2         = pH     "pH two samples ago"
discrete T_1   : K    = T      "temperature one sample ago"
discrete T_2   : K    = T      "temperature two samples ago"
discrete PAA_1 : mg/L = PAA    "phenylacetic acid one sample ago"

def pid(last, error, change, curvature, gain, T_i, T_d, high) =
    clip(last + gain*(change + error*step/T_i - T_d/step*curvature), 0 [L/h], high)

# In steps 1 and 2 the memory holds the present value.
let pH_a = if n < 2 then pH else pH_1
let pH_b = if n < 2 then pH else pH_2
let T_a  = if n < 2 then T else T_1
let T_b  = if n < 2 then T else T_2

let pH_error  = 6.5 - pH
let pH_change = if n < 2 then 0 else 6.5 - pH + pH_a    # the old error lacks the set-point
let pH_bend   = pH - 2*pH_a + pH_b
let base      = pid(Fb, pH_error, pH_change, pH_bend, 0.08 [L/h], 4e-5 [h], 8 [h], 225 [L/h])
let acid      = pid(Fa, pH_error, pH_change, pH_bend, 0.08 [L/h], 12.5 [h], 0.125 [h], 225 [L/h])

let T_error      = 298 [K] - T
let T_bend       = T - 2*T_a + T_b
let heating_from = Fc    # the heating controller starts from the cooling flow
let cooling      = pid(Fc, T_error, T_a - T, T_bend, -300 [L/(h K)], 1.6 [h], 0.005 [h], 1500 [L/h])
let heating      = pid(heating_from, T_error, T_a - T, T_bend, 50 [L/(h K)], 0.05 [h], 1 [h], 1500 [L/h])

let PAA_fed       = pid(Fpaa, 1200 [mg/L] - PAA, PAA_1 - PAA, 0 [mg/L], 0.1 [L^2/(mg h)], 0.5 [h], 0 [h], 150 [L/h])
let PAA_scheduled = if n < 25 then Fpaa_start else 0

table Fpaa_minutes : L/h over time : min from { 0: 5, 40: 0, 200: 10, 230: 4 }
when paa_schedule = minutes { let PAA_scheduled = Fpaa_minutes((n + 1)*step) }

at start {
  next k     = n + 1
  next Fb    = if pH_error >= -0.05 then base else 0.5*Fb
  next Fa    = if pH_error >= -0.05 then 0 [L/h] else acid
  next Fc    = max(if T_error <= 0.05 [K] then cooling else 0.3*Fc, 1e-4 [L/h])
  next Fh    = max(if T_error <= 0.05 [K] then 0.1*Fh else heating, 1e-4 [L/h])
  next Fpaa  = if n < 49 then PAA_scheduled else PAA_fed
  next pH_1  = pH
  next pH_2  = pH_a
  next T_1   = T
  next T_2   = T_a
  next PAA_1 = PAA
}

# ---- Ratchet: growth that has fallen in 63 of 64 steps does not come back ----

discrete c1                = 1000    "differences of int_mue after the last one that was not negative"
discrete c2                = 1000    "differences of int_mue after the last but one that was not negative"
discrete mue_1             = 0       "int_mue one step ago"
discrete mux_ratchet : 1/h = 0       "growth rate that the ratchet has set, 0 before it fires"

let falling = int_mue < mue_1
let c1_next = if n < 2 then c1 else if falling then c1 + 1 else 0
let c2_next = if n < 2 then c2 else if falling then c2 + 1 else c1 + 1

at start {
  next mue_1       = int_mue
  next c1          = c1_next
  next c2          = c2_next
  next mux_ratchet = if n >= 65 and c2_next >= 64 then 5 [1/h] * int_mue else mux_ratchet
}

# ---- Clamps: DO2 has one of its own, above that of the others ----

at end {
  clamp S at 0.001 when S <= 0
  clamp P at 0.001 when P <= 1e-9 [g/L]
  clamp x at 0.001 when x <= 0 for x in (O2, V, Wt, H, T, Q, visc, age, CO2out, CO2d, PAA, NH3)
  clamp x at 0 when x < 0 for x in (a0, a1, a3, a4, n0, nm, phi0)
  clamp nv[j] at 0 when nv[j] < 0 for j in class
  clamp DO2 at 1 when DO2 < 2 [mg/L]
}

# ---- Observations, rewards, ends ----

observe time : h = k*step in 0..552, pH in 0..16.10523, T in 118.98977..725.6828
observe Fa in 0..13.717274, Fb in 0..540, Fc in 0..3600.0002, Fh in 0..1892.07874, Wt in 25003.258..253840.11, DO2 in 0..47.898834

level online extends default "with the analysis of the off-gas" {
  observe O2 in 0..1, CO2out in 0..100
}

level laboratory extends online "with penicillin, precursor, ammonia and viscosity of a sample every twelve hours, four hours late" {
  observe P every 60 delay 20 noise normal(0, 0.2), PAA every 60 delay 20 noise normal(0, 20)
  observe NH3 every 60 delay 20 noise normal(0, 20), visc every 60 delay 20 noise normal(0, 0.5)
}

let inventory_before        = previous(V*P)
let harvest_density  : kg/L = 1    "a mass flow times a concentration per litre, as the original counts"
let gain                    = V*P - inventory_before + discharge/harvest_density * P * step

reward yield : kg default = gain                 "penicillin gained in the step"
reward yield_clipped : kg = max(gain, 0 [kg])    "what the data set records"

fail observation_box when outside bounds(observations)
fail state_domain when H < 1e-14 [mol/L] or H > 1 [mol/L] or V <= 0 or a0 <= 0 or X <= 0 or O2 + CO2out >= 1
    or T <= 175.9 [K] or S <= -K_vac
fail reward_floor when reward <= -100

# `auto` keeps the states of whole random episodes within 1e-7 of their ranges: `python -m smpl.bench episodes`.
episode { step = 0.2 [h], max_steps = 1150, error_reward = -100, end_is_success = true, failure_pays_alone = true }
solver  { method = auto, rtol = 1e-8, safety = 0.3 }    # the switch by CO2 turns errors of 1e-6 into some of 1e-3

# ---- Recipe: a value holds until its time; the middle of a step says in which interval it lies ----

table discharge_recipe : kg/h over time : h until {
  100: 0, 102: 4000, 130: 0, 132: 4000, 150: 0, 152: 4000, 170: 0, 172: 4000, 190: 0, 192: 4000, 210: 0, 212: 4000, 230: 0
}
table Fs_recipe : L/h over time : h until {
  3: 8, 12: 15, 16: 30, 20: 75, 24: 150, 28: 30, 32: 37, 36: 43, 40: 47, 44: 51, 48: 57
  52: 61, 56: 65, 60: 72, 64: 76, 68: 80, 72: 84, 76: 90, 80: 116, 160: 90, 230: 80
}
table Foil_recipe : L/h over time : h until { 4: 22, 16: 30, 56: 35, 60: 34, 64: 33, 68: 32, 72: 31, 76: 30, 80: 29, 230: 23 }
table Fg_recipe : m^3/min over time : h until { 8: 30, 20: 42, 40: 55, 90: 60, 200: 75, 230: 65 }
table pressure_recipe : bar over time : h until { 12.4: 0.6, 25: 0.7, 30: 0.8, 40: 0.9, 100: 1.1, 150: 1, 200: 0.9, 230: 0.9 }
table Fw_recipe : L/h over time : h until { 50: 0, 75: 500, 150: 100, 160: 0, 170: 400, 200: 150, 230: 250 }

let middle = (n + 0.5)*step

policy nominal "recipe" {
  discharge = discharge_recipe(middle)
  Fs = Fs_recipe(middle)
  Foil = Foil_recipe(middle)
  Fg = Fg_recipe(middle)
  pressure = pressure_recipe(middle)
  Fw = Fw_recipe(middle)
}

when disturbances = false { disturbance z = 0 ~ 0 }

# ---- Repairs, one change at a time ----

variant vacuole_flux "the largest vacuoles grow by n9, in place of its derivative" {
  eq d/dt nm = k_v * nv[9] / (r_m - r_k) - mu_a*nm
}
variant oil_volume "oil dilutes too" { let F_dil : L/h = Fs + Fb + Fa + water - F_evp + Fpaa + Foil }
variant gross_uptake "oxygen, heat, nitrogen and acid are charged with what is made, not with its dilution" {
  let dX_charged : g/(L h) = dX + k_dil*X
  let dP_charged : g/(L h) = r_P
}
variant aerated_height "gas raises the broth"             { let h_b : m = V_m / A_v / (1 - eps_gas) }
variant net_charge "the balance of ions counts hydroxide" { let charge : mol/L = H - K_w/H }
variant viscosity_floor "continuous effective viscosity"  { let visc_e : cP = max(visc, 1 [cP]) }
variant harvest_volume "the harvest is credited by its volume" { let harvest_density : kg/L = rho_b }
variant pid_setpoint "the old pH error has its set-point"      { let pH_change = pH_a - pH }
variant pid_heating "the heating controller starts from the heating flow" { let heating_from = Fh }
variant clamp_zero "substrate and penicillin are clamped to 0" {
  at end { clamp S at 0 when S <= 0; clamp P at 0 when P <= 0 }
}

# ---- Behaviour of the original, for the scenario legacy ----

variant long_step "each step integrates 0.2 h and h_ode" { episode { integrate = 0.205 [h] } }
variant basic_branch "another balance of ions beyond pH 7" {
  let hydroxide = K_w/H - H
  let B_basic   = -(hydroxide*V - abc_d*(Fa - Fb)*h_ode) / ions
  eq d/dt H = if pH < 7 then g_H + k_pH*((-B + sqrt(sq(B) + 4*K_w))/2 - H)
              else -g_H + k_pH*((-B_basic - sqrt(sq(B_basic) + 4*K_w))/2 - hydroxide)
}
variant original_report "constants at reset, the clock one step behind, the logarithm of the pH in the last step, no initial inventory" {
  observe time : h = if k == 0 then 0.2 [h] else (k - 1)*step in 0..552
  observe pH = if k == 0 then 6.5 else if k == 1150 then -log10(pH) else pH in 0..16.10523
  observe T : K = if k == 0 then 300 [K] else T in 118.98977..725.6828
  observe Fa : L/h = if k == 0 then 0 [L/h] else Fa in 0..13.717274
  observe Fb : L/h = if k == 0 then 10.828493 [L/h] else Fb in 0..540
  observe Fc : L/h = if k == 0 then 0.0001 [L/h] else Fc in 0..3600.0002
  observe Fh : L/h = if k == 0 then 150 [L/h] else Fh in 0..1892.07874
  observe Wt : kg = if k == 0 then 62500 [kg] else Wt in 25003.258..253840.11
  observe DO2 : mg/L = if k == 0 then 14.75 [mg/L] else DO2 in 0..47.898834
  let inventory_before = if previous(k) == 0 then 0 [kg] else previous(V*P)
}

# ---- The plant's world: what else changes, each alone or together ----

variant fouling "the jacket fouls, faster in some batches than in others" {
  param alpha_clean = 2451.8    "jacket factor of the clean jacket †"
  random foulness ~ uniform(0.5, 1.5)
  disturbance fouled = 0 ~ min(fouled + 0.0003*foulness, 0.5)    "share of the jacket factor that is lost"
  let alpha_1 = alpha_clean * (1 - fouled)    "jacket factor †"
}
variant sensor_bias "the probes of pH and dissolved oxygen have offsets; that of pH drifts" {
  random offset_pH  ~ normal(0, 1)
  random offset_DO2 ~ normal(0, 1)
  disturbance drift_pH = 0 ~ drift_pH + 0.0005*normal(0, 1)    "drift of the pH probe"
  observe pH = pH + 0.02*offset_pH + drift_pH in 0..16.10523
  observe DO2 : mg/L = DO2 + offset_DO2*0.2 [mg/L] in 0..47.898834
}
