model TennesseeEastman "Tennessee Eastman process: reactor, condenser, separator, recycle compressor, stripper; gases A, C, D, E to liquids G, H"

# J. J. Downs, E. F. Vogel, A plant-wide industrial process control problem, Computers and Chemical Engineering 17 (1993) 245-255,
# and the program of the authors, teprob.f. The 19 loops are those of temain_mod.f (J. Lyman, C. Georgakis 1995; E. L. Russell,
# L. H. Chiang, R. D. Braatz 2000). The program counts in feet, pounds, mmHg and Btu: constants have its numbers, and the
# conversion factors of the first section have its rounding. A dagger marks an empirical constant whose equation does not balance.
#
# Task: keep product rate, composition and reactor pressure within the limits of the paper at low operating cost. The valves are
# the actions; with the variant `pi` 19 loops move the valves every 3 s and the actions are set-points. Disturbances IDV(1) to
# IDV(7), IDV(14) and IDV(15) begin at t_fault: set fault_1 = 1 and so on. The plant is unstable without control.
#
# Checked: at the base point the reactor is at 2705 kPa gauge and 120.4 degC, the operating cost is 170.27 $/h (paper: 170.6);
# eigenvalues 3.06 +- 5.08i 1/h; without control the reactor pressure shuts the plant down at 3.587 h; with 19 loops the
# plant runs for 48 h, and after IDV(6) at 1 h shuts down at 6.892 h, as the program of the authors does; trajectories of SciPy
# with the right-hand side in the units of the program.

time t : h

# ---- Units of the original, as it rounds them ----
param lb : kg = 0.454, lb_h : kg/h = 0.454, lbmol : kmol = 0.454, lbmol_h : kmol/h = 0.454    "pound, pound-mole"
param ft3 : m^3 = 1/35.3145, mmHg : kPa = 101.325/760, MMBtu : Mcal = 1000*0.454/1.8    # cal/(g K) is Btu/(lb degF)

# ---- Species ----
set species = { A, B, C, D, E, F, G, H }
set light = { A, B, C }    # do not condense
set heavy = species - light    # liquid in reactor and separator
table over species "heats in cal/g are Btu/lb over 1.8; densities in lb/ft3 with degrees Celsius; price of what is lost" {
  columns: M [kg/kmol], cL0 [cal/(g K)], cL1 [cal/(g K^2)], cL2 [cal/(g K^3)], cG0 [cal/(g K)], cG1 [cal/(g K^2)], cG2 [cal/(g K^3)], H_vap [cal/g], d0 [1], d1 [1/K], d2 [1/K^2], price [1/kmol]
  A:  2.0, 1.0,   0,       0,       3.411,  7.18e-4, 6.0e-7,   1/1.8,    1.0,  0,       0,         2.206
  B: 25.4, 1.0,   0,       0,       0.3799, 1.08e-3, -3.98e-7, 1/1.8,    1.0,  0,       0,         0
  C: 28.0, 1.0,   0,       0,       0.2491, 1.36e-5, -3.93e-8, 1/1.8,    1.0,  0,       0,         6.177
  D: 32.0, 0.960, 8.70e-3, 4.81e-5, 0.3567, 8.51e-4, -3.12e-7, 86.7/1.8, 23.3, -0.0700, -0.0002,   22.06
  E: 46.0, 0.573, 2.41e-3, 1.82e-5, 0.3463, 8.96e-4, -3.27e-7, 160/1.8,  33.9, -0.0957, -0.000152, 14.56
  F: 48.0, 0.652, 2.18e-3, 1.94e-5, 0.3930, 1.02e-3, -3.12e-7, 160/1.8,  32.8, -0.0995, -0.000233, 17.89
  G: 62.0, 0.515, 5.65e-4, 3.82e-6, 0.170,  0,       0,        225/1.8,  49.9, -0.0191, -0.000425, 30.44
  H: 76.0, 0.471, 8.70e-4, 2.62e-6, 0.150,  0,       0,        209/1.8,  50.5, -0.0541, -0.000150, 22.94
}
table over heavy "vapour pressure by Antoine, mmHg and degrees Celsius; equilibrium factor of the stripper" {
  columns: A_vp [1], B_vp [K], C_vp [K], k_strip [1]
  D: 15.92, -1444, 259.0, 8.5010
  E: 16.35, -2114, 265.5, 11.402
  F: 16.35, -2114, 265.5, 11.795
  G: 16.43, -2748, 232.9, 0.0480
  H: 17.21, -3318, 249.6, 0.0242
}
param R_vol : J/(mol K) = 998.9 [1/K]*mmHg*ft3/lbmol    "gas constant of the gas law, as the original rounds it"
param R_cal : cal/(mol K) = 1.9872, R_kin : cal/(mol K) = 1.987    "gas constants of the energy balances and of the kinetics"
def above(T) = T - 0 [degC]    # enthalpies are counted from 0 degC
def sensible(T, c0, c1, c2) = above(T)*(c0 + c1*above(T)/2 + c2*sq(above(T))/3)
def density(T, r0, r1, r2) = (r0 + (r1 + r2*above(T))*above(T))*lb/ft3

