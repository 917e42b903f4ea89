# Pump and control valves: flows of liquids from pressures. Streams are those of streams.eq, openings and speeds signals of control.eq.
#
# The model closes the pressure balance of each line, as `eq P.dp + p_suction = V.dp + p_delivery`.
# Source: IEC 60534-2-1 for turbulent liquids; affinity laws of centrifugal pumps (I. J. Karassik et al., Pump Handbook).
# Range: turbulent flow without cavitation or choking, forward flow.

use "lib/streams.eq"
use "lib/control.eq"

component Pump "centrifugal pump: head falls with the square of the flow, both scale with the speed" {
  param head_0 : m       = 40    in 0..inf    "head at zero flow and full speed"
  param drop   : h^2/m^5 = 0.02  in 0..inf    "head lost over the square of the flow"
  param rho    : kg/m^3  = 1000  in 0..inf    "density"
  param eta    : 1       = 0.7   in 0..1      "efficiency"
  port inlet, outlet : Stream
  port speed : Signal    # share of the full speed
  let head : m = head_0*sq(speed.y) - drop*sq(inlet.Q)    "head"
  var dp : bar = 1    "rise of the pressure"
  let power : kW = dp*inlet.Q/eta    "power at the shaft"
  eq dp          = rho*9.80665 [m/s^2]*head
  eq outlet.Q    = inlet.Q
  eq outlet.c[i] = inlet.c[i]    for i in species
  eq outlet.T    = inlet.T
}

component LinearValve "flow in proportion to the opening" {
  param K_v     : m^3/h = 10    in 0..inf    "flow of water at 1 bar, fully open"
  param density : 1     = 1     in 0..inf    "density over that of water"
  param leak    : 1     = 1e-3  in 0..1      "smallest share of K_v"
  port inlet, outlet : Stream
  port opening : Signal
  var dp : bar = 1 in 0..inf    "pressure drop"
  let share : 1 = max(opening.y, leak)    "share of K_v"
  eq dp          = density*sq(inlet.Q/(K_v*share))*1 [bar]
  eq outlet.Q    = inlet.Q
  eq outlet.c[i] = inlet.c[i]    for i in species
  eq outlet.T    = inlet.T
}

# Each step of the opening changes the flow by the same share.
component EqualPercentageValve extends LinearValve {
  param range : 1 = 50 in 1..inf    "rangeability: K_v over that of the closed valve"
  let share : 1 = range^(opening.y - 1)    "share of K_v"
}
