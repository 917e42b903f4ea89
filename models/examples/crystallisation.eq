model Crystallisation "batch cooling: crystals nucleate and grow, with the distribution of their sizes"

# Population balance: models/lib/crystalliser.eq, after A. D. Randolph and M. A. Larson 1988. The solubility is a straight line here.

time t : h
unit amount = 1 [kg]
set species = { solute }
use "lib/crystalliser.eq"
action T : degC = 40 in 10..60    "temperature"
use PopulationCrystalliser as C(cells = 100, L_max = 500 [um])
eq C.inlet.Q         = 0
eq C.outlet.Q        = 0
eq C.inlet.T         = 60 [degC]
eq C.inlet.c[solute] = 0
eq C.c_sat           = (60 + value(T)) as [kg/m^3]
initial C.c[solute] = 120
policy cooling { T = 55 - 3*n/5 }
observe c = C.c[solute] in 0..200, crystals = C.yield in 0..100, size = C.mean_size in 0..500
episode { step = 0.2 [h], max_steps = 50 }
solver { method = rosenbrock }

test "the solute goes to the crystals" {
  start nominal
  policy cooling
  for 10 [h]
  expect C.c[solute] + C.yield within 0.5 of 120 [kg/m^3]
}