# ---- Reactions: rates from partial pressures in mmHg † ----
param Q_1 : cal/mol = 0.06899381054e6/1.8, Q_2 : cal/mol = 0.05e6/1.8    "heats of the first two reactions"
def k(ln_k0, E_a) = exp(ln_k0 - E_a/(R_kin*kelvin(T[reactor])))*lbmol_h/ft3*V_G[reactor]
let P[i in species] = p_i[reactor, i]/mmHg
reaction r1: A + C + D -> G    rate k(31.5859536, 40000 [cal/mol])*P[A]^1.1544*P[C]^0.3735*P[D]
reaction r2: A + C + E -> H    rate k(3.00094014, 20000 [cal/mol])*P[A]^1.1544*P[C]^0.3735*P[E]
reaction r3: A + E -> F        rate k(53.4060443, 60000 [cal/mol])*P[A]*P[E]
reaction r4: 1.5 D -> F        rate k(53.4060443, 60000 [cal/mol])*0.767488334*P[A]*P[D]

# ---- Valves and their drives ----
table over valves "opening of the base case, time constant" {
  columns: base [%], tau [s]
  D_feed:       63.05263039, 8
  E_feed:       53.97970677, 8
  A_feed:       24.64355755, 6
  C_feed:       61.30192144, 9
  recycle:      22.21,       7
  purge:        40.06374673, 5
  underflow:    38.10034370, 5
  product:      46.53415582, 5
  steam:        47.44573456, 120
  reactor_cw:   41.10581288, 5
  condenser_cw: 18.11349055, 5
  agitator:     50,          5
}
action u[k in valves] : % = base[k] in 0..100    "commands to the valves, XMV(1) to XMV(12)"
state  pos[k in valves] : % = base[k] in 0..100 scale 10    "openings, which follow with the lag of the drives"
param stick : % = 2    "band of a sticking valve: smaller changes have no effect"
set sticky = { reactor_cw, condenser_cw }
let sticks[k in sticky] = { reactor_cw: stick*idv14, condenser_cw: stick*idv15 }
discrete held[k in sticky] : % = base[k]    "commands to the drives of the coolants"
at start { next held[k] = if abs(u[k] - held[k]) > sticks[k] then u[k] else held[k]    for k in sticky }
let command[k in valves] : % = if k in sticky then held[k] else u[k]
eq d/dt pos[k] = (command[k] - pos[k]) / tau[k]    for k in valves

# ---- Disturbances: steps that begin at t_fault ----
param t_fault : h = 0    "when the steps begin"
param fault_1 = 0  in 0..1    "A/C ratio of stream 4 down, B constant",        fault_2 = 0  in 0..1    "B of stream 4 up, A/C ratio constant"
param fault_3 = 0  in 0..1    "temperature of the D feed",                     fault_4 = 0  in 0..1    "inlet temperature of the reactor's coolant"
param fault_5 = 0  in 0..1    "inlet temperature of the condenser's coolant",  fault_6 = 0  in 0..1    "loss of the A feed"
param fault_7 = 0 in 0..1    "header pressure of C falls"
param fault_14 = 0 in 0..1    "valve of the reactor's coolant sticks", fault_15 = 0 in 0..1    "valve of the condenser's coolant sticks"
def from_fault(f) = if (n + 0.5)*step > t_fault then f else 0
disturbance idv1 = 0 ~ from_fault(fault_1),  idv2  = 0 ~ from_fault(fault_2),   idv3  = 0 ~ from_fault(fault_3)
disturbance idv4 = 0 ~ from_fault(fault_4),  idv5  = 0 ~ from_fault(fault_5),   idv6  = 0 ~ from_fault(fault_6)
disturbance idv7 = 0 ~ from_fault(fault_7),  idv14 = 0 ~ from_fault(fault_14),  idv15 = 0 ~ from_fault(fault_15)

