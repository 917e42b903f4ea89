model Atropine "Continuous-flow synthesis of atropine: three mixers, three tubular reactors, a liquid-liquid separator"

# A. Nikolakopoulou, M. von Andrian, R. D. Braatz, American Control Conference 2020.

time t : min

table over species {
  columns: M [g/mol], rho [g/L], D [1]
  tropine:              141.21, 1020,   1e-10
  DMF:                  73.09,  944,    1e-10
  phenylacetylchloride: 154.59, 1169,   1e-10
  intermediate:         295.80, 1094.5, 1e-10
  formaldehyde:         30.03,  815,    1e-10
  methanol:             32.04,  792,    1e-10
  NaOH:                 40.00,  2130,   1e-10
  water:                18.02,  997,    1e-10
  atropine:             289.37, 1200,   0.01
  apoatropine:          271.35, 1130,   1e-10
  tropine_ester:        259.34, 1100,   1e-10
  NaCl:                 58.44,  2160,   1e-10
  NH4Cl:                53.49,  1530,   1e-10
  toluene:              92.14,  867,    1e-10
}

set feeds = { S1, S2, S3, S4, S5, S6 }

table w_feed[feeds, species] default 0 "composition of the feeds, mass fractions" {
  S1: tropine = 0.293, DMF = 0.707
  S2: phenylacetylchloride = 1
  S3: formaldehyde = 0.37, water = 0.63
  S4: NaOH = 0.138, water = 0.862
  S5: NH4Cl = 0.022, water = 0.978
  S6: toluene = 1
}

param R_gas : J/(mol K) = 8.314     "gas constant"
param q1_ss : mL/min    = 0.4078    "nominal flow of feed S1"
param q2_ss : mL/min    = 0.1089    "nominal flow of feed S2"
param q3_ss : mL/min    = 0.3888    "nominal flow of feed S3"
param q4_ss : mL/min    = 0.2126    "nominal flow of feed S4"
param q5    : mL/min    = 0.2       "flow of feed S5"
param q6    : mL/min    = 0.5       "flow of feed S6"

param n_grid  = 40    "a cell has the volume V/n_grid of its reactor"
param n_cells = 40    "reacting cells of a reactor"

param reward_scale = 1    "factor on every reward"
param action_penalty[k in 1..4] : min/mL = 0    "weights of the corrections, subtracted from every reward"

action dq1 : mL/min = 0  in -0.00015742..1.92476206e-05    "deviation of feed S1 from nominal"
action dq2 : mL/min = 0  in -0.00146234..1.22118426e-02    "deviation of feed S2 from nominal"
action dq3 : mL/min = 0  in -0.00021812..1.82154982e-03    "deviation of feed S3 from nominal"
action dq4 : mL/min = 0  in -0.00300454..3.59729230e-04    "deviation of feed S4 from nominal"

choice coupling = continuous | held    "what the units send to the next: as it is now, or as it was at the start of the step"

let q1 : mL/min = q1_ss + dq1    "feed S1, tropine in DMF"
let q2 : mL/min = q2_ss + dq2    "feed S2, phenylacetyl chloride"
let q3 : mL/min = q3_ss + dq3    "feed S3, formaldehyde"
let q4 : mL/min = q4_ss + dq4    "feed S4, sodium hydroxide"

let rho_feed[k in feeds]           = 1 / sum(w_feed[k, i] / rho[i] for i in species)
let feed[k in feeds, i in species] = w_feed[k, i] * rho_feed[k]    # g/L

connector Stream { Q : L/min in 0..inf, c[species] : mol/L }

component Mixer "ideal mixing by mass; the volume follows from the densities of the pure species" {
  port inlet, outlet : Stream
  var m[species] : g/min    "mass flows of the feeds that enter here"
  var Q          : L/min    "flow out of the mixer"
  var c[species] : mol/L    "its concentrations"
  let total[i in species] = m[i] + inlet.c[i] * M[i] * inlet.Q
  let density             = sum(total[i] for i in species) / sum(total[i] / rho[i] for i in species)
  eq Q           = sum(total[i] for i in species) / density
  eq c[i]        = total[i] / M[i] / Q    for i in species
  eq outlet.Q    = Q
  eq outlet.c[i] = c[i]                   for i in species
}

component TubularReactor "plug flow, method of lines" {
  param V : mL    "volume"
  param T : K     "temperature"
  port inlet, outlet : Stream
  domain z in 0..V*n_cells/n_grid cells n_cells scheme upwind
  state c[species, z] : mol/L = 0 in 0..50 scale 1
  reaction r1[z]: tropine + phenylacetylchloride -> intermediate
  reaction r2[z]: intermediate + NaOH -> water + tropine_ester + NaCl
  reaction r3[z]: formaldehyde + tropine_ester -> atropine
  reaction r4[z]: formaldehyde + tropine_ester -> water + apoatropine
  table over reactions {
    columns: k_0 [L/(mol min)], E_a [J/mol]
    r1: 34.206, 1000
    r2: 10.0,   100
    r3: 0.024,  1819
    r4: 43.599, 26207
  }
  let  k[j in reactions]       = k_0[j] * exp(-E_a[j] / (R_gas * T))
  let  rate[j in reactions, z] = k[j] * product(c[i, z] for i in species if stoichiometry[j, i] < 0)
  flux N[i in species, z] = inlet.Q * c[i, z], low = inlet.Q * inlet.c[i]
  eq   d/dt c[i, z] = -div(N[i, z]) + source[i, z]    for i in species, z
  let  out[i in species] : mol/L = c[i, z.last]    "concentrations at the outlet"

  # The skeleton of tropine stays what it is in all reactions.
  let  skeleton[z] = c[tropine, z] + c[intermediate, z] + c[tropine_ester, z] + c[atropine, z] + c[apoatropine, z]
  let  fed         = inlet.c[tropine] + inlet.c[intermediate] + inlet.c[tropine_ester] + inlet.c[atropine] + inlet.c[apoatropine]
  let  held        = integral(skeleton[z] for z)
  let  gained      = inlet.Q * (fed - skeleton[z.last])

  eq   outlet.Q    = inlet.Q
  eq   outlet.c[i] = out[i]    for i in species

  when coupling = held {
    discrete sent[i in species] : mol/L = steady(out[i])    "outlet, taken at the start of the step"
    at start { next sent[i] = out[i]    for i in species }
    eq outlet.c[i] = sent[i]    for i in species
  }
}

component Separator "well mixed; splits by partition coefficients and by the solvents' masses at the inlet" {
  param V : mL = 110    "volume"
  port inlet : Stream
  state c[species] : mol/L = 0 in 0..50 scale 1
  let contents[i in species]           = c[i]
  let toluene_share                    = inlet.c[toluene] * M[toluene] / (inlet.c[toluene] * M[toluene] + inlet.c[water] * M[water])
  let F_OR[i in species]     : mol/min = F_AQ[i] * D[i] * Q_OR / Q_AQ                           "organic outlet"
  let F_AQ[i in species]     : mol/min = inlet.Q * contents[i] * Q_AQ / (Q_AQ + Q_OR * D[i])    "aqueous outlet"
  let Q_OR : L/min = toluene_share * inlet.Q    "organic outlet"
  let Q_AQ : L/min = inlet.Q - Q_OR             "aqueous outlet"
  eq d/dt c[i] = inlet.Q / V * (inlet.c[i] - c[i])    for i in species

  when coupling = held {
    discrete contents[i in species] : mol/L = steady(c[i])    "contents, reported at the end of the step"
    at end { next contents[i] = c[i]    for i in species }
  }
}

use Mixer as M1, M2, M3
use TubularReactor as R1(V = 2 [mL], T = 373.15 [K])
use TubularReactor as R2(V = 9.5 [mL], T = 373.15 [K])
use TubularReactor as R3(V = 9.5 [mL], T = 323.15 [K])
use Separator as SEP

connect M1.outlet -> R1.inlet
connect R1.outlet -> M2.inlet
connect M2.outlet -> R2.inlet
connect R2.outlet -> M3.inlet
connect M3.outlet -> R3.inlet
connect R3.outlet -> SEP.inlet

eq M1.inlet.Q    = 0 [L/min]
eq M1.inlet.c[i] = 0 [mol/L]                              for i in species
eq M1.m[i]       = feed[S1, i] * q1 + feed[S2, i] * q2    for i in species
eq M2.m[i]       = feed[S3, i] * q3 + feed[S4, i] * q4    for i in species
eq M3.m[i]       = feed[S5, i] * q5 + feed[S6, i] * q6    for i in species

