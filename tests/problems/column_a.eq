model ColumnA "Binary distillation in forty theoretical stages and a total condenser, levels under proportional control"

# "Column A": S. Skogestad, I. Postlethwaite, Multivariable Feedback Control (Wiley 1996); S. Skogestad, Dynamics and control of
# distillation columns - a tutorial introduction, Trans IChemE 75 A (1997) 539-562. Stage 1 is the reboiler, stage N the condenser; constant relative
# volatility and molar flows, linear liquid hydraulics, no vapour holdup. L and V are free ("LV configuration"), D and B hold the levels.

time t : min
param N                = 41
param n_F              = 21         "feed stage"
param alpha            = 1.5        "relative volatility"
param tau_L : min      = 0.063      "time constant of the liquid flow"
param M_0   : kmol     = 0.5        "nominal holdup of each stage"
param L_0   : kmol/min = 2.70629    "nominal reflux"
param F_0   : kmol/min = 1          "nominal feed, boiling liquid"
param K_c   : 1/min    = 10         "gain of the level controllers"
set trays = 1..N

action L : kmol/min = 2.70629  in 2..3.5    "reflux"
action V : kmol/min = 3.20629  in 2.5..4    "boilup"
param  F   : kmol/min = 1               "feed"
param  z_F            = 0.5  in 0..1    "light component in the feed"

state x[i in trays]        = 0.5  in 0..1    "light component in the liquid"
state M[i in trays] : kmol = 0.5  in 0..5    "holdup"

let y[i in trays]            = alpha*x[i] / (1 + (alpha - 1)*x[i])
let D             : kmol/min = 0.5 [kmol/min] + K_c*(M[N] - M_0)
let B             : kmol/min = 0.5 [kmol/min] + K_c*(M[1] - M_0)
# What leaves a stage downwards, and the vapour that rises from below: liquid feed does not change it.
let L_[i in trays]     : kmol/min = if i == N then L else if i == 1 then B else (if i <= n_F then L_0 + F_0 else L_0) + (M[i] - M_0)/tau_L
let fed[i in trays]    : kmol/min = if i == n_F then F else 0 [kmol/min]
let out[i in trays]    : kmol/min = if i == N then D else V
let up[i in trays]     : kmol/min = if i == 1 then 0 [kmol/min] else V
let down[i in trays]   : kmol/min = if i == N then 0 [kmol/min] else L_[i+1]
let y_out[i in trays]             = if i == N then x[N] else y[i]
let x_down[i in trays]            = if i == N then 0 else x[i+1]
let y_up[i in trays]              = if i == 1 then 0 else y[i-1]

eq d/dt M[i]        = down[i] - L_[i] + up[i] - out[i] + fed[i]    for i in trays
eq M[i] * d/dt x[i] = down[i]*(x_down[i] - x[i]) + up[i]*(y_up[i] - x[i]) - out[i]*(y_out[i] - x[i]) + fed[i]*(z_F - x[i])    for i in trays

observe x_D = x[N] in 0..1
observe x_B = x[1] in 0..1
episode { step = 10 [min], max_steps = 200 }
