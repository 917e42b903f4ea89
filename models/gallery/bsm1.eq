model BSM1 "Benchmark Simulation Model no. 1: five activated-sludge tanks, a ten-layer settler, two recycles"

# J. Alex et al., Benchmark Simulation Model no. 1 (BSM1), IWA task group on benchmarking of control strategies, 2008 and 2018.
# Kinetics: M. Henze et al., Activated Sludge Model No. 1, IAWPRC 1987. Settler: I. Takacs, G. G. Patry, D. Nolasco, Water
# Research 25 (1991) 1263-1271.
#
# Task: low pollution of the effluent (quality index EQ) at low energy. Actions are the recycles, the waste sludge and the
# aeration of tank 5; with `control=pi` two loops for oxygen and nitrate move aeration and internal recycle, and the actions
# are their set-points. Flow and composition of the influent are disturbances: random by default, recorded data replace them.
#
# Checked: the published open-loop steady state (tank 5: S_I 30.0, S_S 0.889, X_I 1149, X_S 49.3, X_BH 2559, X_BA 150, X_P 452,
# S_O 0.491, S_NO 10.4, S_NH 1.73, S_ND 0.688, X_ND 3.53 g/m3, S_ALK 4.13 mol/m3; effluent solids 12.5, underflow 6394 g/m3);
# rates of a plant written in NumPy.

time t : d

# ---- Components and constants ----

set components = { S_I, S_S, X_I, X_S, X_BH, X_BA, X_P, S_O, S_NO, S_NH, S_ND, X_ND, S_ALK }
set solubles = { S_I, S_S, S_O, S_NO, S_NH, S_ND, S_ALK }
set cod_solids = { X_I, X_S, X_BH, X_BA, X_P }    # 0.75 g suspended solids per g COD
set solids = components - solubles

param Y_H  = 0.67    "yield of heterotrophs, g COD per g COD"
param Y_A  = 0.24    "yield of autotrophs, g COD per g N"
param f_P  = 0.08    "share of biomass that becomes inert"
param i_XB = 0.08    "nitrogen in biomass, g N per g COD"
param i_XP = 0.06    "nitrogen in inert products, g N per g COD"

param mu_H  : 1/d       = 4.0     "largest growth rate of heterotrophs"
param K_S   : g/m^3     = 10      "half-saturation, substrate"
param K_OH  : g/m^3     = 0.2     "half-saturation of heterotrophs, oxygen"
param K_NO  : g/m^3     = 0.5     "half-saturation, nitrate"
param b_H   : 1/d       = 0.3     "decay of heterotrophs"
param eta_g             = 0.8     "anoxic growth over aerobic"
param eta_h             = 0.8     "anoxic hydrolysis over aerobic"
param k_h   : 1/d       = 3       "hydrolysis"
param K_X               = 0.1     "half-saturation of hydrolysis, g COD per g COD"
param mu_A  : 1/d       = 0.5     "largest growth rate of autotrophs"
param K_NH  : g/m^3     = 1       "half-saturation, ammonia"
param b_A   : 1/d       = 0.05    "decay of autotrophs"
param K_OA  : g/m^3     = 0.4     "half-saturation of autotrophs, oxygen"
param k_a   : m^3/(g d) = 0.05    "ammonification"

# ---- Units ----

connector Stream { Q : m^3/d, c[components] : g/m^3 }

param S_Osat : g/m^3 = 8    "saturation of oxygen"

