# Reactors: stirred tank, jacket, tube with axial dispersion. Streams are those of streams.eq.
#
# The model writes the kinetics: an equation for each net production `r[i]`, and for the heat of reaction `q`.
# Source: O. Levenspiel, Chemical Reaction Engineering, 3rd edition (1999): perfectly mixed tank; dispersed plug flow, closed at the
# inlet (P. V. Danckwerts, Chem. Eng. Sci. 2 (1953) 1) and with zero gradient at the outlet.
# Range: constant density and heat capacity. The tube is first order in space: numerical dispersion adds v*dz/2, or choose
# `convection=limited` (second order).

use "lib/streams.eq"

choice convection = upwind | limited    "convection in tubes: first order, or second order with a limiter"

component StirredReactor "mixed tank with reaction and a wall; the model or the next unit sets outlet.Q" {
  param rho_cp : kJ/(m^3 K) = 4180 in 0..inf    "heat capacity by volume"
  port inlet, outlet : Stream
  port wall : Heat    # heat into the content; `eq R.wall.Q = 0` if adiabatic
  var r[species] : amount/(m^3 h)    "net production of each species"
  var q          : kW/m^3            "heat of reaction, positive if exothermic"
  state V : m^3 = 1 in 0..inf    "volume"
  state c[i in species] : amount/m^3 = 0 in 0..inf scale 1    "concentrations"
  state T : degC = 25 in -50..500 scale 100    "temperature"
  eq d/dt V      = inlet.Q - outlet.Q
  eq d/dt c[i]   = inlet.Q*(inlet.c[i] - c[i])/V + r[i]    for i in species
  eq d/dt T      = inlet.Q*(inlet.T - T)/V + q/rho_cp + wall.Q/(rho_cp*V)
  eq wall.T      = T
  eq outlet.c[i] = c[i]                                    for i in species
  eq outlet.T    = T
}

component Jacket "mixed jacket at a wall; the model sets flow `Q` and inlet temperature `T_in` of the medium" {
  param V      : m^3        = 0.1   in 0..inf    "volume"
  param rho_cp : kJ/(m^3 K) = 4180  in 0..inf    "heat capacity of the medium by volume"
  param UA     : kW/K       = 1     in 0..inf    "heat transfer coefficient times area"
  port wall : Heat    # heat out of the jacket
  var Q    : m^3/h  in 0..inf    "flow of the medium"
  var T_in : degC                "its inlet temperature"
  state T : degC = 25 in -50..500 scale 100    "temperature of the medium"
  eq d/dt T = Q*(T_in - T)/V - wall.Q/(rho_cp*V)
  eq wall.Q = UA*(T - wall.T)
}

component PlugFlow(cells = 40) "isothermal tube with axial dispersion; the model sets `r[i, z]`" {
  param L : m     = 1     in 0..inf    "length"
  param A : m^2   = 0.01  in 0..inf    "cross-section of the flow"
  param D : m^2/h = 0     in 0..inf    "axial dispersion"
  port inlet, outlet : Stream
  domain z in 0..L cells cells scheme upwind
  when convection = limited { domain z in 0..L cells cells scheme limited }
  state c[i in species, z] : amount/m^3 = 0 in 0..inf scale 1    "concentrations"
  var   r[i in species, z] : amount/(m^3 h)    "net production of each species"
  let   v : m/h = inlet.Q/A    "velocity"
  flux  J[i in species, z] = v*c[i, z] - D*grad(c[i, z]), low = v*inlet.c[i]
  eq d/dt c[i, z] = -div(J[i, z]) + r[i, z]    for i in species, z
  eq outlet.Q     = inlet.Q
  eq outlet.c[i]  = c[i, z.last]               for i in species
  eq outlet.T     = inlet.T
}
