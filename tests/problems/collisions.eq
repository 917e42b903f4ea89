model Collisions "two carts that collide elastically, and a belt that moves by one cell at each step"

time t : s

param m_1 : kg = 1  in 0.1..10
param m_2 : kg = 3  in 0.1..10

action push : m/s^2 = 0 in -1..1    "acceleration of the first cart"

state x_1 : m   = 0    in -100..100
state x_2 : m   = 2.2  in -100..100
state v_1 : m/s = 1    in -10..10
state v_2 : m/s = -1   in -10..10
discrete hits = 0 in 0..1000

eq d/dt x_1 = v_1
eq d/dt x_2 = v_2
eq d/dt v_1 = push
eq d/dt v_2 = 0

event hit when x_1 >= x_2
at hit {
  reset v_1 = ((m_1 - m_2)*v_1 + 2*m_2*v_2) / (m_1 + m_2)
  reset v_2 = ((m_2 - m_1)*v_2 + 2*m_1*v_1) / (m_1 + m_2)
  next hits = hits + 1
}

let momentum : kg m/s = m_1*v_1 + m_2*v_2
let energy   : J      = (m_1*sq(v_1) + m_2*sq(v_2)) / 2

domain z in 0..1 [m] cells 20
state belt[z] = 0 in -10..10
eq d/dt belt[z] = 0    for z
at start {
  reset belt[z] = belt[z-1]    for z in 2..z.last
  reset belt[1] = value(v_1)
}

observe x_1, x_2, v_1, v_2, momentum in -100..100, energy in 0..1000
episode { step = 0.5 [s], max_steps = 20 }