let waste            = sum(M[i] * SEP.F_OR[i] for i in species - water) + sum(M[i] * SEP.F_AQ[i] for i in species - water - atropine)
let product_flow     = M[atropine] * SEP.F_AQ[atropine]
let E            : 1 = waste / product_flow    "E-factor: mass of waste per mass of product"
let E_ss         : 1 = steady(E)               "E-factor of the steady state at nominal flows"

initial x ~ value(steady(x)) * uniform(0.99, 1.01)    for x in states

# Kalman filter on the linear model of E around the nominal point: xe <- A xe + B dq + K (E - E_ss - C xe), 10 min a step.
param A_11          = 0.8553681500245393,     A_12          = -0.040005411427242246
param A_21          = -0.03702964544887152,   A_22          = 0.9181461106890254
param B_11 : min/mL = 0.2451891771967564,     B_12 : min/mL = 1.448514932971861
param B_13 : min/mL = 0.34265837280684747,    B_14 : min/mL = -0.4586499512840993
param B_21 : min/mL = -0.14993010290910921,   B_22 : min/mL = 0.7335851119462937
param B_23 : min/mL = 0.11776016053001746,    B_24 : min/mL = -0.0690655769417201
param C_1           = -8.80078396557395,      C_2           = -10.216601412102953
param K_1           = -0.013204139084379996,  K_2           = -0.04387914100488464

discrete xe1     = 0.001  in -5..5     "estimated state of the linear model"
discrete xe2     = 0.001  in -5..5     "estimated state of the linear model"
discrete n_steps = 0      in 0..100    "completed steps"

invariant skeletons = R1.held + R2.held + R3.held rate R1.gained + R2.gained + R3.gained    "skeletons of tropine"

let innovation = E - E_ss - (C_1*xe1 + C_2*xe2)

at start { next n_steps = n + 1 }
at end {
  next xe1 = A_11*xe1 + A_12*xe2 + B_11*dq1 + B_12*dq2 + B_13*dq3 + B_14*dq4 + K_1*innovation
  next xe2 = A_21*xe1 + A_22*xe2 + B_21*dq1 + B_22*dq2 + B_23*dq3 + B_24*dq4 + K_2*innovation
}

observe n_steps, q1_ss in 0..0.5, q2_ss in 0..0.5, q3_ss in 0..0.5, q4_ss in 0..0.5, E_ss in 0..15, E in 0..20, xe1, xe2
observe SEP.F_OR in 0..0.5, SEP.F_AQ in 0..0.5, SEP.Q_OR in 0..0.5, SEP.Q_AQ in 0..0.5

level online "counter, flows of the feeds, flows out of the separator; compositions are hidden" {
  observe n_steps, q1 in 0..1, q2 in 0..1, q3 in 0..1, q4 in 0..1, SEP.Q_OR in 0..0.5, SEP.Q_AQ in 0..0.5
}
level chromatograph extends online "with the E-factor and the product every half hour, ten minutes late" {
  observe E in 0..20 every 3 delay 1 noise normal(0, 0.05)
  observe product : mol/min = SEP.F_OR[atropine] in 0..0.5 every 3 delay 1 noise normal(0, 1e-6)
}
level with_flows "the flows of the feeds after the counter" {
  observe n_steps, q1 in 0..1, q2 in 0..1, q3 in 0..1, q4 in 0..1
  observe q1_ss in 0..0.5, q2_ss in 0..0.5, q3_ss in 0..0.5, q4_ss in 0..0.5, E_ss in 0..15, E in 0..20, xe1, xe2
  observe SEP.F_OR in 0..0.5, SEP.F_AQ in 0..0.5, SEP.Q_OR in 0..0.5, SEP.Q_AQ in 0..0.5
}

let penalty = sqrt(sq(action_penalty[1]*dq1) + sq(action_penalty[2]*dq2) + sq(action_penalty[3]*dq3) + sq(action_penalty[4]*dq4))
def scored(r) = max(-100000, reward_scale * (r - penalty))

