model MMA "Free-radical polymerisation of methyl methacrylate in an isothermal stirred tank"

# P. Daoutidis, M. Soroush, C. Kravaris, Feedforward/feedback control of multivariable nonlinear processes, AIChE Journal 36
# (1990) 1471-1484, at constant temperature as in F. J. Doyle, B. A. Ogunnaike, R. K. Pearson, Nonlinear model-based control
# using second-order Volterra models, Automatica 31 (1995) 697-714. Initiator: azo-bis-isobutyronitrile; solvent: toluene.
#
# Task: follow set-points of the number-average molecular mass by the flow of initiator while its concentration varies.
#
# Checked: the published steady state C_m = 5.506774, C_I = 0.132906, D_0 = 0.0019752 kmol/m3, D_1 = 49.38182 kg/m3, molecular
# mass 25000.5 kg/kmol; trajectories of SciPy.

time t : h

param k_Tc : m^3/(kmol h) = 1.3281e10    "termination by coupling"
param k_Td : m^3/(kmol h) = 1.0930e11    "termination by disproportionation"
param k_I  : 1/h          = 1.0225e-1    "decomposition of the initiator"
param k_p  : m^3/(kmol h) = 2.4952e6     "propagation"
param k_fm : m^3/(kmol h) = 2.4522e3     "transfer to monomer"
param f                   = 0.58         "efficiency of the initiator"
param V    : m^3          = 0.1          "volume"
param F    : m^3/h        = 1            "flow of the monomer"
param C_m0 : kmol/m^3     = 6            "monomer in the feed"
param M_m  : kg/kmol      = 100.12       "molar mass of the monomer"

action F_I : m^3/h = 0.016783 in 0.001..0.1    "flow of the initiator"

state C_m : kmol/m^3 = 5.506774   in 0..10                 "monomer"
state C_I : kmol/m^3 = 0.132906   in 0..2                  "initiator"
state D_0 : kmol/m^3 = 0.0019752  in 0..0.1  scale 1e-3    "dead chains"
state D_1 : kg/m^3   = 49.38182   in 0..600                "polymer"

disturbance C_I0 : kmol/m^3 = 8 ~ 8 [kmol/m^3] + 0.95*(C_I0 - 8 [kmol/m^3]) + 0.1 [kmol/m^3]*normal(0, 1) clip bounds  in 6..10    "initiator in its feed"
disturbance dr   : kg/kmol  = 0 ~ if mod(n, 50) == 0 and n > 0 then 5000 [kg/kmol]*uniform(-1, 1) else dr  in -8000..8000    "change of the set-point"

let P_0  : kmol/m^3 = sqrt(2*f*k_I*C_I/(k_Td + k_Tc))    "living chains"
let mass : kg/kmol  = D_1/D_0                            "number-average molecular mass"
let r    : kg/kmol  = steady(mass) + dr                  "set-point"

eq d/dt C_m = -(k_p + k_fm)*C_m*P_0 + F*(C_m0 - C_m)/V
eq d/dt C_I = -k_I*C_I + (F_I*C_I0 - F*C_I)/V
eq d/dt D_0 = (0.5*k_Tc + k_Td)*sq(P_0) + k_fm*C_m*P_0 - F*D_0/V
eq d/dt D_1 = M_m*(k_p + k_fm)*C_m*P_0 - F*D_1/V

steady { F_I = 0.016783 }
initial x = value(steady(x))    for x in states

observe C_m, C_I, mass in 0..100000, e : kg/kmol = r - mass in -50000..50000
level online "the molecular mass, a step late, with noise" { observe mass in 0..100000 delay 1 noise normal(0, 100), r in 0..100000 }

reward tracking default = -sq((r - mass)/1000 [kg/kmol])    "squared deviation from the set-point"
constraint short_chains when mass < 15000 [kg/kmol]
fail state_box when outside bounds(C_m, C_I, D_0, D_1)
episode { step = 0.03 [h], max_steps = 200, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/mma.eq`, against Doyle, Ogunnaike and Pearson 1995 ----

test "the published operating point" {
  start steady
  expect C_m within 1e-5 of 5.506774
  expect C_I within 2e-6 of 0.132906
  expect D_0 within 1e-7 of 0.0019752
  expect D_1 within 5e-4 of 49.38182
}