# ---- Feeds: streams 1 to 4 ----
set feeds = { A_feed, D_feed, E_feed, C_feed }
table F_max[feeds] : kmol/h = { A_feed: 100*0.454, D_feed: 400*0.454, E_feed: 400*0.454, C_feed: 1500*0.454 }
table z_base[feeds, species] default 0 "composition, mole fractions" {
  A_feed: A = 0.9999, B = 0.0001
  D_feed: B = 0.0001, D = 0.9999
  E_feed: E = 0.9999, F = 0.0001
  C_feed: A = 0.4850, B = 0.0050, C = 0.5100
}
table z_fault1[feeds, species] default 0 { C_feed: A = -0.03, C = 0.03 }
table z_fault2[feeds, species] default 0 { C_feed: A = -2.43719e-3, B = 0.005, C = -2.56281e-3 }
let open[k in feeds]                      = { A_feed: 1 - idv6, C_feed: 1 - 0.2*idv7, default: 1 }
let T_feed[k in feeds]          : degC    = if k == D_feed then 45 [degC] + 5 [K]*idv3 else 45 [degC]
let z[k in feeds, i in species]           = z_base[k, i] + idv1*z_fault1[k, i] + idv2*z_fault2[k, i]
let F_in[k in feeds]            : kmol/h  = pos[k]*open[k]*F_max[k]
let h_in[k in feeds]            : cal/mol = sum(z[k, i]*M[i]*(sensible(T_feed[k], cG0[i], cG1[i], cG2[i]) + H_vap[i]) for i in species)

# ---- Reactor and separator: drums with liquid and vapour ----
# Light gases are vapour; of the heavy species only the liquid is counted, their vapour follows by Raoult.
set drums = { reactor, separator }
table V_drum[drums] : m^3 = { reactor: 1300/35.3145, separator: 3500/35.3145 }
state N[k in drums, i in species] : kmol = n_0[k, i]*lbmol in 0..inf scale 1    "holdups: light in the vapour, heavy in the liquid"
state U[k in drums] : Mcal = { reactor: 2.808522723*MMBtu, separator: 0.5699317760*MMBtu } in 0..inf scale 100    "enthalpies of the liquids"
var   T[drums] : degC = 100 in -50..400    "temperatures"
let N_L[k in drums]                      = sum(N[k, i] for i in heavy)
let x[k in drums, i in heavy]            = N[k, i]/N_L[k]    # liquid
let h_L[k in drums]           : cal/mol  = sum(x[k, i]*M[i]*sensible(T[k], cL0[i], cL1[i], cL2[i]) for i in heavy)    "enthalpy of the liquid"
let v_L[k in drums]           : m^3/kmol = sum(x[k, i]*M[i]/density(T[k], d0[i], d1[i], d2[i]) for i in heavy)    "its molar volume"
let V_L[k in drums]           : m^3      = N_L[k]*v_L[k]                                                          "its volume"
let V_G[k in drums]           : m^3      = V_drum[k] - V_L[k]                                                     "volume of the vapour"
let p_i[k in drums, i in species] : kPa = if i in light then N[k, i]*R_vol*kelvin(T[k])/V_G[k] else x[k, i]*exp(A_vp[i] + B_vp[i]/(above(T[k]) + C_vp[i]))*mmHg    "partial pressures"
let p[k in drums] : kPa = sum(p_i[k, i] for i in species)    "pressure"
let y[k in drums, i in species]           = p_i[k, i]/p[k]    # vapour
let M_G[k in drums]             : kg/kmol = sum(y[k, i]*M[i] for i in species)    "molar mass of the vapour"
let h_G[k in drums]             : cal/mol = sum(y[k, i]*M[i]*(sensible(T[k], cG0[i], cG1[i], cG2[i]) + H_vap[i]) for i in species)    "its enthalpy"
eq U[k] = N_L[k]*h_L[k]    for k in drums