reward tracking default = scored(-abs(E - E_ss))     "distance of the E-factor from its steady value"
reward saving           = scored(E_ss - E)           "waste saved against the steady state"
reward efactor          = scored(-abs(E))            "the E-factor itself"
reward improvement      = scored(previous(E) - E)    "its decrease over the step"

fail observation_box when outside bounds(observations)

episode { step = 10 [min], max_steps = 60, error_reward = -100000 }
solver  { rtol = 1e-8, algebraic_error_control = true }

def steered1(nominal) = nominal - 0.0006933485803061856*xe1 - 0.0003452202636051542*xe2
def steered2(nominal) = nominal - 0.032119998598558845*xe1 - 0.049179882780950236*xe2
def steered3(nominal) = nominal - 0.006633014571480142*xe1 - 0.010010232591643865*xe2
def steered4(nominal) = nominal + 0.007345773441016798*xe1 + 0.010820764956380933*xe2

policy mpc "horizon 30 on the linear model, a constant gain since no bound is ever active" {
  dq1 = steered1(0)
  dq2 = steered2(0)
  dq3 = steered3(0)
  dq4 = steered4(0)
}

variant relaxed "wider box of the deviations" {
  action dq1 : mL/min = 0  in -0.00016..2e-5
  action dq2 : mL/min = 0  in -0.0015..1.3e-2
  action dq3 : mL/min = 0  in -0.00022..2e-3
  action dq4 : mL/min = 0  in -0.00301..4e-4
}
variant absolute "the actions are the flows themselves" {
  action q1 : mL/min = 0.4078  in 0.4075..0.408
  action q2 : mL/min = 0.1089  in 0.105..0.125
  action q3 : mL/min = 0.3888  in 0.387..0.392
  action q4 : mL/min = 0.2126  in 0.208..0.214
  let dq1 = q1 - q1_ss
  let dq2 = q2 - q2_ss
  let dq3 = q3 - q3_ss
  let dq4 = q4 - q4_ss
  policy mpc {
    q1 = steered1(0.4078)
    q2 = steered2(0.1089)
    q3 = steered3(0.3888)
    q4 = steered4(0.2126)
  }
}
variant absolute_relaxed extends absolute "the actions are the flows themselves, in a wider box" {
  action q1 : mL/min = 0.4078  in 0.3..0.5
  action q2 : mL/min = 0.1089  in 0..0.2
  action q3 : mL/min = 0.3888  in 0.2..0.5
  action q4 : mL/min = 0.2126  in 0.1..0.4
}
variant reward_floor "a reward at the error reward ends the episode" { fail reward_floor when reward <= error_reward }
variant late_counter "the observed counter is the one before its increment" { at start { next n_steps = n } }
variant penalty_added "the penalty of the action raises the reward, as in the original" {
  def scored(r) = max(-100000, reward_scale * (r + penalty))
}

# ---- The plant's world: what else changes, each alone or together ----

variant feed_disturbances "the pumps of the feeds S5 and S6 wander" {
  param q5_mean : mL/min = 0.2    "mean flow of feed S5"
  param q6_mean : mL/min = 0.5    "mean flow of feed S6"
  disturbance q5_shift = 0 ~ 0.9*q5_shift + normal(0, 1)    "flow of S5 beyond its mean, in parts of a thousand"
  disturbance q6_shift = 0 ~ 0.9*q6_shift + normal(0, 1)    "flow of S6 beyond its mean, in parts of a thousand"
  let q5 : mL/min = q5_mean * (1 + 0.001*q5_shift)    "flow of feed S5"
  let q6 : mL/min = q6_mean * (1 + 0.001*q6_shift)    "flow of feed S6"
}
variant sensor_bias "the E-factor is computed from assays with an offset that drifts" {
  random offset_E ~ normal(0, 1)
  disturbance drift_E = 0 ~ drift_E + 0.005*normal(0, 1)    "drift of the assays"
  observe E = E + 0.02*offset_E + drift_E in 0..20
}

# ---- Tests: `smpl test models/atropine.eq`, against published steady states ----

test "the steady E-factor" {
  start steady
  expect E within 1e-8 of 12.835394888664714
  steps 60
  expect steady
  expect E within 1e-6 of 12.835394888664714
}
test "the steady E-factor of the grid of the published figure" {
  scenario coupled39
  start steady
  expect E within 1e-8 of 13.057264952551748
}
