model AdvectionReaction "A + B -> C in a tube: upwind advection, one rate with an exponential in each cell, a jacket"

time t : s

param n_cells       = 425      "cells"
param sampling : s  = 3        "length of a control step"
param U        : 1/s = 0.5     "heat transfer over heat capacity"
param heat     : K  = 40       "adiabatic rise"
param k_0      : 1/s = 3e7     "pre-exponential factor"
param E_R      : K  = 6000     "activation energy over the gas constant"
param v        : 1/s = 1 in 0..inf    "velocity over length"

action T_j : K = 330 in 300..360    "jacket"

domain z in 0..1 cells n_cells scheme upwind

state A[z] = 0   in -inf..inf scale 1
state B[z] = 0   in -inf..inf scale 1
state C[z] = 0   in -inf..inf scale 1
state T[z] : K = 330 in -inf..inf scale 1

let rate[z] = k_0 * exp(-E_R/T[z]) * A[z] * B[z]

flux J_A[z] = v*A[z], low = v*1
flux J_B[z] = v*B[z], low = v*1.2
flux J_C[z] = v*C[z], low = v*0
flux J_T[z] = v*T[z], low = v*350 [K]

eq d/dt A[z] = -div(J_A[z]) - rate[z]                          for z
eq d/dt B[z] = -div(J_B[z]) - rate[z]                          for z
eq d/dt C[z] = -div(J_C[z]) + rate[z]                          for z
eq d/dt T[z] = -div(J_T[z]) + heat*rate[z] - U*(T[z] - T_j)    for z

observe A[z.last] in 0..2, C[z.last] in 0..2, T[z.last] in 250..450
reward made default = C[z.last]

episode { step = sampling, max_steps = 1000, error_reward = -1 }
solver  { rtol = 1e-6, atol_factor = 1 }
