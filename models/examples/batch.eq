model Batch "a tank is charged, heated, kept warm and drained, batch after batch"

# Blocks of recipes: models/lib/recipe.eq; the temperature follows a first-order lag of its set-point.

time t : min
unit amount = 1 [g]
set species = { salt }
use "lib/recipe.eq"
use Charge as charge(first = true, volume = 0.5 [m^3], Q = 3 [m^3/h])
use Ramp as heat(duration = 20 [min], from = 0, to = 1)
use Hold as hold(duration = 15 [min])
use RecipeStep as drain
use Tank as tank
eq charge.inlet.c[salt] = 3 [g/m^3]
eq charge.inlet.T       = 20 [degC]
connect charge.outlet -> tank.inlet
connect charge.done -> heat.go
connect heat.done -> hold.go
connect hold.done -> drain.go
connect drain.done -> charge.go
eq tank.outlet.Q  = 2 [m^3/h]*drain.on
eq drain.progress = (1.5 [m] - tank.h)/(0.5 [m])
let T_set : degC = 20 [degC] + 60 [K]*heat.value*(1 - drain.on)*(1 - charge.on)    "set-point of the jacket"
state T_j : degC = 20 in 0..100    "jacket"
eq d/dt T_j = (T_set - T_j)/(2 [min])
observe h = tank.h in 0..3, T_j, heating = heat.on in 0..1, holding = hold.on in 0..1
episode { step = 1 [min], max_steps = 180 }

test "a batch takes an hour: charge 10 min, ramp 20, hold 15, drain 15" {
  start nominal
  for 65 [min]
  expect charge.on > 0.5
  for 7 [min]
  expect tank.h within 1e-6 of 1.5 [m]
  expect heat.on > 0.5
  for 20 [min]
  expect hold.on > 0.5
  for 20 [min]
  expect drain.on > 0.5
}
