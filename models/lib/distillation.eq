# Distillation. Flows are molar, as in flash.eq; the model declares `set species`.
#
# Columns use constant relative volatilities, which the model gives as `table relative_volatility[species]`.
# Source: S. Skogestad, Chem. Eng. Res. Des. 75A (1997) 539 (trays with linearised hydraulics, constant molar flows).
# Range: similar heats of vaporisation, saturated liquid feeds and no holdup of vapour.

use "lib/flash.eq"

component Tray "holdup of liquid in equilibrium with the vapour; liquid flows down, vapour up, a feed is a saturated liquid" {
  param M_0 : kmol   = 0.5    in 0..inf    "holdup at the flow L_0"
  param L_0 : kmol/h = 200    in 0..inf    "flow of liquid at the holdup M_0"
  param tau : h      = 0.001  in 0..inf    "time constant of the hydraulics"
  port feed, liquid_in, vapour_in, liquid_out, vapour_out : Molar
  state M : kmol = 0.5 in 0..inf scale 1    "holdup"
  state x[i in species] : 1 = 0.5 in 0..1    "mole fractions of the liquid"
  let volatile = sum(relative_volatility[j]*x[j] for j in species)
  eq d/dt M = feed.F + liquid_in.F + vapour_in.F - liquid_out.F - vapour_out.F
  eq M*d/dt x[i] = feed.F*(feed.x[i] - x[i]) + liquid_in.F*(liquid_in.x[i] - x[i])
                   + vapour_in.F*(vapour_in.x[i] - x[i]) - vapour_out.F*(vapour_out.x[i] - x[i])    for i in species
  eq liquid_out.F    = L_0 + (M - M_0)/tau
  eq liquid_out.x[i] = x[i]                                    for i in species
  eq vapour_out.F    = vapour_in.F
  eq vapour_out.x[i] = relative_volatility[i]*x[i]/volatile    for i in species
}

component Section(trays = 10) "trays without a feed, numbered from the top, at constant molar flows" {
  param M : kmol = 0.5 in 0..inf    "holdup of a tray"
  port liquid_in, vapour_in, liquid_out, vapour_out : Molar
  state x[k in 1..trays, i in species] : 1 = 0.5 in 0..1    "mole fractions of the liquid"
  let y[k in 1..trays, i in species] = relative_volatility[i]*x[k, i]/sum(relative_volatility[j]*x[k, j] for j in species)
  eq M*d/dt x[k, i] = liquid_in.F*((if k == 1 then liquid_in.x[i] else x[k-1, i]) - x[k, i])
                      + vapour_in.F*((if k == trays then vapour_in.x[i] else y[k+1, i]) - y[k, i])    for k in 1..trays, i in species
  eq liquid_out.F    = liquid_in.F
  eq vapour_out.F    = vapour_in.F
  eq liquid_out.x[i] = x[trays, i]    for i in species
  eq vapour_out.x[i] = y[1, i]        for i in species
}

component Condenser "total condenser and reflux drum of constant holdup; the model sets `reflux`" {
  param M : kmol = 5 in 0..inf    "holdup"
  port vapour_in, liquid_out, distillate : Molar
  var reflux : kmol/h = 100    "flow back to the column"
  state x[i in species] : 1 = 0.5 in 0..1    "mole fractions"
  eq M*d/dt x[i]     = vapour_in.F*(vapour_in.x[i] - x[i])    for i in species
  eq liquid_out.F    = reflux
  eq distillate.F    = vapour_in.F - reflux
  eq liquid_out.x[i] = x[i]                                   for i in species
  eq distillate.x[i] = x[i]                                   for i in species
}

component Reboiler "boiling sump of constant holdup; the model sets `boilup`" {
  param M : kmol = 5 in 0..inf    "holdup"
  port liquid_in, vapour_out, bottoms : Molar
  var boilup : kmol/h = 150    "flow of vapour"
  state x[i in species] : 1 = 0.5 in 0..1    "mole fractions"
  let volatile = sum(relative_volatility[j]*x[j] for j in species)
  eq M*d/dt x[i]     = liquid_in.F*(liquid_in.x[i] - x[i]) - boilup*(vapour_out.x[i] - x[i])    for i in species
  eq vapour_out.F    = boilup
  eq vapour_out.x[i] = relative_volatility[i]*x[i]/volatile                                     for i in species
  eq bottoms.F       = liquid_in.F - boilup
  eq bottoms.x[i]    = x[i]                                                                     for i in species
}

component FeedTray "mixes a saturated liquid feed into a column at constant molar flows" {
  param M : kmol = 0.5 in 0..inf    "holdup"
  port feed, liquid_in, vapour_in, liquid_out, vapour_out : Molar
  state x[i in species] : 1 = 0.5 in 0..1    "mole fractions of the liquid"
  let volatile = sum(relative_volatility[j]*x[j] for j in species)
  eq M*d/dt x[i] = feed.F*(feed.x[i] - x[i]) + liquid_in.F*(liquid_in.x[i] - x[i])
                   + vapour_in.F*(vapour_in.x[i] - vapour_out.x[i])    for i in species
  eq liquid_out.F    = liquid_in.F + feed.F
  eq liquid_out.x[i] = x[i]                                    for i in species
  eq vapour_out.F    = vapour_in.F
  eq vapour_out.x[i] = relative_volatility[i]*x[i]/volatile    for i in species
}

component Column(above = 10, below = 10) "condenser, trays above and below the feed tray, reboiler" {
  port feed, distillate, bottoms : Molar
  var reflux : kmol/h = 100    "flow of liquid from the condenser"
  var boilup : kmol/h = 150    "flow of vapour from the reboiler"
  use Condenser as condenser
  use Section as top(trays = above)
  use FeedTray as middle
  use Section as bottom(trays = below)
  use Reboiler as reboiler
  eq condenser.reflux = reflux
  eq reboiler.boilup  = boilup
  connect condenser.liquid_out -> top.liquid_in
  connect top.liquid_out -> middle.liquid_in
  connect feed -> middle.feed
  connect middle.liquid_out -> bottom.liquid_in
  connect bottom.liquid_out -> reboiler.liquid_in
  connect reboiler.vapour_out -> bottom.vapour_in
  connect bottom.vapour_out -> middle.vapour_in
  connect middle.vapour_out -> top.vapour_in
  connect top.vapour_out -> condenser.vapour_in
  connect condenser.distillate -> distillate
  connect reboiler.bottoms -> bottoms
}