component Tank "aerated, well mixed" {
  param V : m^3
  param c_0[components] : g/m^3
  port inlet, outlet : Stream
  var  kLa : 1/d
  state c[i in components] : g/m^3 = c_0[i] in 0..20000 scale 10
  let aerobic = c[S_O]/(K_OH + c[S_O])
  let anoxic  = K_OH/(K_OH + c[S_O]) * c[S_NO]/(K_NO + c[S_NO])
  let monod   = c[S_S]/(K_S + c[S_S])
  let hydro   = k_h * c[X_BH]/(K_X*c[X_BH] + c[X_S]) * (aerobic + eta_h*anoxic)
  # Alkalinity counts in mol/m^3 where the others count in g/m^3.
  reaction growth_H: (1/Y_H) S_S + (1/Y_H - 1) S_O + i_XB S_NH + (i_XB/14) S_ALK -> X_BH    rate mu_H * monod * aerobic * c[X_BH]
  reaction growth_anoxic: (1/Y_H) S_S + ((1 - Y_H)/(2.86*Y_H)) S_NO + i_XB S_NH + (i_XB/14) S_ALK
      -> X_BH + ((1 - Y_H)/(14*2.86*Y_H)) S_ALK    rate mu_H * monod * anoxic * eta_g * c[X_BH]
  reaction growth_A: ((4.57 - Y_A)/Y_A) S_O + (i_XB + 1/Y_A) S_NH + (i_XB/14 + 1/(7*Y_A)) S_ALK
      -> X_BA + (1/Y_A) S_NO    rate mu_A * c[S_NH]/(K_NH + c[S_NH]) * c[S_O]/(K_OA + c[S_O]) * c[X_BA]
  reaction decay_H: X_BH -> (1 - f_P) X_S + f_P X_P + (i_XB - f_P*i_XP) X_ND    rate b_H * c[X_BH]
  reaction decay_A: X_BA -> (1 - f_P) X_S + f_P X_P + (i_XB - f_P*i_XP) X_ND    rate b_A * c[X_BA]
  reaction ammonification: S_ND -> S_NH + (1/14) S_ALK    rate k_a * c[S_ND] * c[X_BH]
  reaction hydrolysis: X_S -> S_S        rate hydro * c[X_S]
  reaction hydrolysis_N: X_ND -> S_ND    rate hydro * c[X_ND]
  eq d/dt c[i] = inlet.Q/V * (inlet.c[i] - c[i]) + source[i]
                 + (if i == S_O then kLa*(S_Osat - c[i]) else 0 [g/(m^3 d)])    for i in components
  eq outlet.Q    = inlet.Q
  eq outlet.c[i] = c[i]    for i in components
}

component Settler "Takacs: ten layers, numbered from the bottom, fed at the sixth" {
  param A     : m^2   = 1500        "surface"
  param depth : m     = 4           "depth"
  param v_max : m/d   = 250         "largest settling velocity"
  param v_0   : m/d   = 474         "Vesilind velocity"
  param r_h   : m^3/g = 0.000576    "hindered settling"
  param r_p   : m^3/g = 0.00286     "settling at low concentrations"
  param f_ns          = 0.00228     "share that does not settle"
  param X_t   : g/m^3 = 3000        "threshold of the clarification zone"
  port inlet, effluent, underflow : Stream
  state X[j in 1..10] : g/m^3 = X_0[j] in 0..30000 scale 100    "suspended solids"
  state S[i in solubles, j in 1..10] : g/m^3 = c_guess[5, i] in 0..1000 scale 10    "solubles"

  let h    = depth/10
  let X_f  = 0.75*sum(inlet.c[i] for i in cod_solids)
  let v_in = inlet.Q/A
  let v_up = effluent.Q/A
  let v_dn = underflow.Q/A
  let settling[j in 1..10] : g/(m^2 d) = X[j] * max(0 [m/d], min(v_max, v_0*(exp(-r_h*(X[j] - f_ns*X_f)) - exp(-r_p*(X[j] - f_ns*X_f)))))
  # from layer j to the one below
  let J[j in 2..10] = if j > 6 and X[j-1] <= X_t then settling[j] else min(settling[j], settling[j-1])

  eq h * d/dt X[j] = v_up*(X[j-1] - X[j]) + (if j == 10 then 0 [g/(m^2 d)] else J[j+1]) - J[j]    for j in 7..10
  eq h * d/dt X[6] = v_in*X_f - (v_up + v_dn)*X[6] + J[7] - J[6]
  eq h * d/dt X[j] = v_dn*(X[j+1] - X[j]) + J[j+1] - (if j == 1 then 0 [g/(m^2 d)] else J[j])    for j in 1..5

  eq h * d/dt S[i, j] = v_up*(S[i, j-1] - S[i, j])                 for i in solubles, j in 7..10
  eq h * d/dt S[i, 6] = v_in*inlet.c[i] - (v_up + v_dn)*S[i, 6]    for i in solubles
  eq h * d/dt S[i, j] = v_dn*(S[i, j+1] - S[i, j])                 for i in solubles, j in 1..5

  eq effluent.Q     = inlet.Q - underflow.Q
  eq effluent.c[i]  = S[i, 10]                  for i in solubles
  eq effluent.c[i]  = inlet.c[i] * X[10]/X_f    for i in solids
  eq underflow.c[i] = S[i, 1]                   for i in solubles
  eq underflow.c[i] = inlet.c[i] * X[1]/X_f     for i in solids
}

# ---- Plant ----

