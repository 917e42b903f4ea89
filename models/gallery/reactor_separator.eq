model ReactorSeparator "Reactor, buffer and separator with recycle: A -> B -> C, B is the product"

# The system RSR of pc-gym (M. Bloor et al., arXiv:2410.22093), with its parameters. A and B go overhead with a constant relative
# volatility and return to the reactor.
#
# Task: keep three integrating levels and the product B in the bottoms while the feed varies.
#
# Checked: the balance of the plant, feed equals bottoms at rest; fractions sum to one; trajectories of SciPy.

time t : min
set species = { A, B, C }

param rho   : kmol/m^3 = 1         "density"
param area  : m^2      = 10        "cross-section of each vessel"
param alpha            = 90        "relative volatility of A"
param k_1   : 1/min    = 0.0167    "A -> B"
param k_2   : 1/min    = 0.0167    "B -> C"
table feed[species] = { A: 1, B: 0, C: 0 }

action F_R : kmol/min = 2.2  in 0..5    "outflow of the reactor"
action F_M : kmol/min = 2.2  in 0..5    "outflow of the buffer"
action P   : kmol/min = 0.4  in 0..1    "bottoms"
action D   : kmol/min = 1.8  in 0..4    "overhead, recycled"

state H_R : m = 1.5  in 0.05..4    "level of the reactor"
state H_M : m = 1.5  in 0.05..4    "level of the buffer"
state H_B : m = 1.5  in 0.05..4    "level of the separator"
state x_R[i in species] = 0.3  in 0..1    "fractions in the reactor"
state x_M[i in species] = 0.3  in 0..1    "fractions in the buffer"
state x_B[i in species] = 0.3  in 0..1    "fractions in the separator"

disturbance F_O : kmol/min = 0.4 ~ 0.4 [kmol/min] + 0.9*(F_O - 0.4 [kmol/min]) + 0.01 [kmol/min]*normal(0, 1) clip bounds in 0.2..0.6    "fresh feed"

let y[i in species] = if i == A then alpha*x_B[A]/(1 + (alpha - 1)*x_B[A])
                      else if i == B then (1 - x_B[A])/(1 + (alpha - 1)*x_B[A]) else 0    "fractions overhead"
let made[i in species] : 1/min = if i == A then -k_1*x_R[A] else if i == B then k_1*x_R[A] - k_2*x_R[B] else k_2*x_R[B]

eq rho*area * d/dt H_R        = F_O + D - F_R
eq rho*area * d/dt H_M        = F_R - F_M
eq rho*area * d/dt H_B        = F_M - P - D
eq rho*area*H_R * d/dt x_R[i] = F_O*(feed[i] - x_R[i]) + D*(y[i] - x_R[i]) + rho*area*H_R*made[i]    for i in species
eq rho*area*H_M * d/dt x_M[i] = F_R*(x_R[i] - x_M[i])                                                for i in species
eq rho*area*H_B * d/dt x_B[i] = F_M*(x_M[i] - x_B[i]) - D*(y[i] - x_B[i])                            for i in species

steady { F_R = 2.2, F_M = 2.2, P = 0.4, D = 1.8, H_R = 1.5, H_M = 1.5, H_B = 1.5 }
initial x = value(steady(x))    for x in states

observe H_R, H_M, H_B, x_B[i] for i in species, x_R[i] for i in species, F_O in 0..2
level online "levels, and an analysis of the bottoms a step late" {
  observe H_R noise normal(0, 0.01), H_M noise normal(0, 0.01), H_B noise normal(0, 0.01), x_B[B] delay 1 noise normal(0, 0.005)
}

reward operation default = -sq((x_B[B] - steady(x_B[B]))/0.02) - 0.1*(sq((H_R - 1.5 [m])/0.3 [m]) + sq((H_M - 1.5 [m])/0.3 [m]) + sq((H_B - 1.5 [m])/0.3 [m]))
    "deviations of the product and of the levels"
constraint low when H_R < 0.5 [m] or H_M < 0.5 [m] or H_B < 0.5 [m]
constraint high when H_R > 3 [m] or H_M > 3 [m] or H_B > 3 [m]
fail empty_reactor event H_R <= 0.1 [m]
fail empty_buffer event H_M <= 0.1 [m]
fail empty_separator event H_B <= 0.1 [m]
fail full when H_R > 4 [m] or H_M > 4 [m] or H_B > 4 [m]
episode { step = 2 [min], max_steps = 200, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }
