# Functions with arrays, indices and local names; the expected values are by hand.
time t : s
set s = { a, b }
set u = 1..3
set big = 1..40
domain z in 0..1 cells 4
table c[s] : g/mol = { a: 2, b: 3 }
table A[s] = { a: 1, b: 2 }
def total(y[s]) = sum(y[i]*c[i] for i in s)
def plain(y[k]) = sum(y[i] for i in k)
def psat(i in s, T) = A[i]*T
def dot(y[k], w[k]) = sum(y[i]*w[i] for i in k)
def at(y[j in u], i in u) = y[i] + y[1]
def f(T) = { let th : K = T/2; let q = th^2; q + th*1 [K] }
def g(T) = {
  let h = 2*T
  let k = h +
    1 [K]
  k
}
def outer(y[s]) = total(y) + psat(b, 1 [mol/L])*1 [g/mol]
def cell(y[z], i in z) = y[i]
def norm(y[k]) = dot(y, y)
state x[s] : mol/L = 1
state n[u] = 2
state m[i in big] = 1
state p[z] = 3
let two[i in u] = 2*i
eq d/dt x[i] = psat(i, x[i])/1 [s] for i in s
eq d/dt n[j] = at(n, j)/1 [s] for j in u
eq d/dt m[i] = norm(m)/1 [s] - plain(m)/1 [s] for i in big
eq d/dt p[z] = cell(p, z)/1 [s] for z
let y1 : g/L = total(x)
let y2 = dot(n, two)
let y3 : K^2 = f(4 [K])
let y4 : K = g(300 [K])
let y5 : g/L = outer(x)
let y6 = plain(p)
episode { step = 1 [s], max_steps = 1 }
test "values" {
  start nominal
  expect y1 within 1e-12 of 5 [g/L]
  expect y2 within 1e-12 of 24
  expect y3 within 1e-12 of 6 [K^2]
  expect y4 within 1e-12 of 601 [K]
  expect y5 within 1e-12 of 7 [g/L]
  expect y6 within 1e-12 of 12
  expect der(x[b]) within 1e-12 of 2 [mol/L/s]
  expect der(n[2]) within 1e-12 of 4 [1/s]
  expect der(m[7]) within 1e-12 of 0 [1/s]
  expect der(p[3]) within 1e-12 of 3 [1/s]
}
