model Fekete "elliptic Fekete points: twenty particles on a sphere repel each other; index 2, 160 unknowns"

# Test Set for IVP Solvers, problem FEKETE: p' = q + G'mu, q' = f(p, q) + G'lambda, |p|^2 = 1, G q = 0.
time t : s
set k = 1..20
set c = {x, y, z}

state p[c, k] = 0.5
state q[c, k] : 1/s = 0
var   mu[k] : 1/s
var   lambda[k] : 1/s^2

eq d/dt p[a, i] = q[a, i] + 2*mu[i]*p[a, i]    for a in c, i in k
eq d/dt q[a, i] = sum((p[a, i] - p[a, j])/(sum(sq(p[b, i] - p[b, j]) for b in c) + (if i == j then 1 else 0)) for j in k)*1 [1/s^2]
  - 0.5 [1/s]*q[a, i] + 2*lambda[i]*p[a, i]    for a in c, i in k
eq sum(sq(p[a, i]) for a in c) = 1             for i in k
eq 2*sum(p[a, i]*q[a, i] for a in c) = 0       for i in k

let alpha[i in k] : 1 = if i < 4 then 2*pi*i/3 + pi/13 else if i < 11 then 2*pi*(i - 3)/7 + pi/29
  else if i < 17 then 2*pi*(i - 10)/6 + pi/7 else 2*pi*(i - 16)/4 + pi/17
let beta[i in k] : 1 = if i < 4 then 3*pi/8 else if i < 11 then pi/8 else if i < 17 then -2*pi/15 else -3*pi/10
initial p[x, i] = cos(alpha[i])*cos(beta[i])   for i in k
initial p[y, i] = sin(alpha[i])*cos(beta[i])   for i in k
initial p[z, i] = sin(beta[i])                 for i in k

episode { step = 1000 [s], max_steps = 1 }
solver  { rtol = 1e-8 }
