model LithiumIon "Single-particle model of a lithium-ion cell: diffusion in two electrodes"

# S. G. Marquis, V. Sulzer, R. Timms, C. P. Please, S. J. Chapman, An asymptotic derivation of a single particle model with
# electrolyte, Journal of the Electrochemical Society 166 (2019) A3693-A3706: geometry, kinetics, diffusion; open-circuit
# potentials of graphite and lithium cobalt oxide by Dualfoil (1998). The electrolyte is uniform.
#
# Task: charge from a tenth to nine tenths fast, below 4.2 V; the temperature varies.
#
# Checked: the charge balance of both electrodes; the parabola of slow diffusion, surface less mean = j R/(5 D); trajectories of
# SciPy with the same shells.

time t : min

param L_n     : um              = 100                                                               "thickness of the negative electrode"
param L_p     : um              = 100                                                               "thickness of the positive electrode"
param area    : m^2             = 0.137*0.207                                                       "area of the electrodes"
param R_n     : um              = 10                                                                "radius of the negative particles"
param R_p     : um              = 10                                                                "radius of the positive particles"
param eps_n                     = 0.6                                                               "share of the negative electrode that is active"
param eps_p                     = 0.5                                                               "share of the positive electrode that is active"
param D_n     : m^2/s           = 3.9e-14                                                           "diffusivity of the negative particles"
param D_p     : m^2/s           = 1e-13                                                             "diffusivity of the positive particles"
param c_n_max : mol/m^3         = 24983.2619938437                                                  "capacity of the negative particles"
param c_p_max : mol/m^3         = 51217.9257309275                                                  "capacity of the positive particles"
param c_e     : mol/m^3         = 1000                                                              "electrolyte"
param m_n     : A m^2.5/mol^1.5 = 2e-5                                                              "exchange current of the negative electrode"
param m_p     : A m^2.5/mol^1.5 = 6e-7                                                              "exchange current of the positive electrode"
param Fa      : C/mol           = 96485.33212                                                       "Faraday constant"
param R_gas   : J/(mol K)       = 8.314462618                                                       "gas constant"
param x_n0                      = 0.26                                                              "lithium in the negative electrode at the start, relative"
param x_p0                      = 0.6 + (0.8 - 0.26)*0.6*24983.2619938437/(0.5*51217.9257309275)    "lithium in the positive electrode at the start"

action I : A = 0 in -2.1..0.7    "current, positive while the cell is discharged"

domain r in 0..R_n cells 20 scheme central geometry spherical
domain q in 0..R_p cells 20 scheme central geometry spherical
state c_n[r] : mol/m^3 = 6495.648  in 0..25000    "lithium in the negative particles"
state c_p[q] : mol/m^3 = 48720     in 0..51300    "lithium in the positive particles"

disturbance T : K = 298.15 ~ 298.15 [K] + 0.95*(T - 298.15 [K]) + 0.3 [K]*normal(0, 1) clip bounds in 288..308    "temperature"

let j_n : mol/(m^2 s) = I/(Fa*area*L_n*3*eps_n/R_n)     "flux out of the negative particles"
let j_p : mol/(m^2 s) = -I/(Fa*area*L_p*3*eps_p/R_p)    "flux out of the positive particles"
flux N_n[r] = -D_n*grad(c_n[r]), low = 0, high = j_n
flux N_p[q] = -D_p*grad(c_p[q]), low = 0, high = j_p
eq d/dt c_n[r] = -div(N_n[r])    for r
eq d/dt c_p[q] = -div(N_p[q])    for q

let s_n : mol/m^3 = clip(c_n[r.last] - j_n*R_n/40/D_n, 1 [mol/m^3], 0.999*c_n_max)    "surface of the negative particles"
let s_p : mol/m^3 = clip(c_p[q.last] - j_p*R_p/40/D_p, 1 [mol/m^3], 0.999*c_p_max)    "surface of the positive particles"
let x   : 1       = s_n/c_n_max
let y   : 1       = 1.062*s_p/c_p_max
let U_n : V = (0.194 + 1.5*exp(-120*x) + 0.0351*tanh((x - 0.286)/0.083) - 0.0045*tanh((x - 0.849)/0.119) - 0.035*tanh((x - 0.9233)/0.05)
               - 0.0147*tanh((x - 0.5)/0.034) - 0.102*tanh((x - 0.194)/0.142) - 0.022*tanh((x - 0.9)/0.0164)
               - 0.011*tanh((x - 0.124)/0.0226) + 0.0155*tanh((x - 0.105)/0.029)) as [V]    "potential of graphite"
let U_p : V = (2.16216 + 0.07645*tanh(30.834 - 54.4806*y) + 2.1581*tanh(52.294 - 50.294*y) - 0.14169*tanh(11.0923 - 19.8543*y)
               + 0.2051*tanh(1.4684 - 5.4888*y) + 0.2531*tanh((0.56478 - y)/0.1316) - 0.02167*tanh((y - 0.525)/0.006)) as [V]    "potential of lithium cobalt oxide"
def asinh(z) = ln(z + sqrt(sq(z) + 1))
let eta_n : V = 2*R_gas*T/Fa*asinh(Fa*j_n/(2*m_n*sqrt(c_e*s_n*(c_n_max - s_n))))    "overpotential of the negative electrode"
let eta_p : V = 2*R_gas*T/Fa*asinh(Fa*j_p/(2*m_p*sqrt(c_e*s_p*(c_p_max - s_p))))    "overpotential of the positive electrode"
let V     : V = U_p - U_n + eta_p - eta_n                                           "voltage of the cell"
let soc   : 1 = (mean(c_n[r] for r)/c_n_max - 0.2)/0.6                              "state of charge"

initial c_n[r] = x_n0*value(c_n_max)    for r
initial c_p[q] = x_p0*value(c_p_max)    for q

observe soc in -0.2..1.3, V in 2..5, x in 0..1, T in 280..320
level online "voltage, current is known, and temperature" { observe V in 2..5 noise normal(0, 0.002), T in 280..320 noise normal(0, 0.3) }

reward charge default = -sq(soc - 0.9) - 50*sq(max(V - 4.2 [V], 0 [V])/1 [V])    "distance from the aim, and voltage beyond 4.2 V"
constraint voltage when V > 4.2 [V]
fail overcharged when soc > 1.15
fail empty when V < 2.5 [V]
episode { step = 1 [min], max_steps = 60, error_reward = -100 }
solver  { rtol = 1e-8 }
