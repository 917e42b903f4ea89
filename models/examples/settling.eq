model Settling "a secondary settler of activated sludge, with a change of its feed"

# Settler of I. Takacs et al. 1991: models/lib/settler.eq.

time t : h
unit amount = 1 [g]
set species = { X, S }
set solids = { X }
set solubles = { S }
table sludge[species] : g/m^3 = { X: 4000, S: 30 }
use "lib/settler.eq"
action Q      : m^3/h = 1500  in 500..3000    "feed"
action return : m^3/h = 750   in 300..1500    "underflow"
use Feed as supply(driven = true, c = sludge)
use Settler as settler
eq supply.outlet.Q = Q
connect supply.outlet -> settler.inlet
eq settler.underflow.Q = return
observe effluent : g/m^3 = settler.X[10] in 0..1000, underflow : g/m^3 = settler.X[1] in 0..20000
episode { step = 0.5 [h], max_steps = 96 }

test "solids leave as they come in at rest" {
  start nominal
  for 600 [h]
  expect (settler.effluent.Q*settler.X[10] + settler.underflow.Q*settler.X[1])/settler.inlet.Q within 0.1 of 3000 [g/m^3]
}
