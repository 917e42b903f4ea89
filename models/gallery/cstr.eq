model CSTR "Exothermic stirred tank A -> B at constant volume, cooled by a jacket"

# The system cstr of pc-gym (M. Bloor et al., arXiv:2410.22093), with its parameters: the reactor of D. E. Seborg, T. F. Edgar,
# D. A. Mellichamp, Process Dynamics and Control (Wiley), chapter 2, in litres, joules and minutes.
#
# Task: follow a set-point of the concentration that changes every 40 steps; temperature and concentration of the feed vary.
#
# Checked: at T_c = 300 K the steady state c_A = 0.5 mol/L, T = 350 K, which is unstable; trajectories of SciPy.

time t : min

param q      : L/min     = 100                  "flow"
param V      : L         = 100                  "volume"
param rho    : g/L       = 1000                 "density"
param c_p    : J/(g K)   = 0.239                "heat capacity"
param dH     : J/mol     = -5e4                 "heat of reaction (negative: exothermic)"
param E_R    : K         = 8750                 "activation energy over the gas constant"
param k_0    : 1/min     = 7.2e10               "pre-exponential factor"
param UA     : J/(min K) = 5e4                  "heat transfer of the jacket"
param change : mol/L     = 0.05    in 0..0.1    "largest deviation of the set-point"

action T_c : K = 298 in 290..305    "temperature of the coolant"

state c_A : mol/L = 0.85  in 0..1        "concentration of A"
state T   : K     = 327   in 250..500    "temperature"

disturbance T_i  : K     = 350 ~ 350 [K] + 0.9*(T_i - 350 [K]) + 0.2 [K]*normal(0, 1) clip bounds  in 345..355     "temperature of the feed"
disturbance c_Ai : mol/L = 1   ~ 1 [mol/L] + 0.9*(c_Ai - 1 [mol/L]) + 0.003 [mol/L]*normal(0, 1) clip bounds  in 0.9..1.1    "concentration of the feed"
disturbance dr   : mol/L = 0   ~ if mod(n, 40) == 0 and n > 0 then change*uniform(-1, 1) else dr   in -0.1..0.1    "change of the set-point"

let k : 1/min = k_0*exp(-E_R/T)     "rate constant"
let r : mol/L = steady(c_A) + dr    "set-point"

eq d/dt c_A = q/V*(c_Ai - c_A) - k*c_A
eq d/dt T   = q/V*(T_i - T) - dH/(rho*c_p)*k*c_A + UA/(V*rho*c_p)*(T_c - T)

steady { T_c = 298 }
initial x = value(steady(x))    for x in states

observe c_A, T, e : mol/L = r - c_A in -1..1
level online "thermometer, and the concentration every four steps, a step late" {
  observe T noise normal(0, 0.1), c_A every 4 delay 1 noise normal(0, 0.003), r in 0..1
}

reward tracking default = -sq((r - c_A)/0.02 [mol/L])    "squared deviation from the set-point"
constraint hot when T > 335 [K]
fail runaway when T > 400 [K]
episode { step = 0.25 [min], max_steps = 120, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/cstr.eq`, against Seborg, Edgar and Mellichamp ----

test "half conversion at 350 K is near a steady state" {
  start nominal
  c_A = 0.5
  T = 350
  T_i = 350
  c_Ai = 1
  T_c = 300
  expect steady within 1e-2
}
test "a colder jacket quenches the reactor" {
  start nominal
  T_c = 290 for 20 [min]
  expect T < 330 [K]
}