# Averages of the influent in dry weather.
table over components {
  columns: c_avg [g/m^3]
  S_I: 30, S_S: 69.5, X_I: 51.2, X_S: 202.32, X_BH: 28.17, X_BA: 0, X_P: 0
  S_O: 0, S_NO: 0, S_NH: 31.56, S_ND: 6.95, X_ND: 10.59, S_ALK: 7
}
# Guess of the steady state, as published; from elsewhere the search ends in roots with negative concentrations.
table c_guess[tanks, components] : g/m^3 {
  1: S_I = 30, S_S = 2.81, X_I = 1149, X_S = 82.1, X_BH = 2552, X_BA = 148, X_P = 449, S_O = 0.0043, S_NO = 5.37, S_NH = 7.92, S_ND = 1.22, X_ND = 5.28, S_ALK = 4.93
  2: S_I = 30, S_S = 1.46, X_I = 1149, X_S = 76.4, X_BH = 2553, X_BA = 148, X_P = 450, S_O = 0.00006, S_NO = 3.66, S_NH = 8.34, S_ND = 0.882, X_ND = 5.03, S_ALK = 5.08
  3: S_I = 30, S_S = 1.15, X_I = 1149, X_S = 64.9, X_BH = 2557, X_BA = 149, X_P = 450, S_O = 1.72, S_NO = 6.54, S_NH = 5.55, S_ND = 0.829, X_ND = 4.39, S_ALK = 4.67
  4: S_I = 30, S_S = 0.995, X_I = 1149, X_S = 55.7, X_BH = 2559, X_BA = 150, X_P = 451, S_O = 2.43, S_NO = 9.3, S_NH = 2.97, S_ND = 0.767, X_ND = 3.88, S_ALK = 4.29
  5: S_I = 30, S_S = 0.889, X_I = 1149, X_S = 49.3, X_BH = 2559, X_BA = 150, X_P = 452, S_O = 0.491, S_NO = 10.4, S_NH = 1.73, S_ND = 0.688, X_ND = 3.53, S_ALK = 4.13
}
set layers = 1..10
table X_0[layers] : g/m^3 { 1: 6394, 2: 356, 3: 356, 4: 356, 5: 356, 6: 356, 7: 69, 8: 29.5, 9: 18.1, 10: 12.5 }

param spread_Q = 0.15  in 0..0.5    "standard deviation of the flow, relative to its mean"
param spread_N = 0.10  in 0..0.5    "standard deviation of ammonia, relative to its mean"
param memory   = 0.95  in 0..1      "share of a deviation that remains after a step"

disturbance q_shift         = 0     ~ memory*q_shift + spread_Q*sqrt(1 - sq(memory))*normal(0, 1) clip bounds  in -0.6..1    "deviation of the flow"
disturbance n_shift         = 0     ~ memory*n_shift + spread_N*sqrt(1 - sq(memory))*normal(0, 1) clip bounds  in -0.6..1    "deviation of ammonia"
disturbance Q_in    : m^3/d = 18446 ~ 18446*(1 + q_shift)                "flow of the influent"
disturbance c_in[i in components] : g/m^3 = c_avg[i] ~ c_avg[i]*(if i == S_NH then 1 + n_shift else 1)    "composition of the influent"

action Q_a  : m^3/d = 55338  in 0..92230     "internal recycle"
action Q_r  : m^3/d = 18446  in 0..36892     "return sludge"
action Q_w  : m^3/d = 385    in 0..1844.6    "waste sludge"
action kLa5 : 1/d   = 84     in 0..360       "aeration of tank 5"
param  kLa3 : 1/d = 240, kLa4 : 1/d = 240

set tanks = 1..5
table V_tank[tanks] : m^3 { 1: 1000, 2: 1000, 3: 1333, 4: 1333, 5: 1333 }

use Tank as tank[k in tanks](V = V_tank[k], c_0 = c_guess[k, components])
use Settler as settler

eq tank[1].inlet.Q    = Q_in + Q_a + Q_r
eq tank[1].inlet.c[i] = (Q_in*c_in[i] + Q_a*tank[5].outlet.c[i] + Q_r*settler.underflow.c[i]) / tank[1].inlet.Q    for i in components
connect tank[1].outlet -> tank[2].inlet
connect tank[2].outlet -> tank[3].inlet
connect tank[3].outlet -> tank[4].inlet
connect tank[4].outlet -> tank[5].inlet
eq settler.inlet.Q     = Q_in + Q_r
eq settler.inlet.c[i]  = tank[5].outlet.c[i]    for i in components
eq settler.underflow.Q = Q_r + Q_w
eq tank[k].kLa         = if k < 3 then 0 [1/d] else if k == 3 then kLa3 else if k == 4 then kLa4 else kLa5    for k in tanks

# ---- Effluent, costs, controllers ----

let S_NH_e : g/m^3 = settler.effluent.c[S_NH]
let S_NO_e : g/m^3 = settler.effluent.c[S_NO]
let TSS_e  : g/m^3 = settler.X[10]
let COD_e  : g/m^3 = settler.effluent.c[S_I] + settler.effluent.c[S_S] + sum(settler.effluent.c[i] for i in cod_solids)
let BOD_e  : g/m^3 = 0.25*(settler.effluent.c[S_S] + settler.effluent.c[X_S] + (1 - f_P)*(settler.effluent.c[X_BH] + settler.effluent.c[X_BA]))
let TKN_e : g/m^3 = S_NH_e + settler.effluent.c[S_ND] + settler.effluent.c[X_ND]
                    + i_XB*(settler.effluent.c[X_BH] + settler.effluent.c[X_BA]) + i_XP*(settler.effluent.c[X_P] + settler.effluent.c[X_I])
let EQ : kg/d   = settler.effluent.Q * (2*TSS_e + COD_e + 30*TKN_e + 10*S_NO_e + 2*BOD_e)    "pollution units"
let AE : kW h/d = S_Osat/(1.8 [kg/(kW h)]) * sum(V_tank[k]*tank[k].kLa for k in tanks)    "aeration"
let PE : kW h/d = 0.004 [kW h/m^3]*Q_a + 0.008 [kW h/m^3]*Q_r + 0.05 [kW h/m^3]*Q_w       "pumping"

observe tank[2].c[S_NO] in 0..20, tank[5].c[S_O] in 0..10, S_NH_e in 0..60, S_NO_e in 0..60, TSS_e in 0..200, Q_in in 0..60000
level online "probes" {
  observe tank[2].c[S_NO] in 0..20 noise normal(0, 0.5), tank[5].c[S_O] in 0..10 noise normal(0, 0.025), Q_in in 0..60000
  observe laboratory : g/m^3 = S_NH_e in 0..60 every 96 delay 16
}

reward operation default = -(integral(EQ)/(50 [kg]) + integral(AE + PE)/(25 [kW h]))    "pollution and energy in units of cost"
reward quality : kg      = -integral(EQ)                                                "pollution"

constraint ammonia when S_NH_e > 4 [g/m^3]
constraint nitrogen when TKN_e + S_NO_e > 18 [g/m^3]
constraint solids_e when TSS_e > 30 [g/m^3]
fail washout when tank[5].c[X_BA] < 1 [g/m^3]    "no nitrifiers left"
fail overflow when TSS_e > 1000 [g/m^3]    "the blanket has come to the weir"

choice control = open | pi    "four actions, or two loops with their set-points as actions"
when control = pi {
  steady { SO_set = 2, SNO_set = 1 }
  action SO_set  : g/m^3 = 2  in 0.5..4    "set-point of oxygen, tank 5"
  action SNO_set : g/m^3 = 1  in 0.1..5    "set-point of nitrate, tank 2"
  param K_kLa : m^3/(g d) = 25,     tau_kLa : d = 0.002,  track_kLa : d = 0.001
  param K_Qa  : m^6/(g d) = 10000,  tau_Qa  : d = 0.025,  track_Qa  : d = 0.015
  state I_kLa : 1/d   = 0  scale 100      "integral action"
  state I_Qa  : m^3/d = 0  scale 10000    "integral action"
  let want_kLa : 1/d   = K_kLa*(SO_set - tank[5].c[S_O]) + I_kLa
  let want_Qa  : m^3/d = K_Qa*(SNO_set - tank[2].c[S_NO]) + I_Qa
  let kLa5     : 1/d   = clip(want_kLa, 0, 360 [1/d])
  let Q_a      : m^3/d = clip(want_Qa, 0, 92230 [m^3/d])
  eq d/dt I_kLa = K_kLa*(SO_set - tank[5].c[S_O])/tau_kLa + (kLa5 - want_kLa)/track_kLa
  eq d/dt I_Qa  = K_Qa*(SNO_set - tank[2].c[S_NO])/tau_Qa + (Q_a - want_Qa)/track_Qa
}

steady { Q_r = 18446, Q_w = 385 }
when control = open { steady { Q_a = 55338, kLa5 = 84 } }
initial x = value(steady(x))    for x in states
episode { step = 15 [min], max_steps = 1344, error_reward = -1000 }
solver  { rtol = 1e-6 }

# ---- Tests: `smpl test models/gallery/bsm1.eq`, against Alex et al. 2008, open loop ----

test "the published steady state" {
  start steady
  expect tank[5].c[X_BH] within 0.6 of 2559
  expect tank[5].c[S_NO] within 0.05 of 10.4
  expect tank[5].c[S_NH] within 0.005 of 1.73
  expect settler.X[10] within 0.05 of 12.5
  expect settler.X[1] within 0.6 of 6394
}
