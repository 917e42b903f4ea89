model BiofilterBed "a biofilm on carriers takes up a substrate from water"

# Biofilter: models/lib/biofilter.eq, after S. P. P. Ottengraf and A. H. C. van den Oever 1983.

time t : h
unit amount = 1 [g]
set species = { S }
table feed[species] : g/m^3 = { S: 50 }
use "lib/biofilter.eq"
action Q : m^3/h = 1 in 0.2..3    "flow"
param K_S   : g/L = 0.01  in 0..inf    "half-saturation of the uptake"
param q_max : 1/h = 0.2   in 0..inf    "largest uptake by biomass"
use Feed as supply(driven = true, c = feed)
use Biofilter as bed(cells = 20, layers = 10, K_S = K_S, q_max = q_max)
eq supply.outlet.Q = Q
connect supply.outlet -> bed.inlet
observe S_out : g/m^3 = bed.outlet.c[S] in 0..100
episode { step = 0.1 [h], max_steps = 60 }

test "a first-order film has the effectiveness of its closed form, in each of the mixed cells" {
  start nominal
  K_S = 1e3
  q_max = 2e3/3
  for 40 [h]
  expect bed.outlet.c[S] within 0.05 of 50 [g/m^3]*(1 + 10*sqrt(20*3.6e-6)*tanh(2e-4*sqrt(20/3.6e-6)))^-20
}
