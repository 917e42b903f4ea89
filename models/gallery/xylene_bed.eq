model XyleneBed "Fixed-bed reactor for the oxidation of o-xylene to phthalic anhydride: one tube with its hot spot"

# G. F. Froment, Fixed bed catalytic reactors: current design status, Industrial and Engineering Chemistry 59 (1967) 18-27; G. F.
# Froment, K. B. Bischoff, Chemical Reactor Analysis and Design (Wiley): pseudo-homogeneous, one-dimensional; A is o-xylene, B phthalic
# anhydride, C carbon dioxide. Heat capacity and void fraction of the bed are of this file: they do not change the steady state.
#
# Task: much phthalic anhydride at a hot spot below 680 K, by temperature of the salt bath, feed and air, while the feed of
# o-xylene varies. The hot spot is sensitive: it runs away.
#
# Checked: the profile of the steady state against a plug-flow integration by SciPy (to the error of 80 cells), and exactly against
# the same cells; trajectories of SciPy.

time t : s

param d_t   : m          = 0.0254      "diameter of the tube"
param L     : m          = 3           "length of the tube"
param rho_b : kg/m^3     = 1300        "density of the bed"
param M     : kg/kmol    = 29.48       "molar mass of the gas"
param c_p   : kJ/(kg K)  = 1.047       "heat capacity of the gas"
param U     : W/(m^2 K)  = 96          "heat transfer to the bath"
param H_1   : kJ/kmol    = -1.285e6    "heat of A -> B"
param H_2   : kJ/kmol    = -3.279e6    "heat of B -> C"
param H_3   : kJ/kmol    = -4.564e6    "heat of A -> C"
param y_O                = 0.208       "oxygen, mole fraction"
param C_b   : kJ/(m^3 K) = 1300        "heat capacity of the bed"
param eps                = 0.4         "void fraction"
param C_g   : kmol/m^3   = 0.0195      "molar density of the gas"

action T_w : K          = 630   in 600..650      "salt bath"
action G   : kg/(m^2 h) = 4684  in 3000..6500    "mass flux of air"

domain z in 0..L cells 80 scheme upwind
state y_A[z]     = 0.005  in 0..0.05    scale 1e-3    "o-xylene"
state y_B[z]     = 0.002  in 0..0.05    scale 1e-3    "phthalic anhydride"
state T[z]   : K = 640    in 300..1500  scale 10      "temperature"

disturbance y_0 = 0.00924 ~ 0.00924 + 0.95*(y_0 - 0.00924) + normal(0, 5e-5) clip bounds in 0.008..0.0105    "o-xylene in the feed"

let k_1[z] : kmol/(kg h) = exp(19.837 - 13636 [K]/T[z])*1 [kmol/(kg h)]
let k_2[z] : kmol/(kg h) = exp(20.86 - 15803 [K]/T[z])*1 [kmol/(kg h)]
let k_3[z] : kmol/(kg h) = exp(18.97 - 14394 [K]/T[z])*1 [kmol/(kg h)]

flux N_A[z] = G/M*y_A[z], low = G/M*y_0
flux N_B[z] = G/M*y_B[z], low = 0
flux Q[z] = G*c_p*T[z], low = G*c_p*T_w

eq eps*C_g * d/dt y_A[z] = -div(N_A[z]) - rho_b*(k_1[z] + k_3[z])*y_A[z]*y_O           for z
eq eps*C_g * d/dt y_B[z] = -div(N_B[z]) + rho_b*(k_1[z]*y_A[z] - k_2[z]*y_B[z])*y_O    for z
eq C_b * d/dt T[z]       = -div(Q[z]) - rho_b*y_O*((H_1*k_1[z] + H_3*k_3[z])*y_A[z] + H_2*k_2[z]*y_B[z]) - 4*U/d_t*(T[z] - T_w)    for z

steady { T_w = 630, G = 4684 }
initial y_A[z] = value(steady(y_A[z]))    for z
initial y_B[z] = value(steady(y_B[z]))    for z
initial T[z]   = value(steady(T[z]))      for z

let T_hot : K            = max(T[i] for i in 1..80)    "hot spot"
let yield : 1            = y_B[z.last]/y_0             "yield of phthalic anhydride"
let made  : kmol/(m^2 h) = G/M*y_B[z.last]             "production"

observe T_hot in 500..1500, yield in 0..1, y_A[z.last], y_B[z.last], y_0 in 0..0.02, T[8], T[16], T[24], T[32], T[40]
level online "five thermometers along the tube" {
  observe T[8] noise normal(0, 0.5), T[16] noise normal(0, 0.5), T[24] noise normal(0, 0.5), T[32] noise normal(0, 0.5), T[40] noise normal(0, 0.5)
}

reward production default = made/1 [kmol/(m^2 h)] - 0.02*max(T_hot - 680 [K], 0 [K])/1 [K]
    "production, less what the hot spot exceeds its limit"
constraint hot when T_hot > 690 [K]
fail runaway when T_hot > 850 [K]
episode { step = 30 [s], max_steps = 120, error_reward = -1000 }
solver  { rtol = 1e-8 }
