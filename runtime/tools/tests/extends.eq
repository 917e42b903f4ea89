# Components, levels and variants that extend others; the expected values are by hand.
time t : min
connector Stream { Q : L/min }
component Tank(n = 2) "a tank" {
  param V0 : L = 1
  param k : 1/min = 1
  port inlet : Stream
  state V : L = 1 in 0..100
  eq d/dt V = inlet.Q - k*V
  observe V
}
component Leaky extends Tank {
  param k : 1/min = 2
  param leak : L/min = 0.5
  eq d/dt V = inlet.Q - k*V - leak
}
component Tall(m = 3) extends Leaky "taller" { param leak : L/min = m*0.1 [L/min]; state W : L = n*1 [L]; eq d/dt W = 0 }
use Tank as T1
use Leaky as T2(leak = 0.25 [L/min])
use Tall as T3(n = 5)
eq T1.inlet.Q = 2 [L/min]
eq T2.inlet.Q = 2 [L/min]
eq T3.inlet.Q = 2 [L/min]
action u = 0 in 0..1
observe u in 0..1
level plant extends default { observe w = T3.W in 0..10; observe u in 0..2 }
level more extends plant { observe z = T2.V in 0..1 }
param q = 1
variant w extends v { param q = 3 }
variant v { param q = 2; param r = 7 }
episode { step = 1 [min], max_steps = 2 }
test "rates" {
  start nominal
  expect der(T1.V) within 1e-12 of 1 [L/min]
  expect der(T2.V) within 1e-12 of -0.25 [L/min]
  expect der(T3.V) within 1e-12 of -0.3 [L/min]
  expect T3.W within 0 of 5 [L]
  expect q within 0 of 1
}
test "variant" { variant w; start nominal; expect q within 0 of 3; expect r within 0 of 7 }
test "level" { level more; start nominal; expect q > 0 }
