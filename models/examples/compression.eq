model Compression "a compressor fills a vessel, from which consumers draw gas"

# Compressor with its map, and vessel: models/lib/compressor.eq; the air comes from the surroundings.

time t : s
use "lib/compressor.eq"
action speed : 1      = 0.95  in 0.7..1.1    "share of the full speed"
action draw  : kmol/h = 150   in 100..220    "flow to the consumers"
use Compressor as K
use GasVessel as vessel(V = 10 [m^3], UA = 1 [kW/K])
eq K.inlet.p = 1 [bar]
eq K.inlet.T = 293 [K]
eq K.speed.y = speed
connect K.outlet -> vessel.inlet
eq vessel.outlet.n = draw
initial vessel.p = 2
initial vessel.T = 350
observe p = vessel.p in 0..5, T = vessel.T in 250..500, place = K.place in 0..2, power = K.power in 0..500
episode { step = 1 [s], max_steps = 90 }

test "the vessel rests where the map gives the flow of the consumers" {
  start nominal
  for 4000 [s]
  expect K.inlet.n within 1e-3 of 150
  expect K.place > 0.5
}