# ---- Mixing zone: fresh feeds, stripper overhead, recycle; vapour only ----
state n_m[i in species] : kmol = n_m0[i]*lbmol in 0..inf scale 10    "holdup"
state U_m : Mcal = 0.9218489762*MMBtu in 0..inf scale 100    "internal energy"
var   T_m : degC = 86 in -50..400    "temperature"
let N_m = sum(n_m[i] for i in species)
let y_m[i in species] = n_m[i]/N_m
let p_m : kPa     = N_m*R_vol*kelvin(T_m)/(5000*ft3)     "pressure"
let M_m : kg/kmol = sum(y_m[i]*M[i] for i in species)    "molar mass"
let h_m : cal/mol = sum(y_m[i]*M[i]*(sensible(T_m, cG0[i], cG1[i], cG2[i]) + H_vap[i]) for i in species)    "enthalpy"
eq U_m         = N_m*(h_m - R_cal*kelvin(T_m))
eq d/dt n_m[i] = z[A_feed, i]*F_in[A_feed] + z[D_feed, i]*F_in[D_feed] + z[E_feed, i]*F_in[E_feed] + f5[i] + F8*y[separator, i] - F6*y_m[i]    for i in species
eq d/dt U_m    = F_in[A_feed]*h_in[A_feed] + F_in[D_feed]*h_in[D_feed] + F_in[E_feed]*h_in[E_feed] + F5*h5 + F8*h_G[separator] + W_c - F6*h_m

# ---- Flows between the vessels, driven by pressure ----
def drop(high, low) = sqrt(max(high - low, 0 [kPa])/mmHg)
let F6 : kmol/h = 1937.6*lb_h*drop(p_m, p[reactor])/M_m                                 "feed of the reactor, stream 6 †"
let F7 : kmol/h = 4574.21*lb_h*drop(p[reactor], p[separator])/M_G[reactor]              "effluent of the reactor, stream 7 †"
let F9 : kmol/h = pos[purge]*15.1169*lb_h*drop(p[separator], 1 [atm])/M_G[separator]    "purge, stream 9 †"

# ---- Reactor ----
param T_w   : degC      = 35                           "inlet of the coolant"
param m_w   : kg        = 7060*lb                      "coolant in the reactor's tubes"
param c_w   : cal/(g K) = 1                            "heat capacity of water"
param W_max : kg/h      = 1000*500.53*lb_h/1 [kg/h]    "largest flow of coolant: 1000 gal/min"
state T_wr : degC = 94.59927549 in 0..200 scale 10    "outlet of the coolant"
let speed               = pos[agitator] + 150 [%]
let wetted              = clip(0.025*V_L[reactor]/(7.8*ft3) - 0.25, 0, 1)    # share of the tubes that is covered
let UA_r   : Mcal/(h K) = wetted*(-0.5*sq(speed) + 2.75*speed - 2.5)*0.855490*MMBtu/1 [h K]    "heat transfer †"
let Q_w    : Mcal/h     = UA_r*(T[reactor] - T_wr)                                             "heat to the coolant"
eq d/dt N[reactor, i] = F6*y_m[i] - F7*y[reactor, i] + source[i]    for i in species
eq d/dt U[reactor]    = F6*h_m - F7*h_G[reactor] + r1*Q_1 + r2*Q_2 - Q_w
eq m_w*c_w*d/dt T_wr  = pos[reactor_cw]*W_max*c_w*(T_w + 5 [K]*idv4 - T_wr) + Q_w

# ---- Condenser and separator ----
param T_ws   : degC = 40                           "inlet of the coolant"
param m_ws   : kg   = 11138*lb                     "coolant in the condenser"
param W_smax : kg/h = 1200*500.53*lb_h/1 [kg/h]    "largest flow of coolant: 1200 gal/min"
state T_wc : degC = 77.29698353 in 0..200 scale 10    "outlet of the coolant"
let UA_c : Mcal/(h K) = 0.404655*(1 - 1/(1 + (F7/(3528.73*lbmol_h))^4))*MMBtu/1 [h K]    "heat transfer †"
let Q_c  : Mcal/h     = UA_c*(T[reactor] - T_wc)                                         "heat to the coolant"
let F10  : kmol/h     = pos[underflow]*1500*lbmol_h                                      "underflow, stream 10"
eq d/dt N[separator, i] = F7*y[reactor, i] - (F8 + F9)*y[separator, i] - F10*x10[i]    for i in species
eq d/dt U[separator]    = F7*h_G[reactor] - (F8 + F9)*h_G[separator] - W_c - F10*h_L[separator] - Q_c    # the original takes the work of the compressor out here
eq m_ws*c_w*d/dt T_wc   = pos[condenser_cw]*W_smax*c_w*(T_ws + 5 [K]*idv5 - T_wc) + Q_c
let x10[i in species] : 1 = if i in heavy then x[separator, i] else 0    "composition of the underflow"

