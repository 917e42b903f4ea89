# Evaporator effects and a condenser, which compose to trains with several effects. Streams are those of streams.eq.
#
# The vapour of an effect heats the next one: `connect E[1].vapour -> E[2].chest`; several ports may share a header of steam, in which
# flows are positive into the components. Liquid may flow in the same or the other direction.
# The model sets the temperature of fresh steam, `eq E.chest.T`, the boiling-point rise `rise`, and outlet.Q (or the next unit does).
# Source: balances of volume, species and energy; W. L. McCabe, J. C. Smith and P. Harriott, Unit Operations of Chemical
# Engineering, evaporation.
# Range: water as the solvent, constant latent heat, density and heat capacity; vapour condenses at its saturation temperature
# without subcooling, no holdup of vapour; heat flows from the chest to the liquid.

use "lib/streams.eq"

connector Vapour { T : degC, flow m : kg/h }    # temperature of saturation, flow of steam into the component

component Effect "boiling liquid and its chest; the model sets `rise`" {
  param UA     : kW/K       = 10    in 0..inf    "heat transfer coefficient times area"
  param latent : kJ/kg      = 2257  in 0..inf    "latent heat of water"
  param rho    : kg/m^3     = 1000  in 0..inf    "density of the evaporated water as a liquid"
  param rho_cp : kJ/(m^3 K) = 4180  in 0..inf    "heat capacity by volume"
  port inlet, outlet : Stream
  port chest, vapour : Vapour
  var rise : K = 0 in 0..inf    "rise of the boiling point"
  state V : m^3 = 1 in 0..inf    "volume of the liquid"
  state c[i in species] : amount/m^3 = 0 in 0..inf scale 1    "concentrations"
  state T : degC = 80 in -50..500 scale 100    "temperature of the liquid"
  eq d/dt V      = inlet.Q - outlet.Q + vapour.m/rho
  eq d/dt c[i]   = (inlet.Q*(inlet.c[i] - c[i]) - vapour.m/rho*c[i])/V    for i in species
  eq d/dt T      = inlet.Q*(inlet.T - T)/V + (chest.m + vapour.m)*latent/(rho_cp*V)
  eq chest.m     = UA*(chest.T - T)/latent
  eq vapour.T    = T - rise
  eq outlet.c[i] = c[i]                                                   for i in species
  eq outlet.T    = T
}

component SurfaceCondenser "condenses the vapour of the last effect; the model sets the temperature `T_c` of the coolant" {
  param UA     : kW/K  = 50    in 0..inf    "heat transfer coefficient times area"
  param latent : kJ/kg = 2257  in 0..inf    "latent heat of water"
  port vapour : Vapour
  var T_c : degC = 20    "mean temperature of the coolant"
  let duty : kW = UA*(vapour.T - T_c)    "heat to the coolant"
  eq vapour.m = duty/latent
}
