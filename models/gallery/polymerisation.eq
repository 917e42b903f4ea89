model Polymerisation "Free-radical polymerisation in a stirred tank: temperature, monomer, initiator"

# The system polymerisation_reactor of pc-gym (M. Bloor et al., arXiv:2410.22093), with its parameters; J. Ingham et al., Chemical
# Engineering Dynamics (Wiley-VCH). Propagation is of first order in the monomer; pc-gym 0.1.8 leaves this factor out.
#
# Task: keep monomer and temperature by feed and feed temperature while the initiator varies; the reaction releases heat.
#
# Checked: T = T_f + (-dH)/(rho c_p) (M_f - M) at rest; trajectories of SciPy.

time t : s

param A_p : m^3/(kmol s) = 6e10    "pre-exponential factor of propagation"
param A_d : 1/s          = 4e10    "pre-exponential factor of decomposition"
param A_t : m^3/(kmol s) = 9e10    "pre-exponential factor of termination"
param E_p : K            = 7750    "activation temperature of propagation"
param E_d : K            = 8500    "activation temperature of decomposition"
param E_t : K            = 8250    "activation temperature of termination"
param f                  = 0.5     "efficiency of the initiator"
param V   : m^3          = 1       "volume"
param dH  : kJ/kmol      = -3e4    "heat of polymerisation (negative: exothermic)"
param rho : kg/m^3       = 1200    "density"
param c_p : kJ/(kg K)    = 2       "heat capacity"
param M_f : kmol/m^3     = 10      "monomer in the feed"

action F   : L/s = 20   in 5..60       "feed"
action T_f : K   = 290  in 270..310    "temperature of the feed"

state T : K        = 368   in 270..500                "temperature"
state M : kmol/m^3 = 3.7   in 0..20                   "monomer"
state I : kmol/m^3 = 1e-5  in 0..0.1    scale 1e-5    "initiator"

disturbance I_f : kmol/m^3 = 1e-3 ~ 1e-3 [kmol/m^3] + 0.95*(I_f - 1e-3 [kmol/m^3]) + 2e-5 [kmol/m^3]*normal(0, 1) clip bounds in 5e-4..2e-3    "initiator in the feed"

let k_p : m^3/(kmol s) = A_p*exp(-E_p/T)
let k_d : 1/s          = A_d*exp(-E_d/T)
let k_t : m^3/(kmol s) = A_t*exp(-E_t/T)
let r_p : kmol/(m^3 s) = k_p*M*sqrt(f*k_d*I/k_t)    "rate of polymerisation"

eq d/dt T = F/V*(T_f - T) - dH/(rho*c_p)*r_p
eq d/dt M = F/V*(M_f - M) - r_p
eq d/dt I = F/V*(I_f - I) - 2*f*k_d*I

steady { F = 20, T_f = 290 }
initial x = value(steady(x))    for x in states

observe T, M, I
level online "thermometer, and monomer every five steps, two steps late" {
  observe T noise normal(0, 0.1), M every 5 delay 2 noise normal(0, 0.02)
}

reward quality default = -sq((M - steady(M))/0.1 [kmol/m^3]) - sq((T - steady(T))/2 [K])    "deviations of monomer and temperature"
constraint hot when T > 385 [K]
fail state_box when outside bounds(T, M, I)
episode { step = 10 [s], max_steps = 150, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }
