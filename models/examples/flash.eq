model Flash "ethanol and water evaporate partly; the liquid is not ideal"

# Vapour pressures by Wagner, activity coefficients by NRTL: models/lib/drums.eq, substances.eq, mixtures.eq. A model without states.

time t : min
set species = { ethanol, water }
use "lib/drums.eq"
use "lib/mixtures.eq"
table tau[species, species] : 1 default 0 {
  ethanol: water = -0.06
  water:   ethanol = 1.7
}
table alpha[species, species] : 1 default 0.3 {
  ethanol: ethanol = 0
  water:   water = 0
}
component Liquid { def ln_gamma(i in species, x[species], T) = mixture_nrtl(i, x, tau, alpha) }
action T : degC = 86   in 80..100    "temperature of the drum"
action z : 1    = 0.2  in 0..1       "mole fraction of ethanol in the feed"
use FlashDrum as drum(properties = Liquid, p = 1.01325 [bar])
eq drum.T      = T
eq drum.feed.F = 100 [kmol/h]
eq drum.feed.x[ethanol] = z
eq drum.feed.x[water]   = 1 - z
policy heating { T = 82 + 15*n/30 }
observe share = drum.share in 0..1, x = drum.liquid.x[ethanol] in 0..1, y = drum.vapour.x[ethanol] in 0..1
episode { step = 1 [min], max_steps = 30 }

test "both phases have the composition that SciPy finds by bisection" {
  start nominal
  T = 90
  z = 0.15
  steps 1
  expect drum.share within 1e-6 of 0.32644128
  expect drum.liquid.x[ethanol] within 1e-6 of 0.05683497
}
