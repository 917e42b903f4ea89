model BoilerDrum "Drum boiler and turbine of 160 MW: pressure, power, and a level that shrinks and swells"

# R. D. Bell, K. J. Astrom, Dynamic models for boiler-turbine-alternator units: data logs and parameter estimation for a 160 MW
# unit, Lund Institute of Technology, TFRT-3192 (1987). Pressures are in kg/cm2 as in the report, as plain numbers.
#
# Task: follow the demand for power, which changes every 60 steps, and keep the pressure and the level of the drum by fuel,
# steam valve and feedwater. More steam lowers the pressure, and bubbles lift the level at first.
#
# Checked: the published operating points 2 to 6 of the report (P = 108, E = 66.65 MW, density 428 kg/m3 at valves 0.34, 0.69, 0.433
# is number 4); trajectories of SciPy.

time t : s

# The nominal valves are those at which pressure and density of point 4 rest exactly.
action u_1 = (0.0018*0.69*108^1.125 + 0.15*0.569*108/141)/0.9  in 0..1    "fuel valve"
action u_2 = 0.69                                              in 0..1    "steam valve"
action u_3 = 0.569*108/141                                     in 0..1    "feedwater valve"

state P            = 108    in 50..180     "pressure of the drum, kg/cm2"
state E   : MW     = 66.65  in 0..200      "electric power"
state rho : kg/m^3 = 428    in 200..700    "density of the fluid"

disturbance dE : MW = 0 ~ if mod(n, 60) == 0 and n > 0 then 10 [MW]*uniform(-1, 1) else dE  in -20..20        "change of the demand"
disturbance d       = 0 ~ 0.95*d + normal(0, 0.003) clip bounds                             in -0.05..0.05    "heating value of the fuel, relative"

let x      : 1    = (1 - 0.001538*(rho/1 [kg/m^3]))*(0.8*P - 25.6) / ((rho/1 [kg/m^3])*(1.0394 - 0.0012304*P))    "steam quality"
let q_e    : kg/s = ((0.854*u_2 - 0.147)*P + 45.59*u_1*(1 + d) - 2.514*u_3 - 2.096) as [kg/s]    "evaporation"
let L      : m    = 0.05 [m]*(0.13073*(rho/1 [kg/m^3]) + 100*x + q_e/9 [kg/s] - 67.975)    "level, deviation"
let demand : MW   = steady(E) + dE                                                         "demand"

eq d/dt P   = (-0.0018*u_2*P^1.125 + 0.9*u_1*(1 + d) - 0.15*u_3) / 1 [s]
eq d/dt E   = (0.073*u_2 - 0.016)*P^1.125*1 [MW/s] - 0.1 [1/s]*E
eq d/dt rho = (141*u_3 - (1.1*u_2 - 0.19)*P)/85*1 [kg/(m^3 s)]

steady { u_1 = (0.0018*0.69*108^1.125 + 0.15*0.569*108/141)/0.9, u_2 = 0.69, u_3 = 0.569*108/141, rho = 428 }
initial x = value(steady(x))    for x in states

observe P, E, rho, L in -2..2, e : MW = demand - E in -100..100
level online "gauges of pressure, power and level" {
  observe P noise normal(0, 0.1), E noise normal(0, 0.1), L in -2..2 noise normal(0, 0.01), e : MW = demand - E in -100..100 noise normal(0, 0.1)
}

reward load default = -sq((demand - E)/5 [MW]) - sq((P - 108)/5) - sq(L/0.2 [m])    "deviations of power, pressure and level"
constraint high when L > 0.5 [m]
constraint low when L < -0.5 [m]
fail trip_level when abs(L) > 1.5 [m]
fail trip_pressure when outside bounds(P, rho)
episode { step = 5 [s], max_steps = 300, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/boiler_drum.eq`, against Bell and Astrom 1987 ----

test "operating point 4" {
  start steady
  expect P within 1e-3 of 108
  expect E within 0.1 of 66.65
  expect L within 0.02 of 0
}
