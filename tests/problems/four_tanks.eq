model FourTanks "four tanks, two pumps; the position of two valves tells whether there is a zero in the right half plane"

# K. H. Johansson, The quadruple-tank process, IEEE Transactions on Control Systems Technology 8 (2000) 456-465.

time t : s

param A_1     : cm^2       = 28                "cross-sections of the tanks"
param A_2     : cm^2       = 32
param A_3     : cm^2       = 28
param A_4     : cm^2       = 32
param a_1     : cm^2       = 0.071             "cross-sections of the outlets"
param a_2     : cm^2       = 0.057
param a_3     : cm^2       = 0.071
param a_4     : cm^2       = 0.057
param g       : cm/s^2     = 981               "gravity"
param k_c     : V/cm       = 0.5               "of the level sensors"
param k_1     : cm^3/(V s) = 3.33              "of the pumps"
param k_2     : cm^3/(V s) = 3.35
param gamma_1 : 1          = 0.7    in 0..1    "what flows into the lower tanks"
param gamma_2 : 1          = 0.6    in 0..1

action v_1 : V = 3  in 0..10    "pumps"
action v_2 : V = 3  in 0..10

state h_1 : cm = 12.4  in 0.01..30    "levels"
state h_2 : cm = 12.7  in 0.01..30
state h_3 : cm = 1.8   in 0.01..30
state h_4 : cm = 1.4   in 0.01..30

eq d/dt h_1 = (-a_1*sqrt(2*g*h_1) + a_3*sqrt(2*g*h_3) + gamma_1*k_1*v_1) / A_1
eq d/dt h_2 = (-a_2*sqrt(2*g*h_2) + a_4*sqrt(2*g*h_4) + gamma_2*k_2*v_2) / A_2
eq d/dt h_3 = (-a_3*sqrt(2*g*h_3) + (1 - gamma_2)*k_2*v_2) / A_3
eq d/dt h_4 = (-a_4*sqrt(2*g*h_4) + (1 - gamma_1)*k_1*v_1) / A_4

steady { v_1 = 3, v_2 = 3 }

initial x ~ value(steady(x)) * uniform(0.9, 1.1)    for x in (h_1, h_2, h_3, h_4)

observe y_1 : V = k_c*h_1 in 0..15, y_2 : V = k_c*h_2 in 0..15
level noisy "with the noise of the sensors" {
  observe y_1 : V = k_c*h_1 in 0..15 noise normal(0, 0.02), y_2 : V = k_c*h_2 in 0..15 noise normal(0, 0.02)
}

reward levels default = -sq((h_1 - steady(h_1)) / 1 [cm]) - sq((h_2 - steady(h_2)) / 1 [cm])
fail overflow when outside bounds(h_1, h_2, h_3, h_4)
episode { step = 2 [s], max_steps = 300, error_reward = -1000 }

variant nonminimum_phase "the valves of the second operating point" {
  param k_1     : cm^3/(V s) = 3.14      "of the pumps"
  param k_2     : cm^3/(V s) = 3.29
  param gamma_1 : 1          = 0.43  in 0..1
  param gamma_2 : 1          = 0.34  in 0..1
  steady { v_1 = 3.15, v_2 = 3.15 }
}
