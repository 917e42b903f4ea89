model Packages "switches, packages, components and arrays as arguments"
time t : s
action u = 0 in 0..1
reward q default = 0
episode { step = 1 [s], max_steps = 100 }
solver { rtol = 1e-10 }

set species = { a, b }
table start[species] : mol = { a: 1, b: 2 }
param doubled[i in species] : mol = 2*start[i]

component Ideal {
  param k : 1/s = 0.1
  table K[species] = { a: 2, b: 0.5 }
  def rate(n) = k*n
  def vapour(x, i in species) = K[i]*x
}
component Fast extends Ideal { param k : 1/s = 0.3 }
component Square {
  param k : 1/(mol s) = 0.25
  table K[species] = { a: 3, b: 1 }
  def rate(n) = k*sq(n)
  def vapour(x, i in species) = K[i]*sq(x)
}

connector Out { flow_out : mol/s }
component Tank(properties = Ideal, leaky = false) {
  param n_0[species] : mol
  state n[i in species] : mol = n_0[i]
  var y[species]
  eq y[i]      = vapour(n[i]/(n[a] + n[b]), i)                        for i in species
  eq d/dt n[i] = -rate(n[i]) - (if leaky then leak else 0 [mol/s])    for i in species
  when leaky = true {
    param leak : mol/s = 0.01
    port drain : Out
    eq drain.flow_out = 2*leak
  }
}
component Column(stage = Tank, count = 2) {
  use stage as s[k in 1..count](n_0 = doubled)
  let total : mol = sum(s[k].n[a] for k in 1..count)
}

choice thermo = Square | Ideal
use Tank as T1(n_0 = start)
use Tank as T2(n_0 = start, properties = Fast, leaky = true)
use Tank as T3(n_0 = doubled, properties = thermo)
use Column as C1
var drained : mol/s
eq drained = T2.drain.flow_out
observe T1.n[a] in 0..10

# Closed forms of first and second order decay.
test "every instance has its own package" {
  start nominal
  expect T1.y[a] within 1e-12 of 2/3
  expect T3.y[b] within 1e-12 of 4/9
  expect C1.total within 0 of 4
  steps 5
  expect T1.n[a] within 1e-8 of exp(-0.5)*1 [mol]
  expect T2.n[b] within 1e-8 of (2 + 0.01/0.3)*exp(-1.5)*1 [mol] - 0.01/0.3*1 [mol]
  expect T3.n[b] within 1e-8 of 4/(1 + 4*0.25*5)*1 [mol]
  expect C1.s[2].n[b] within 1e-8 of 4*exp(-0.5)*1 [mol]
  expect drained within 0 of 0.02
}
