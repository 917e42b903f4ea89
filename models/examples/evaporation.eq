model Evaporation "sugar solution is concentrated in three effects, heated by steam"

# Effects and condenser: models/lib/evaporator.eq; steam: IAPWS-IF97. Liquid and vapour flow in the same direction; a controller of
# the level of each effect would be next, here the outlets follow the levels.

time t : min
unit amount = 1 [kg]
set species = { sugar }
set effect = 1..3
use "lib/evaporator.eq"
use "lib/steam.eq"
action F : m^3/h = 10  in 5..15     "feed"
action p : bar   = 2   in 1.2..3    "pressure of the steam"
table feed[species] : kg/m^3 = { sugar: 120 }
use Feed as supply(driven = true, T = 60 [degC], c = feed)
use Effect as E[k in effect](UA = 60 [kW/K])
use SurfaceCondenser as C(UA = 150 [kW/K])
eq supply.outlet.Q = F
connect supply.outlet -> E[1].inlet
connect E[k].outlet -> E[k+1].inlet for k in 1..2
connect E[k].vapour -> E[k+1].chest for k in 1..2
connect E[3].vapour -> C.vapour
eq E[1].chest.T  = celsius(water_Tsat(p))
eq E[k].outlet.Q = 6 [1/h]*E[k].V                        for k in effect
eq E[k].rise     = E[k].c[sugar]/(300 [kg/m^3])*1 [K]    for k in effect
eq C.T_c         = 30 [degC]
let economy = (F - E[3].outlet.Q)*1000 [kg/m^3]/E[1].chest.m    "evaporated water over steam"
initial E[k].T        = 110 [degC] - 20 [K]*k    for k in effect
initial E[k].c[sugar] = 150                      for k in effect
observe c = E[3].c[sugar] in 0..1000, economy in 0..5, T_1 = E[1].T in 0..150, T_3 = E[3].T in 0..150
episode { step = 1 [min], max_steps = 90 }

test "the solute leaves at rest, and one kilogram of steam evaporates more than two of water" {
  start nominal
  for 600 [min]
  expect E[3].outlet.Q*E[3].c[sugar] within 1e-3 of 1200 [kg/h]
  expect economy > 2
}
