model Perfusion "cells are kept in a bioreactor while medium passes"

# Bioreactor and retention: models/lib/bioreactor.eq, retention.eq. The bleed sets the growth rate at rest.

time t : h
unit amount = 1 [g]
set species = { X, S, P }
table retained[species] : 1 = { X: 0.98, S: 0, P: 0 }
table medium[species] : g/L = { X: 0, S: 20, P: 0 }
use "lib/bioreactor.eq"
use "lib/retention.eq"
action F     : L/h = 50  in 10..100    "fresh medium"
action bleed : L/h = 5   in 1..20      "outflow with cells"
use Feed as fresh(driven = true, T = 37 [degC], c = medium)
use Mixer as mixer
use Bioreactor as B(Y_PX = 0.2)
use Splitter as split
use Retention as R
eq fresh.outlet.Q = F
connect fresh.outlet -> mixer.inlet_1
connect R.retentate -> mixer.inlet_2
connect mixer.outlet -> B.inlet
connect B.outlet -> split.inlet
connect split.outlet_2 -> R.inlet
eq B.outlet.Q   = 300 [L/h]
eq split.share  = bleed/(300 [L/h])
eq R.permeate.Q = F - bleed
observe X : g/L = B.c[X] in 0..100, S : g/L = B.c[S] in 0..20, P : g/L = R.permeate.c[P] in 0..20
episode { step = 1 [h], max_steps = 200 }

test "cells grow at the rate of their loss" {
  start nominal
  bleed = 20
  for 2000 [h]
  expect B.mu within 1e-6 of 0.0206 [1/h]
}