# ---- Compressor with bypass ----
let ratio          = clip(p_m/p[separator], 1, 1.3)
let w_c   : kg/h   = 280275*lb_h*(1 + (1 - ratio^3)/1.197)               "flow of the compressor †"
let W_c   : Mcal/h = w_c/M_G[separator]*R_cal*kelvin(T[separator])*(p_m - p[separator])/p[separator]    "its work"
let w_b   : kg/h   = pos[recycle]*5334.9*lb_h*drop(p_m, p[separator])    "through the bypass †"
let F8    : kmol/h = max(w_c - w_b, 1e-3*lb_h)/M_G[separator]            "recycle, stream 8"

# ---- Stripper ----
param V_c : m^3 = 156.5*ft3    "volume of the sump"
state n_c[i in species] : kmol = n_c0[i]*lbmol in 0..inf scale 1    "holdup of the sump"
state H_c : Mcal = 0.3755297257*MMBtu in 0..inf scale 10    "its enthalpy"
var   T_c : degC = 65 in -50..400    "temperature"
let N_c = sum(n_c[i] for i in species)
let x_c[i in species] = n_c[i]/N_c
let h_c       : cal/mol  = sum(x_c[i]*M[i]*sensible(T_c, cL0[i], cL1[i], cL2[i]) for i in species)    "enthalpy of the product"
let v_c       : m^3/kmol = sum(x_c[i]*M[i]/density(T_c, d0[i], d1[i], d2[i]) for i in species)    "its molar volume"
let V_cL      : m^3      = N_c*v_c                                                                "liquid"
let F11       : kmol/h   = pos[product]*1000*lbmol_h                                              "product, stream 11"
let hot       : K        = above(T_c)
let warmth               = if hot > 170 [K] then hot/1 [K] - 120.262 else if hot < 5.292 [K] then 0.1 else 363.744 [K]/(177 [K] - hot) - 2.22579488    # †
let stripping            = F_in[C_feed]/F10*warmth    # vapour over liquid
table s_dry[species] "share that leaves overhead: of light gases, of others if no liquid enters" = { A: 0.995, B: 0.991, C: 0.99, D: 0.9999, E: 0.999, F: 0.999, G: 0.99, H: 0.98 }
let share[i in species]    : 1 = if i  in heavy then (if F10 > 0.1*lbmol_h then k_strip[i]*stripping/(1 + k_strip[i]*stripping) else s_dry[i]) else s_dry[i]    "share of what enters that leaves overhead"
let entering[i in species]     = z[C_feed, i]*F_in[C_feed] + x10[i]*F10
let f5[i in species]           = share[i]*entering[i]    # overhead, stream 5
let F5  : kmol/h  = sum(f5[i] for i in species)    "overhead, stream 5"
let h5  : cal/mol = sum(f5[i]/F5*M[i]*(sensible(T_c, cG0[i], cG1[i], cG2[i]) + H_vap[i]) for i in species)    "its enthalpy"
let Q_s : Mcal/h  = if hot < 100 [K] then pos[steam]*0.03*MMBtu/1 [h K]*(100 [K] - hot) else 0 [Mcal/h]    "heat of the steam"
eq H_c         = N_c*h_c
eq d/dt n_c[i] = entering[i] - f5[i] - F11*x_c[i]    for i in species
eq d/dt H_c    = F_in[C_feed]*h_in[C_feed] + F10*h_L[separator] - F5*h5 - F11*h_c + Q_s

# ---- Base case, in pound-moles and million Btu ----
table n_0[drums, species] {
  reactor:   A = 10.40491389, B = 4.363996017, C = 7.570059737, D = 0.4230042431, E = 24.15513437, F = 2.942597645, G = 154.3770655, H = 159.1865960
  separator: A = 63.75581199, B = 26.74026066, C = 46.38532432, D = 0.2464521543, E = 15.20484404, F = 1.852266172, G = 52.44639459, H = 41.20394008
}
table n_c0[species] = { A: 0.4306056376, B: 7.9906200783e-3, C: 0.9056036089, D: 1.6054258216e-2, E: 0.7509759687, F: 8.8582855955e-2, G: 48.27726193, H: 39.38459028 }
table n_m0[species] = { A: 107.7562698, B: 29.77250546, C: 88.32481135, D: 23.03929507, E: 62.85848794, F: 5.546318688, G: 11.92244772, H: 5.555448243 }

