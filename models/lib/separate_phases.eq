# The downstream chain of the original: four initial-value problems, each with two units in series, no balance between them.
# 150 cells of L/151 a unit; convection takes the value from downstream; the inlet condition has a void (eps_in) of its own.

param F        : L/min = 21.689197421073914    "flow from the buffer tank before the switch"
param c_s      : M     = 0.9                   "modifier in both elutions"
param n_z              = 150
param n_r              = 10
param sampling : min   = 0.5                   "length of a control step"

phase elute for 6.24 [min] then load_cex
phase load_cex for 216 [min] then elute_cex { reset CEX.cp[z, r] = 0    for z in 1..n_z, r in 1..n_r }
phase elute_cex for 19.98 [min] then flow_through
phase flow_through for 180 [min] then done
phase done

table over phase {
  columns: scaled [1]
  elute: 60/16.7
  load_cex: 11.1/16.7
  elute_cex: 5.6/16.7
  flow_through: 22.2/16.7
  done: 0
}
let flow : L/min = F * scaled[phase]

def released(k, henry, q_max, c, q) = k*(henry*(1 - q/q_max)*c - q)

component Unit "convection and dispersion" {
  param L      : dm    "length"
  param V      : L     "volume"
  param D_v    : dm    "dispersion over superficial velocity"
  param eps            "void in the balance"
  param eps_in         "void in the inlet condition"
  var Q    : L/min
  var c_in : mg/L
  domain z in 0..L*n_z/(n_z + 1) cells n_z scheme downwind
  state c[z] : mg/L = 0 in -inf..inf scale 1    "product"
  let v = Q / (V/L)
  flux J[z] = v/eps*c[z] - D_v*v*grad(c[z]), low = v/eps*c[z.first] - v/eps_in*(c[z.first] - c_in)
  eq  d/dt c[z] = -div(J[z])    for z
  let held : mg = eps_in * V/L * integral(c[z] for z)    "product in the unit, as the original weighs it"
}

use Unit as VI(L = 60 [dm], V = 500 [L], D_v = 29 [dm], eps = 1, eps_in = 1)
use Unit as LOOP(L = 60 [dm], V = 500 [L], D_v = 29 [dm], eps = 1, eps_in = 1)
use Unit as AEX(L = 1 [dm], V = 50 [L], D_v = 0.016 [dm], eps = 0.32, eps_in = 0.34)

component ProteinA "elution of the loaded column by a lumped law; what the pores held is dropped" {
  param L   : dm = 2
  param V   : L  = 100
  param D_v : dm = 0.055
  var Q : L/min
  domain z in 0..L*n_z/(n_z + 1) cells n_z scheme downwind
  state c[z] : mg/L = 0  in -inf..inf  scale 1    "product, mobile"
  state q[z] : mg/L = 0  in -inf..inf  scale 1    "product, bound: fast and slow sites together"
  let v      = Q / (V/L)
  let elutes = if phase == elute then 1 else 0
  flux J[z] = v/0.32*c[z] - D_v*v*grad(c[z]), low = v/0.32*c[z.first] - v/0.31*c[z.first]
  eq d/dt q[z] = elutes*released(0.64 [1/min], 2.2e-2*value(c_s)^(-0.2), 114300 [mg/L], c[z], q[z])    for z
  eq d/dt c[z] = -div(J[z]) - (1 - 0.31)/0.32 * der(q[z])    for z
  let mobile : mg = 0.31 * V/L * integral(c[z] for z)    "product in the liquid"
  let bound  : mg = 0.69 * V/L * integral(q[z] for z)    "product adsorbed"
}
use ProteinA as PA

