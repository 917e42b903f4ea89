# Connectors of the library's units, and units without a reaction: tank, mixer, splitter.
#
# The model declares what flows, `set species = { A, B }`, and what concentrations count: `unit amount = 1 [mol]`, or 1 [g].
# Flows are by volume, densities constant; a stream goes from an outlet to one inlet (`connect a.outlet -> b.inlet`).
# Source: balances of total volume, species and energy of a perfectly mixed liquid.
# Range: liquids of one density and heat capacity, flows that do not turn; a mixer needs a flow, a tank a level above zero.

connector Stream { Q : m^3/h in 0..inf, c[species] : amount/m^3, T : degC }    # volume flow, concentrations, temperature
connector Heat { T : degC, Q : kW }    # temperature of the wall, heat along the arrow

component Feed(driven = false) "stream of constant composition; with `driven = true` the model or the next unit sets outlet.Q" {
  param T          : degC       = 25  in -50..500    "temperature"
  param c[species] : amount/m^3 = 0   in 0..inf      "concentrations"
  port outlet : Stream
  when driven = false {
    param Q : m^3/h = 1 in 0..inf    "flow"
    eq outlet.Q = Q
  }
  eq outlet.c[i] = c[i]    for i in species
  eq outlet.T    = T
}

component Tank "level, concentrations and temperature of a mixed tank; the model or the next unit sets outlet.Q" {
  param A : m^2 = 1 in 0..inf    "cross-section"
  port inlet, outlet : Stream
  state h : m = 1 in 0..inf    "level"
  state c[i in species] : amount/m^3 = 0 in 0..inf scale 1    "concentrations"
  state T : degC = 25 in -50..500 scale 100    "temperature"
  eq d/dt h      = (inlet.Q - outlet.Q)/A
  eq d/dt c[i]   = inlet.Q*(inlet.c[i] - c[i])/(A*h)    for i in species
  eq d/dt T      = inlet.Q*(inlet.T - T)/(A*h)
  eq outlet.c[i] = c[i]                                 for i in species
  eq outlet.T    = T
}

component BufferTank extends Tank {
  param h_0  : m     = 1  in 0..inf    "level at the flow Q_0"
  param Q_0  : m^3/h = 1  in 0..inf    "outflow at the level h_0"
  param gain : m^2/h = 1  in 0..inf    "change of the outflow with the level; low gains average the flow"
  eq outlet.Q = max(0 [m^3/h], Q_0 + gain*(h - h_0))
}

component Mixer "two streams become one, without holdup" {
  port inlet_1, inlet_2, outlet : Stream
  eq outlet.Q             = inlet_1.Q + inlet_2.Q
  eq outlet.Q*outlet.c[i] = inlet_1.Q*inlet_1.c[i] + inlet_2.Q*inlet_2.c[i]    for i in species
  eq outlet.Q*(outlet.T - inlet_1.T) = inlet_2.Q*(inlet_2.T - inlet_1.T)
}

component Splitter "one stream becomes two of the same composition; the model sets `share`" {
  port inlet, outlet_1, outlet_2 : Stream
  var share : 1 = 0.5 in 0..1    "share of the inlet that leaves by outlet_1"
  eq outlet_1.Q    = share*inlet.Q
  eq outlet_2.Q    = (1 - share)*inlet.Q
  eq outlet_1.c[i] = inlet.c[i]    for i in species
  eq outlet_2.c[i] = inlet.c[i]    for i in species
  eq outlet_1.T    = inlet.T
  eq outlet_2.T    = inlet.T
}