# ---- Measurements, XMEAS(1) to XMEAS(22); volumes of gas at standard conditions ----
param v_std : m^3/kmol = 359*ft3/lbmol    "molar volume at standard conditions"
let V_feed_A  : m^3/h = F_in[A_feed]*v_std                                      "1: A feed"
let W_feed_D  : kg/h  = F_in[D_feed]*sum(z[D_feed, i]*M[i] for i in species)    "2: D feed"
let W_feed_E  : kg/h  = F_in[E_feed]*sum(z[E_feed, i]*M[i] for i in species)    "3: E feed"
let V_feed_C  : m^3/h = F_in[C_feed]*v_std                                      "4: A and C feed"
let V_recycle : m^3/h = F8*v_std                                                "5: recycle"
let V_reactor : m^3/h = F6*v_std                                                "6: feed of the reactor"
let p_reactor : kPa   = p[reactor] - 1 [atm]                                    "7: reactor, gauge"
let L_reactor : %     = (V_L[reactor] - 84.6*ft3)/(666.7*ft3)                   "8: level of the reactor"
let V_purge   : m^3/h = F9*v_std                                                "10: purge"
let L_sep     : %     = (V_L[separator] - 27.5*ft3)/(290*ft3)                   "12: level of the separator"
let p_sep     : kPa   = p[separator] - 1 [atm]                                  "13: separator, gauge"
let Q_under   : m^3/h = F10*v_L[separator]                                      "14: underflow of the separator"
let L_strip   : %     = (V_cL - 78.25*ft3)/V_c                                  "15: level of the stripper"
let p_strip   : kPa   = p_m - 1 [atm]                                           "16: stripper, gauge"
let Q_product : m^3/h = F11*v_c                                                 "17: product"
let W_steam   : kg/h  = (value(Q_s/MMBtu, 1/h)*1.04e3*0.454) as [kg/h]          "19: steam †"
let P_comp    : kW    = (value(W_c/MMBtu, 1/h)*293.07) as [kW]                  "20: work of the compressor"
observe V_feed_A in 0..1000 noise normal(0, 1.2), W_feed_D in 0..6000 noise normal(0, 18), W_feed_E in 0..9000 noise normal(0, 22)
observe V_feed_C in 0..16000 noise normal(0, 50), V_recycle in 0..60000 noise normal(0, 200), V_reactor in 0..100000 noise normal(0, 210)
observe p_reactor in 0..3100 noise normal(0, 0.3), L_reactor in 0..150 noise normal(0, 0.5), T_reactor : degC = T[reactor] in 0..200 noise normal(0, 0.01)
observe V_purge in 0..2000 noise normal(0, 1.7), T_sep : degC = T[separator] in 0..200 noise normal(0, 0.01), L_sep in -10..150 noise normal(0, 1)
observe p_sep in 0..3100 noise normal(0, 0.3), Q_under in 0..80 noise normal(0, 0.125), L_strip in -50..150 noise normal(0, 1)
observe p_strip in 0..4000 noise normal(0, 0.3), Q_product in 0..60 noise normal(0, 0.115), T_strip : degC = T_c in 0..200 noise normal(0, 0.01)
observe W_steam in 0..500 noise normal(0, 1.15), P_comp in 0..800 noise normal(0, 0.2)
observe T_wr in 0..200 noise normal(0, 0.01), T_wc in 0..200 noise normal(0, 0.01)
# Analysers, XMEAS(23) to XMEAS(41): samples of 0.1 h of feed and purge, of 0.25 h of product, reported one period later.
set seen_feed = { A, B, C, D, E, F }
let a_feed[i in seen_feed] : % = y_m[i], a_purge[i in species] : % = y[separator, i], a_product[i in heavy] : % = x_c[i]
table sd_gas[species] : % = { A: 0.25, B: 0.1, C: 0.25, D: 0.1, E: 0.25, F: 0.025, G: 0.05, H: 0.05 }
table sd_product[heavy] : % = { D: 0.01, E: 0.01, F: 0.01, G: 0.5, H: 0.5 }
observe a_feed[i] in 0..100 every 6 [min] delay 6 [min] noise normal(0, sd_gas[i]) for i in seen_feed
observe a_purge[i] in 0..100 every 6 [min] delay 6 [min] noise normal(0, sd_gas[i]) for i in species
observe a_product[i] in 0..100 every 15 [min] delay 15 [min] noise normal(0, sd_product[i]) for i in heavy
level online extends default "the 22 continuous measurements with their noise; no analysers" {
  remove observe a_feed
  remove observe a_purge
  remove observe a_product
}

