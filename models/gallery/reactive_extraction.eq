model ReactiveExtraction "Extraction with reaction A + B -> C in the extract: five stages in counter-current"

# The system multistage_extraction_reactive of pc-gym (M. Bloor et al., arXiv:2410.22093), with its parameters; flows of this
# file are so slow that the small transfer coefficient matters.
#
# Task: maximise the product C in the leaving extract per solvent while the feed of A varies.
#
# Checked: A and C that leave are the A that enters, at rest; trajectories of SciPy.

time t : h

param V_l : m^3          = 5       "liquid of a stage"
param V_g : m^3          = 5       "extract of a stage"
param m   : kmol/m^3     = 1       "constant of the equilibrium X = Y^2/m"
param Kla : 1/h          = 0.01    "transfer coefficient"
param k   : m^3/(kmol h) = 0.1     "rate constant"
param B_6 : kmol/m^3     = 2       "B in the solvent"
set stages = 1..5

action L : m^3/h = 0.1  in 0.02..1    "flow of the liquid"
action G : m^3/h = 0.1  in 0.02..1    "flow of the solvent"

state X[i in stages] : kmol/m^3 = 1    in 0..4    "A in the liquid"
state A[i in stages] : kmol/m^3 = 0.2  in 0..4    "A in the extract"
state B[i in stages] : kmol/m^3 = 1    in 0..4    "B in the extract"
state C[i in stages] : kmol/m^3 = 0.5  in 0..4    "C in the extract"

disturbance X_0 : kmol/m^3 = 2 ~ 2 [kmol/m^3] + 0.9*(X_0 - 2 [kmol/m^3]) + 0.05 [kmol/m^3]*normal(0, 1) clip bounds in 1..3    "A in the feed"

let Q[i in stages] : kmol/h       = Kla*V_l*(X[i] - sq(A[i])/m)    "transfer to the extract"
let r[i in stages] : kmol/(m^3 h) = k*A[i]*B[i]                    "rate of reaction"

eq V_l * d/dt X[i] = L*((if i == 1 then X_0 else X[i-1]) - X[i]) - Q[i]                        for i in stages
eq V_g * d/dt A[i] = G*((if i == 5 then 0 [kmol/m^3] else A[i+1]) - A[i]) + Q[i] - r[i]*V_g    for i in stages
eq V_g * d/dt B[i] = G*((if i == 5 then B_6 else B[i+1]) - B[i]) - r[i]*V_g                    for i in stages
eq V_g * d/dt C[i] = G*((if i == 5 then 0 [kmol/m^3] else C[i+1]) - C[i]) + r[i]*V_g           for i in stages

steady { L = 0.1, G = 0.1 }
initial x = value(steady(x))    for x in states

observe X[5], A[1], B[1], C[1], X_0 in 0..4
level online "analysis of both streams that leave, a step late" {
  observe X[5] delay 1 noise normal(0, 0.02), C[1] delay 1 noise normal(0, 0.02)
}

let product : kmol/h = G*C[1]    "product that leaves"
reward production default = 100 [h/kmol]*product - 10*sq((X[5] - steady(X[5]))/0.2 [kmol/m^3]) - 5 [h/m^3]*G
    "product, less what its raffinate deviates and its solvent costs"
constraint lost when X[5] > 1.5 [kmol/m^3]
fail state_box when outside bounds(X, A, B, C)
episode { step = 10 [h], max_steps = 100, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }
