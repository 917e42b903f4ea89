model Network "ports with flows, arrays of ports, grids of instances"
time t : s
action heat : W = 0 in -1e4..1e4
observe heat
reward q default = 0
episode { step = 10 [s], max_steps = 100 }
solver { rtol = 1e-10 }

connector Heat { T : K in 0..1e4, flow Q : W }
component Mass {
  param C   : J/K = 100
  param T_0 : K   = 300
  port p : Heat
  state T : K = T_0 in 0..1e4
  eq p.T      = T
  eq C*d/dt T = p.Q
}
component Wall {
  param G : W/K = 2
  port a, b : Heat
  eq a.Q = G*(a.T - b.T)
  eq b.Q = -a.Q
}

# Two masses with two walls between them.
use Mass as room(C = 50 [J/K], T_0 = 350 [K]), air(C = 200 [J/K])
use Wall as window(G = 0.5 [W/K]), brick(G = 1.5 [W/K])
connect window.a -> room.p -> brick.a
connect air.p -> window.b
connect brick.b -> air.p

# A wall of two layers, whose middle has no mass: half of the conductance of each.
component Layers {
  port a, b : Heat
  use Wall as inner, outer
  connect inner.a -> a
  connect b -> outer.b
  connect inner.b -> outer.a
}
use Mass as hot(T_0 = 400 [K]), cold
use Layers as layers
connect hot.p -> layers.a
connect layers.b -> cold.p

# A hub with an array of ports.
set links = { north, south, west }
component Hub {
  port n[j in links] : Heat
  state T : K = 500 in 0..1e4
  eq n[j].T           = T    for j in links
  eq 300 [J/K]*d/dt T = sum(n[j].Q for j in links)
}
use Hub as hub
use Wall as spoke[j in links]
use Mass as rim[j in links]
connect hub.n[j] -> spoke[j].a for j in links
connect spoke[j].b -> rim[j].p for j in links

# A grid of masses, with walls between neighbours but one.
use Mass as r[i in 1..3, j in 1..4](T_0 = 300 [K] + 10 [K]*i*j)
use Wall as down[i in 1..2, j in 1..4]
use Wall as right[i in 1..3, j in 1..3]
connect r[i, j].p -> down[i, j].a for i in 1..2, j in 1..4
connect down[i, j].b -> r[i + 1, j].p for i in 1..2, j in 1..4
connect r[i, j].p -> right[i, j].a for i in 1..3, j in 1..3
connect right[i, j].b -> r[i, j + 1].p for i in 1..3, j in 1..3 if not (i == 2 and j == 2)
eq right[2, 2].b.T = right[2, 2].a.T

# A source at a node: current through resistors in series and parallel.
connector Pin { v : V, flow i : A }
component Resistor  { param R : ohm = 1; port p, n : Pin; eq p.i = (p.v - n.v)/R; eq n.i = -p.i }
component Capacitor { port p, n : Pin; state u : V = 1; eq p.v - n.v = u; eq 2 [S s]*d/dt u = p.i; eq n.i = -p.i }
component Ground    { port p : Pin; eq p.v = 0 [V] }
use Resistor as R1, R2(R = 2 [ohm]), R3(R = 3 [ohm])
use Capacitor as C1
use Ground as ground
connect C1.p -> R1.p
connect R1.n -> R2.p -> R3.p
connect R2.n -> R3.n -> ground.p -> C1.n

# Heat that is given from outside enters a node by an equation.
use Mass as boiler
use Wall as pipe
component Source { port p : Heat; eq p.Q = -heat }
use Source as source
use Mass as tank
connect source.p -> boiler.p -> pipe.a
connect pipe.b -> tank.p

# Closed forms; matrix exponentials of the Laplacian of the grid by SciPy.
test "networks have the trajectories of their matrices" {
  start nominal
  heat = 100
  steps 3
  expect room.T within 1e-6 of 318.9252064059372
  expect air.T within 1e-6 of 307.76869839851565
  expect hot.T within 1e-6 of 377.44058180470137
  expect cold.T within 1e-6 of 322.5594181952987
  expect layers.inner.b.T within 1e-6 of 350
  expect hub.T within 1e-6 of 430.1194211912202
  expect rim[west].T within 1e-6 of 369.8805788087798
  expect r[1, 1].T within 1e-6 of 320.8645995048463
  expect r[2, 3].T within 1e-6 of 363.82549562218753
  expect r[3, 4].T within 1e-6 of 390.4499819195013
  expect C1.u within 1e-8 of 0.0010937076750024536
  expect R2.p.v within 1e-8 of 0.000596567822728611
  expect boiler.T within 1e-6 of 323.7350723510975
  expect tank.T within 1e-6 of 306.2649276489025
}