# ---- Shutdown limits ----
fail reactor_pressure event p_reactor >= 3000 [kPa]
fail reactor_full event V_L[reactor] >= 24 [m^3]
fail reactor_empty event V_L[reactor] <= 2 [m^3]
fail reactor_hot event T[reactor] >= 175 [degC]
fail separator_full event V_L[separator] >= 12 [m^3]
fail separator_empty event V_L[separator] <= 1 [m^3]
fail stripper_full event V_cL >= 8 [m^3]
fail stripper_empty event V_cL <= 1 [m^3]

# ---- Cost and rewards ----
let c_purge   : 1/h = F9*sum(price[i]*y[separator, i] for i in species)    "species lost with the purge, $/h"
let c_product : 1/h = F11*sum(price[i]*x_c[i] for i in { D, E, F })        "reactants and by-product lost with the product, $/h"
let c_work    : 1/h = 0.0536 [1/(kW h)]*P_comp                             "electricity, $/h"
let c_steam   : 1/h = 0.0318 [1/kg]*W_steam                                "steam, $/h"
let cost      : 1/h = c_purge + c_product + c_work + c_steam               "operating cost, $/h"
let G_over_H  : 1   = x_c[G]*M[G]/(x_c[H]*M[H])                            "mass of G over mass of H in the product"
param w_order : 1/h = 100    "cost of a relative deviation of product rate or composition"
param rate_set : m^3/h = 22.949, L_set : % = 75, p_set : kPa = 2705, GH_set = 1.0    "product, level and pressure of the reactor, G over H"
reward economy default = -integral(cost) - w_order*step*(abs(Q_product - rate_set)/rate_set + abs(G_over_H - GH_set))    "operating cost of the step and deviations from the order"
reward cost_alone      = -integral(cost)
reward setpoint        = -(sq((Q_product - rate_set)/1 [m^3/h]) + sq((p_reactor - p_set)/100 [kPa]) + sq((L_reactor - L_set)/10 [%]) + sq((G_over_H - GH_set)/0.1))
constraint pressure_high when p_reactor > 2895 [kPa]
constraint reactor_level when L_reactor > 100 [%] or L_reactor < 50 [%]
constraint separator_level when L_sep > 100 [%] or L_sep < 30 [%]
constraint stripper_level when L_strip > 100 [%] or L_strip < 30 [%]
constraint reactor_warm when T[reactor] > 150 [degC]
# With all valves where they are two levels integrate. The point is unstable: 3.06 +- 5.08i 1/h.
steady { N[separator, G] = 23.81066, n_c[G] = 21.91788 }

# ---- What is conserved ----
let mass_held = sum(M[i]*(N[reactor, i] + N[separator, i] + n_c[i] + n_m[i]) for i in species)
let mass_in   = sum(M[i]*z[k, i]*F_in[k] for k in feeds, i in species)
let mass_out  = sum(M[i]*(F9*y[separator, i] + F11*x_c[i]) for i in species)
invariant mass = mass_held rate mass_in - mass_out
episode { step = 1 [min], max_steps = 2880, error_reward = -1000 }
solver  { rtol = 1e-9 }

