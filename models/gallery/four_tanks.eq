model FourTanks "Quadruple-tank process: four tanks, two pumps, two valves that decide on the phase"

# K. H. Johansson, The quadruple-tank process: a multivariable laboratory process with an adjustable zero, IEEE Transactions on
# Control Systems Technology 8 (2000) 456-465.
#
# Task: follow set-points of the two lower levels, which change every 100 steps. With the valves of the default the linear
# model has its zeros in the left half plane, with the variant nonminimum_phase one in the right. Unmeasured water flows
# into the upper tanks.
#
# Checked: levels, gains and time constants of both operating points (published levels are measured ones: 12.4, 12.7,
# 1.8, 1.4 cm; the equations give 12.26, 12.78, 1.63, 1.41 cm); zeros -0.060 and -0.018 1/s, and 0.013 and -0.057 1/s;
# trajectories of SciPy. The variant `pcgym` has the tanks of pc-gym.

time t : s

param A_1     : cm^2       = 28                "cross-section of tank 1"
param A_2     : cm^2       = 32                "cross-section of tank 2"
param A_3     : cm^2       = 28                "cross-section of tank 3"
param A_4     : cm^2       = 32                "cross-section of tank 4"
param a_1     : cm^2       = 0.071             "outlet of tank 1"
param a_2     : cm^2       = 0.057             "outlet of tank 2"
param a_3     : cm^2       = 0.071             "outlet of tank 3"
param a_4     : cm^2       = 0.057             "outlet of tank 4"
param g       : cm/s^2     = 981               "gravity"
param k_c     : V/cm       = 0.5               "gain of the level sensors"
param k_1     : cm^3/(V s) = 3.33              "gain of pump 1"
param k_2     : cm^3/(V s) = 3.35              "gain of pump 2"
param gamma_1 : 1          = 0.7    in 0..1    "share of pump 1 that flows into tank 1"
param gamma_2 : 1          = 0.6    in 0..1    "share of pump 2 that flows into tank 2"
param change  : V          = 0.5    in 0..2    "largest change of a set-point"

action v_1 : V = 3  in 0..10    "voltage of pump 1"
action v_2 : V = 3  in 0..10    "voltage of pump 2"

state h_1 : cm = 12.4  in 0.01..30    "level of tank 1"
state h_2 : cm = 12.7  in 0.01..30    "level of tank 2"
state h_3 : cm = 1.8   in 0.01..30    "level of tank 3"
state h_4 : cm = 1.4   in 0.01..30    "level of tank 4"

disturbance w_3 : cm^3/s = 0 ~ 0.9*w_3 + 0.1 [cm^3/s]*normal(0, 1) clip bounds  in -1..1    "water into tank 3"
disturbance w_4 : cm^3/s = 0 ~ 0.9*w_4 + 0.1 [cm^3/s]*normal(0, 1) clip bounds  in -1..1    "water into tank 4"

eq d/dt h_1 = (-a_1*sqrt(2*g*h_1) + a_3*sqrt(2*g*h_3) + gamma_1*k_1*v_1) / A_1
eq d/dt h_2 = (-a_2*sqrt(2*g*h_2) + a_4*sqrt(2*g*h_4) + gamma_2*k_2*v_2) / A_2
eq d/dt h_3 = (-a_3*sqrt(2*g*h_3) + (1 - gamma_2)*k_2*v_2 + w_3) / A_3
eq d/dt h_4 = (-a_4*sqrt(2*g*h_4) + (1 - gamma_1)*k_1*v_1 + w_4) / A_4

steady { v_1 = 3, v_2 = 3 }
initial x = value(steady(x))    for x in states

disturbance dr_1 : V = 0 ~ if n > 0 and mod(n, 100) == 0 then change*uniform(-1, 1) else dr_1  in -2..2    "change of the first set-point"
disturbance dr_2 : V = 0 ~ if n > 0 and mod(n, 100) == 0 then change*uniform(-1, 1) else dr_2  in -2..2    "change of the second set-point"
let r_1 : V = k_c*steady(h_1) + dr_1    "set-point of the first level"
let r_2 : V = k_c*steady(h_2) + dr_2    "set-point of the second level"

observe y_1 : V = k_c*h_1 in 0..15, y_2 : V = k_c*h_2 in 0..15, e_1 : V = r_1 - k_c*h_1 in -15..15, e_2 : V = r_2 - k_c*h_2 in -15..15
level online "the sensors with their noise" {
  observe y_1 : V = k_c*h_1 in 0..15 noise normal(0, 0.02), y_2 : V = k_c*h_2 in 0..15 noise normal(0, 0.02)
  observe e_1 : V = r_1 - k_c*h_1 in -15..15 noise normal(0, 0.02), e_2 : V = r_2 - k_c*h_2 in -15..15 noise normal(0, 0.02)
}

reward levels default = -sq((r_1 - k_c*h_1) / 1 [V]) - sq((r_2 - k_c*h_2) / 1 [V])    "squared deviations from the set-points"
constraint high when h_1 > 20 [cm] or h_2 > 20 [cm]
fail overflow when outside bounds(h_1, h_2, h_3, h_4)
episode { step = 2 [s], max_steps = 400, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

variant nonminimum_phase "valves of the second operating point" {
  param k_1     : cm^3/(V s) = 3.14             "gain of pump 1"
  param k_2     : cm^3/(V s) = 3.29             "gain of pump 2"
  param gamma_1 : 1          = 0.43  in 0..1    "share of pump 1 that flows into tank 1"
  param gamma_2 : 1          = 0.34  in 0..1    "share of pump 2 that flows into tank 2"
  steady { v_1 = 3.15, v_2 = 3.15 }
}
variant pcgym "tanks, pumps and valves of pc-gym" {
  param A_1     : cm^2       = 1e4             "cross-section of tank 1"
  param A_2     : cm^2       = 1e4             "cross-section of tank 2"
  param A_3     : cm^2       = 1e4             "cross-section of tank 3"
  param A_4     : cm^2       = 1e4             "cross-section of tank 4"
  param a_1     : cm^2       = 35              "outlet of tank 1"
  param a_2     : cm^2       = 30              "outlet of tank 2"
  param a_3     : cm^2       = 20              "outlet of tank 3"
  param a_4     : cm^2       = 25              "outlet of tank 4"
  param k_1     : cm^3/(V s) = 850             "gain of pump 1"
  param k_2     : cm^3/(V s) = 950             "gain of pump 2"
  param gamma_1 : 1          = 0.2  in 0..1    "share of pump 1 that flows into tank 1"
  param gamma_2 : 1          = 0.2  in 0..1    "share of pump 2 that flows into tank 2"
  episode { step = 15 [s] }
}

# ---- Tests: `smpl test models/gallery/four_tanks.eq`, against Johansson 2000 ----

test "the minimum-phase point has the measured levels" {
  start steady
  expect h_1 within 0.21 of 12.4
  expect h_2 within 0.21 of 12.7
  expect h_3 within 0.21 of 1.8
  expect h_4 within 0.21 of 1.4
}
test "and so has the nonminimum-phase point" {
  variant nonminimum_phase
  start steady
  expect h_1 within 0.21 of 12.6
  expect h_2 within 0.21 of 13.0
  expect h_3 within 0.21 of 4.8
  expect h_4 within 0.21 of 4.9
}
