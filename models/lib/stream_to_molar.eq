# From a stream of streams.eq to a molar flow of flash.eq; the model declares `unit amount = 1 [mol]`.
# Source: definition of the mole fraction. Range: every component of the liquid is a species, solvents too.

use "lib/streams.eq"
use "lib/flash.eq"

component StreamToMolar "molar flow and mole fractions of a stream" {
  port inlet : Stream
  port outlet : Molar
  let total : amount/m^3 = sum(inlet.c[i] for i in species)    "concentration of all species"
  eq outlet.F    = inlet.Q*total
  eq outlet.x[i] = inlet.c[i]/total    for i in species
}