# ---- Decentralised PI control: the loops of temain_mod.f in velocity form ----
variant pi "19 loops move the valves; the actions are the set-points of an operator" {
  episode { step = 3 [s], max_steps = 57600 }
  action rate_set : m^3/h = 22.949  in 15..30      "product"
  action L_set    : %     = 75      in 50..100     "level of the reactor"
  action T_set    : degC  = 120.40  in 110..140    "temperature of the reactor"
  action E_set    : %     = 0.8357  in 0.3..2      "E in the product"
  discrete u[k in valves] : % = base[k]  in 0..100    "openings"
  discrete bursting           = 0                     "1: purge open for high pressure, 2: shut for low"
  # Set-points of the cascades.
  discrete W_D_set : kg/h  = 3664,    W_E_set : kg/h  = 4509.3,  W_S_set : kg/h  = 230.31
  discrete V_A_set : m^3/h = 250.52,  V_C_set : m^3/h = 9347.7,  V_P_set : m^3/h = 337.12
  discrete T_wr_set : degC = 94.599, T_c_set : degC = 65.731
  # Last samples of the analysers, which the loops read one period later.
  discrete s_feed[i in seen_feed] = y_m[i], s_purge[i in species] = y[separator, i], s_product[i in heavy] = x_c[i]
  let high      = p_sep >= 2950 [kPa] or bursting == 1 and p_sep >= 2633.7 [kPa]
  let low       = p_sep <= 2300 [kPa] or bursting == 2 and p_sep <= 2633.7 [kPa]
  let over      = not high and not low and bursting > 0
  let burst : % = if high then 100 else if low then 0 else 40.060
  # Gains are those of the program over the range of the instrument, times the range of the output of a cascade.
  control u[D_feed] from W_feed_D setpoint W_D_set gain 1/5811 [kg/h] every 3 [s]
  control u[E_feed] from W_feed_E setpoint W_E_set gain 1/8354 [kg/h] every 3 [s]
  control u[A_feed] from V_feed_A setpoint V_A_set gain 1/1017 [m^3/h] every 3 [s]
  control u[C_feed] from V_feed_C setpoint V_C_set gain 1/15250 [m^3/h] every 3 [s]
  control u[recycle] from V_recycle setpoint 26902 [m^3/h] gain -0.083/53000 [m^3/h] reset 1 [s] every 3 [s]
  control u[purge] from V_purge setpoint V_P_set gain 1.22/1000 [m^3/h] manual burst when high or low or over every 3 [s]
  control u[underflow] from L_sep setpoint 50 [%] gain -2.06/70 [%] every 3 [s]
  control u[product] from L_strip setpoint 50 [%] gain -1.62/70 [%] every 3 [s]
  control u[steam] from W_steam setpoint W_S_set gain 0.41/460 [kg/h] every 3 [s]
  control u[reactor_cw] from T_wr setpoint T_wr_set gain -1.56/150 [K] reset 1452 [s] every 3 [s]
  control u[condenser_cw] from Q_product setpoint rate_set gain 1.09/46 [m^3/h] reset 2600 [s] every 3 [s]
  control W_S_set from T_c setpoint T_c_set gain 0.169*460 [kg/h]/130 [K] reset 236 [s] every 3 [s]
  control V_C_set from L_reactor setpoint L_set gain 1.11*15250 [m^3/h]/50 [%] reset 3168 [s] every 3 [s]
  control T_wr_set from T[reactor] setpoint T_set gain 28.3 reset 982 [s] every 3 [s]
  control V_A_set from s_feed[A] setpoint 0.32188 gain 18*1017 [m^3/h] reset 3168 [s] every 6 [min]
  control W_D_set from s_feed[D] setpoint 0.06882 gain 8.3*5811 [kg/h] reset 3168 [s] every 6 [min]
  control W_E_set from s_feed[E] setpoint 0.18776 gain 2.37*8354 [kg/h] reset 5069 [s] every 6 [min]
  control V_P_set from s_purge[B] setpoint 0.13823 gain -83.2/15*1000 [m^3/h]/0.26 reset 6336 [s] every 6 [min]
  control T_c_set from s_product[E] setpoint E_set gain -16.3/5*130 [K]/1.6 [%] reset 12408 [s] every 15 [min]
  at start { next V_P_set = if over then 337.12 [m^3/h] else V_P_set }
  at every 3 [s] {
    next held[k]  = if abs(u[k] - held[k]) > sticks[k] then u[k] else held[k]    for k in sticky
    next bursting = if high then 1 else if low then 2 else 0
  }
  at every 6 [min]  { next s_feed[i] = y_m[i]    for i in seen_feed; next s_purge[i] = y[separator, i]    for i in species }
  at every 15 [min] { next s_product[i] = x_c[i]    for i in heavy }
}

# ---- Tests: `smpl test models/gallery/tennessee_eastman.eq`, against Downs and Vogel 1993, and their program ----
test "pressure, temperature and cost of the base case" {
  start nominal
  expect p_reactor within 0.5 of 2705
  expect T[reactor] within 0.05 of 120.4
  expect cost within 0.2 of 170.27
}
test "without control the pressure shuts the plant down at 3.587 h" {
  start nominal
  steps 215
  expect p_reactor < 3000 [kPa]
  steps 1
  expect failure reactor_pressure
}
test "the loops hold the plant until the feed of A is lost: it shuts down at 6.892 h" {
  variant pi
  start nominal
  fault_6 = 1
  t_fault = 1
  for 6.88 [h]
  expect p_reactor < 3000 [kPa]
  for 72 [s]
  expect failure
}
