model ControlValve "a sticking valve keeps a level in a limit cycle"

# Stiction of Q. P. He et al. 2007, controller, valve and sensor: models/lib/control.eq and flow.eq.

time t : min
unit amount = 1 [g]
set species = { water }
use "lib/flow.eq"
action setpoint : m     = 1  in 0.5..1.5    "level"
action demand   : m^3/h = 3  in 1..5        "flow out of the tank"
use LinearValve as V(K_v = 6)
use Stiction as stem(static = 0.05, kinetic = 0.02)
use Tank as tank(A = 0.5 [m^2])
use Sensor as LT(tau = 5 [s])
use PI as LC(K = 3, T_i = 2 [min])
eq V.dp             = 1 [bar]
eq V.inlet.c[water] = 0
eq V.inlet.T        = 20 [degC]
connect V.outlet -> tank.inlet
connect LT.output -> LC.measured
connect LC.output -> stem.input
connect stem.output -> V.opening
eq LT.input.y    = tank.h/(2 [m])
eq LC.setpoint   = setpoint/(2 [m])
eq tank.outlet.Q = demand
observe h = tank.h in 0..2, opening = stem.stem in 0..1, output = LC.output.y in 0..1
episode { step = 0.2 [min], max_steps = 150 }

test "the level oscillates within a few percent of its set-point" {
  start nominal
  for 120 [min]
  expect tank.h within 0.05 of 1
}
