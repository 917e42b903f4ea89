# Compressor with a map, and a vessel for gas.
#
# Inlet and outlet pressure belong to the neighbours, vessels or equations of the model; the flow follows from the map.
# Source: P. C. Hanlon, Compressor Handbook (2001): ideal-gas compression, polytropic and isentropic head, affinity laws of the map.
# Range: ideal gas of constant heat capacities, no heat loss of the compressor, flows above that of surge, which the event `surge` reports.

use "lib/control.eq"

param R_compressor : J/(mol K) = 8.31446261815324    "gas constant"

connector Gas { n : kmol/h = 100 in 0..inf, p : bar, T : K }    # molar flow, pressure, temperature

component Compressor(polytropic = true) "head and efficiency are parabolas of the flow, both scale with the speed" {
  param M           : g/mol           = 28.97  in 0..inf    "molar mass"
  param kappa       : 1               = 1.4    in 1..inf    "ratio of heat capacities"
  param head_0      : kJ/kg           = 120    in 0..inf    "head at zero flow and full speed"
  param drop        : kJ h^2/(kg m^6) = 3e-6   in 0..inf    "head lost over the square of the flow"
  param Q_best      : m^3/h           = 4000   in 0..inf    "flow of the highest efficiency, full speed"
  param eta_0       : 1               = 0.8    in 0..1      "highest efficiency"
  param fall        : 1               = 0.5    in 0..inf    "loss of efficiency, over the square of the deviation from Q_best"
  param surge_share : 1               = 0.5    in 0..inf    "flow of surge over Q_best"
  port inlet, outlet : Gas
  port speed : Signal    # share of the full speed
  let Q     : m^3/h = inlet.n*R_compressor*inlet.T/inlet.p    "flow at the inlet"
  let place : 1     = Q/(Q_best*speed.y)                      "flow over that of the highest efficiency"
  let head  : kJ/kg = head_0*sq(speed.y) - drop*sq(Q)         "polytropic or isentropic head"
  let eta   : 1     = eta_0*(1 - fall*sq(place - 1))          "polytropic or isentropic efficiency"
  let m     : 1     = (kappa - 1)/kappa/(if polytropic then eta else 1)    # exponent of the temperature
  let rise  : 1     = 1 + m*head*M/(R_compressor*inlet.T)    # ratio of temperatures, isentropic or polytropic
  let power : kW    = inlet.n*M*head/eta                      "power at the shaft"
  event surge when place < surge_share
  eq outlet.n = inlet.n
  eq outlet.p = inlet.p*rise^(1/m)
  eq outlet.T = inlet.T*(if polytropic then rise else 1 + (rise - 1)/eta)
}

component GasVessel "pressure and temperature of a mixed vessel; the neighbours or the model set outlet.n" {
  param V     : m^3  = 10   in 0..inf    "volume"
  param kappa : 1    = 1.4  in 1..inf    "ratio of heat capacities"
  param UA    : kW/K = 0    in 0..inf    "heat transfer coefficient times area, to the surroundings"
  param T_a   : K    = 293  in 0..inf    "temperature of the surroundings"
  port inlet, outlet : Gas
  state p : bar = 1    in 0..inf  scale 1      "pressure"
  state T : K   = 293  in 0..inf  scale 100    "temperature"
  let N : kmol = p*V/(R_compressor*T)    "content"
  eq d/dt p   = (kappa*R_compressor*(inlet.n*inlet.T - outlet.n*T) + (kappa - 1)*UA*(T_a - T))/V
  eq d/dt T   = T/p*der(p) - T/N*(inlet.n - outlet.n)
  eq inlet.p  = p
  eq outlet.p = p
  eq outlet.T = T
}
