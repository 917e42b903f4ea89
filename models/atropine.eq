model Atropine "Continuous-flow synthesis of atropine: three mixers, three tubular reactors, a liquid-liquid separator"

# A. Nikolakopoulou, M. von Andrian, R. D. Braatz, American Control Conference 2020.

time t : min

set reactions = { r1, r2, r3, r4 }

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

table over reactions {
  columns: k_0 [L/(mol min)], E_a [J/mol]
  r1: 34.206, 1000
  r2: 10.0,   100
  r3: 0.024,  1819
  r4: 43.599, 26207
}

table nu[reactions, species] default 0 "stoichiometric coefficients" {
  r1: tropine = -1, phenylacetylchloride = -1, intermediate = 1
  r2: intermediate = -1, NaOH = -1, water = 1, tropine_ester = 1, NaCl = 1
  r3: formaldehyde = -1, tropine_ester = -1, atropine = 1
  r4: formaldehyde = -1, tropine_ester = -1, water = 1, apoatropine = 1
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

param R_gas : J/(mol K) = 8.314    "gas constant"
param q1_ss : mL/min = 0.4078    "nominal flow of feed S1"
param q2_ss : mL/min = 0.1089    "nominal flow of feed S2"
param q3_ss : mL/min = 0.3888    "nominal flow of feed S3"
param q4_ss : mL/min = 0.2126    "nominal flow of feed S4"
param q5    : mL/min = 0.2       "flow of feed S5"
param q6    : mL/min = 0.5       "flow of feed S6"

action dq1 : mL/min = 0 in -0.00015742..1.92476206e-05    "deviation of feed S1 from nominal"
action dq2 : mL/min = 0 in -0.00146234..1.22118426e-02    "deviation of feed S2 from nominal"
action dq3 : mL/min = 0 in -0.00021812..1.82154982e-03    "deviation of feed S3 from nominal"
action dq4 : mL/min = 0 in -0.00300454..3.59729230e-04    "deviation of feed S4 from nominal"

let rho_feed[k in feeds] = 1 / sum(w_feed[k, i] / rho[i] for i in species)

connector Stream { Q : L/min, c[species] : mol/L }

component Mixer "ideal mixing by mass; the volume follows from the densities of the pure species" {
  port inlet, outlet : Stream
  var m[species] : g/min                     # mass flows of the feeds that enter here
  let total[i in species] = m[i] + inlet.c[i] * M[i] * inlet.Q
  let density = sum(total[i] for i in species) / sum(total[i] / rho[i] for i in species)
  eq outlet.Q = sum(total[i] for i in species) / density
  eq outlet.c[i] = total[i] / M[i] / outlet.Q    for i in species
}

component TubularReactor(n_cells = 40, n_grid = 40) "plug flow, method of lines" {
  param V : mL     "volume"
  param T : K      "temperature"
  port inlet, outlet : Stream
  domain z in 0..V*n_cells/n_grid cells n_cells scheme upwind
  state c[species, z] : mol/L = 0 in 0..50
  let  k[j in reactions] = k_0[j] * exp(-E_a[j] / (R_gas * T))
  let  rate[j in reactions, z] = k[j] * product(c[i, z] for i in species if nu[j, i] < 0)
  flux N[i in species, z] = inlet.Q * c[i, z], low = inlet.Q * inlet.c[i]
  eq   d/dt c[i, z] = -div(N[i, z]) + sum(nu[j, i] * rate[j, z] for j in reactions)    for i in species, z
  eq   outlet.Q = inlet.Q
  eq   outlet.c[i] = c[i, z.last]    for i in species
}

component Separator "well mixed; splits by partition coefficients and by the solvents' masses at the inlet" {
  param V : mL = 110    "volume"
  port inlet : Stream
  state c[species] : mol/L = 0 in 0..50
  let toluene_share = inlet.c[toluene] * M[toluene] / (inlet.c[toluene] * M[toluene] + inlet.c[water] * M[water])
  let Q_OR : L/min = toluene_share * inlet.Q                         "organic outlet"
  let Q_AQ : L/min = inlet.Q - Q_OR                                  "aqueous outlet"
  let F_AQ[i in species] : mol/min = inlet.Q * c[i] * Q_AQ / (Q_AQ + Q_OR * D[i])    "molar flows of the aqueous outlet"
  let F_OR[i in species] : mol/min = F_AQ[i] * D[i] * Q_OR / Q_AQ                    "molar flows of the organic outlet"
  eq d/dt c[i] = inlet.Q / V * (inlet.c[i] - c[i])    for i in species
}

use Mixer as M1, M2, M3
use TubularReactor as R1(V = 2 [mL],   T = 373.15 [K])
use TubularReactor as R2(V = 9.5 [mL], T = 373.15 [K])
use TubularReactor as R3(V = 9.5 [mL], T = 323.15 [K])
use Separator as SEP

connect M1.outlet -> R1.inlet
connect R1.outlet -> M2.inlet
connect M2.outlet -> R2.inlet
connect R2.outlet -> M3.inlet
connect M3.outlet -> R3.inlet
connect R3.outlet -> SEP.inlet

eq M1.inlet.Q = 0 [L/min]
eq M1.inlet.c[i] = 0 [mol/L]    for i in species
eq M1.m[i] = w_feed[S1, i] * rho_feed[S1] * (q1_ss + dq1) + w_feed[S2, i] * rho_feed[S2] * (q2_ss + dq2)    for i in species
eq M2.m[i] = w_feed[S3, i] * rho_feed[S3] * (q3_ss + dq3) + w_feed[S4, i] * rho_feed[S4] * (q4_ss + dq4)    for i in species
eq M3.m[i] = w_feed[S5, i] * rho_feed[S5] * q5 + w_feed[S6, i] * rho_feed[S6] * q6    for i in species

let waste   = sum(M[i] * SEP.F_OR[i] for i in species if i != water) + sum(M[i] * SEP.F_AQ[i] for i in species if i != water and i != atropine)
let product_flow = M[atropine] * SEP.F_AQ[atropine]
let E : 1 = waste / product_flow    "E-factor: mass of waste per mass of product"

steady  { dq1 = 0, dq2 = 0, dq3 = 0, dq4 = 0 }
initial x ~ value(steady(x)) * uniform(0.99, 1.01)    for x in states
