# Stirred reactor under temperature control: jacket, control valve for the coolant, thermometer and PI controller.
#
# The model sets the set-point `T_set`, the net productions `r[i]` and the heat of reaction `q`. The volume is constant.
# Source and range: reactors.eq, flow.eq, control.eq, of whose components it consists.

use "lib/reactors.eq"
use "lib/flow.eq"

component CooledReactor "stirred reactor, jacket, equal-percentage valve, thermometer and PI controller" {
  param UA  : kW/K  = 3    in 0..inf      "heat transfer coefficient times area"
  param V_j : m^3   = 0.2  in 0..inf      "volume of the jacket"
  param K_v : m^3/h = 10   in 0..inf      "flow of coolant at 1 bar, valve open"
  param dp  : bar   = 2    in 0..inf      "pressure drop of the valve"
  param T_c : degC  = 15   in -50..500    "temperature of the coolant"
  param K   : 1     = -2                  "gain of the controller; its range is 0 to 100 degC"
  param T_i : s     = 300  in 0..inf      "its integral time"
  port inlet, outlet : Stream
  var r[species] : amount/(m^3 h)         "net production of each species"
  var q          : kW/m^3                 "heat of reaction, positive if exothermic"
  var T_set      : degC           = 50    "set-point of the temperature"
  use StirredReactor as tank
  use Jacket as jacket(UA = UA, V = V_j)
  use EqualPercentageValve as valve(K_v = K_v)
  use Sensor as TT
  use PI as TC(K = K, T_i = T_i)
  connect inlet -> tank.inlet
  connect tank.outlet -> outlet
  connect tank.wall -> jacket.wall
  connect TT.output -> TC.measured
  connect TC.output -> valve.opening
  eq outlet.Q         = inlet.Q
  eq tank.r[i]        = r[i]    for i in species
  eq tank.q           = q
  eq TT.input.y       = (tank.T - 0 [degC])/100 [K]
  eq TC.setpoint      = (T_set - 0 [degC])/100 [K]
  eq valve.dp         = dp
  eq valve.inlet.T    = T_c
  eq valve.inlet.c[i] = 0       for i in species
  eq jacket.Q         = valve.outlet.Q
  eq jacket.T_in      = valve.outlet.T
}
