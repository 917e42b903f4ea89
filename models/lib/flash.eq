# Flash of a molar flow; the model declares `set species`.
#
# Source: H. H. Rachford and J. D. Rice, J. Pet. Technol. 4 (1952) 327.
# Range: a flash of a subcooled or superheated feed leaves one phase, and the fractions of the other are without meaning.

connector Molar { F : kmol/h in 0..inf, x[species] : 1 }    # flow and mole fractions

component Flash "isothermal flash without holdup; the model sets `K[i]`, as p_sat/p by Raoult" {
  port feed, vapour, liquid : Molar
  var K[species] : 1                   "mole fraction in the vapour over that in the liquid"
  var share      : 1 = 0.5  in 0..1    "share of the feed that evaporates"
  let excess : 1 = sum(feed.x[i]*(K[i] - 1)/(1 + share*(K[i] - 1)) for i in species)    # zero with two phases
  eq share       = clip(share + excess, 0, 1)
  eq vapour.F    = share*feed.F
  eq liquid.F    = (1 - share)*feed.F
  eq liquid.x[i] = feed.x[i]/(1 + share*(K[i] - 1))         for i in species
  eq vapour.x[i] = K[i]*feed.x[i]/(1 + share*(K[i] - 1))    for i in species
}
