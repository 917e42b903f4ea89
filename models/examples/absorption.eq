model Absorption "ammonia is washed from air with water in twelve stages"

# Balances and stages: models/lib/absorber.eq. Henry's constant of ammonia in water at 20 degC is near 0.77 bar (Perry's Chemical
# Engineers' Handbook, dilute solutions). The test has the dilute limit of A. Kremser, Nat. Petrol. News 22 (1930) 48.

time t : min
set species = { carrier, solvent, ammonia }
set solutes = { ammonia }
use "lib/absorber.eq"
action gas   : kmol/h = 100  in 50..150    "flow of gas"
action water : kmol/h = 120  in 80..200    "flow of water"
param y_in  : 1   = 0.03     in 0..0.5    "mole fraction of ammonia in the gas"
param henry : bar = 0.77     in 0..inf    "Henry's constant"
param p     : bar = 1.01325  in 0..inf    "pressure"
use Absorber as column(stages = 6, M = 2 [kmol])
eq column.gas_in.F             = gas
eq column.gas_in.x[ammonia]    = y_in
eq column.gas_in.x[carrier]    = 1 - y_in
eq column.gas_in.x[solvent]    = 0
eq column.liquid_in.F          = water
eq column.liquid_in.x[solvent] = 1
eq column.liquid_in.x[ammonia] = 0
eq column.liquid_in.x[carrier] = 0
eq column.K[ammonia]           = henry/p
observe y_out = column.gas_out.x[ammonia] in 0..0.1, x_out = column.liquid_out.x[ammonia] in 0..0.1
episode { step = 1 [min], max_steps = 60 }

test "a dilute gas leaves as Kremser states" {
  start nominal
  y_in = 1e-6
  henry = 1.01325
  water = 150
  for 400 [min]
  expect 1 - column.gas_out.x[ammonia]/1e-6 within 1e-5 of (1.5^7 - 1.5)/(1.5^7 - 1)
}