# The cation exchanger: pores and a linear law while loaded, a lumped law in elution.
component CationExchanger {
  param L     : dm       = 1
  param V     : L        = 50
  param D_v   : dm       = 0.011
  param r_p   : dm       = 4.25e-4
  param D_eff : dm^2/min = 7.6e-7
  var Q    : L/min
  var c_in : mg/L
  domain z in 0..L*n_z/(n_z + 1) cells n_z scheme downwind
  param d_r : dm = r_p/(n_r + 1)
  domain r in 0..r_p cells n_r scheme central faces (k + 1)*d_r areas ((k + 1)*d_r)^2 volumes (k*d_r)^2 * d_r
  state c[z]     : mg/L = 0  in -inf..inf  scale 1    "product, mobile"
  state cp[z, r] : mg/L = 0  in -inf..inf  scale 1    "product, pores"
  state q[z]     : mg/L = 0  in -inf..inf  scale 1    "product, bound"
  let v       = Q / (V/L)
  let eps_in  = if phase == load_cex then 0.31 else 0.34
  let k_f     = 0.0067 [dm/min] * (v / 0.1 [dm/min])^0.58
  let loads   = if phase == load_cex then 1 else 0
  let elutes  = if phase == elute_cex then 1 else 0
  let s[z, r] = 0.704 [1/min] * (cp[z, r] - q[z]/15.3)
  flux J[z] = v/0.34*c[z] - D_v*v*grad(c[z]), low = v/0.34*c[z.first] - v/eps_in*(c[z.first] - c_in)
  flux G[z, r] = -D_eff*grad(cp[z, r]), low = 0, high = -k_f*(c[z] - cp[z, r.last])
  eq d/dt q[z] = loads*s[z, r.last]
                 + elutes*released(0.99 [1/min], 6.9e-4*value(c_s)^(-8.5), 150200 [mg/L], c[z], q[z])    for z
  eq d/dt c[z]     = -div(J[z]) - (loads*0.69 + elutes*0.66)/0.34 * der(q[z])    for z
  eq d/dt cp[z, r] = loads*(-div(G[z, r]) - s[z, r]/0.94)                        for z, r
  let mobile : mg = eps_in * V/L * integral(c[z] for z)    "product in the liquid"
  # As the original weighs it: pore cells with faces halfway between the nodes.
  def face(k) = if k == 0 then 0 else if k == n_r then k + 1 else k + 0.5
  let pores : mg = 0.69*0.94 * V/L * integral(sum(cp[z, k]*(face(k)^3 - face(k - 1)^3) for k in 1..n_r) for z) / (n_r + 1)^3    "product in the pores"
  let bound : mg = (if phase == load_cex then 0.69 else 0.66) * V/L * integral(q[z] for z)    "product adsorbed"
}
use CationExchanger as CEX

eq PA.Q      = if phase == elute then flow else 0
eq VI.Q      = if phase == elute or phase == load_cex then flow else 0
eq VI.c_in   = if phase == elute then PA.c[n_z] else 0
eq CEX.Q     = if phase == load_cex or phase == elute_cex then flow else 0
eq CEX.c_in  = if phase == load_cex then VI.c[n_z] else 0
eq LOOP.Q    = if phase == elute_cex or phase == flow_through then flow else 0
eq LOOP.c_in = if phase == elute_cex then CEX.c[n_z] else 0
eq AEX.Q     = if phase == flow_through then flow else 0
eq AEX.c_in  = LOOP.c[n_z]

state m_eluted   : mg = 0  in 0..inf  scale 1e3    "antibody that leaves Protein A"
state m_missed   : mg = 0  in 0..inf  scale 1e3    "antibody that leaves the first loop during the elution and goes nowhere"
state m_loaded   : mg = 0  in 0..inf  scale 1e3    "antibody that enters the cation exchanger"
state m_passed   : mg = 0  in 0..inf  scale 1e3    "antibody that runs through the cation exchanger while it is loaded"
state m_released : mg = 0  in 0..inf  scale 1e3    "antibody that leaves the cation exchanger in its elution"
state m_out      : mg = 0  in 0..inf  scale 1e3    "antibody that leaves the anion exchanger"
eq d/dt m_eluted   = PA.Q*PA.c[n_z]
eq d/dt m_missed   = if phase == elute then VI.Q*VI.c[n_z] else 0
eq d/dt m_loaded   = CEX.Q*CEX.c_in
eq d/dt m_passed   = if phase == load_cex then CEX.Q*CEX.c[n_z] else 0
eq d/dt m_released = if phase == elute_cex then CEX.Q*CEX.c[n_z] else 0
eq d/dt m_out      = AEX.Q*AEX.c[n_z]

action idle_action = 0 in 0..1    "nothing can be done"
observe m_out in 0..1e7
reward recovered : mg default = m_out - previous(m_out)    "antibody that left the anion exchanger"
fail negative when m_out < -1 [mg]
episode { step = sampling, max_steps = 845, error_reward = -100, end_is_success = true }
solver  { rtol = 1e-9, atol_factor = 1 }
