model Tube "a reaction in a tube behind a pipe: dead time, dispersion, conversion"

# Plug flow and pipe: models/lib/reactors.eq, pipes.eq. The test has the closed form of P. V. Danckwerts, Chem. Eng. Sci. 2 (1953) 1.

time t : h
unit amount = 1 [mol]
set species = { A, B }
table feed[species] : mol/m^3 = { A: 1, B: 0 }
use "lib/reactors.eq"
use "lib/pipes.eq"
action Q : m^3/h = 1 in 0.5..2    "flow"
param k : 1/h = 2 in 0..inf    "rate constant"
use Feed as supply(driven = true, c = feed)
use Pipe as pipe(V = 0.5 [m^3])
use PlugFlow as tube(cells = 100, L = 1 [m], A = 1 [m^2], D = 0.25 [m^2/h])
eq supply.outlet.Q = Q
connect supply.outlet -> pipe.inlet
connect pipe.outlet -> tube.inlet
eq tube.r[A, z] = -k*tube.c[A, z]    for z in 1..100
eq tube.r[B, z] = k*tube.c[A, z]     for z in 1..100
observe A = tube.outlet.c[A] in 0..1, B = tube.outlet.c[B] in 0..1
episode { step = 0.05 [h], max_steps = 80 }

test "the conversion is that of Danckwerts, to the numerical dispersion of the cells" {
  start nominal
  for 10 [h]
  expect tube.outlet.c[A] within 0.002 of 0.2147
}
