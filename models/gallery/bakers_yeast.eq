model BakersYeast "Fed-batch cultivation of baker's yeast: overflow of glucose to ethanol at limited respiration"

# B. Sonnleitner, O. Kappeli, Growth of Saccharomyces cerevisiae is controlled by its limited respiratory capacity: formulation and
# verification of a hypothesis, Biotechnology and Bioengineering 28 (1986) 927-937: the bottleneck of respiration, yields and
# largest rates. Inhibition of respiration by ethanol, vessel and transfer of oxygen are of this file.
#
# Task: as much yeast as possible by the feed: too much sugar goes to ethanol, too little leaves the cells hungry.
#
# Checked: trajectories of SciPy, through the switch between respiration and fermentation.

time t : h

param q_S  : 1/h = 3.5                                              "largest uptake of glucose, g per g of yeast"
param q_O  : 1/h = 0.256                                            "largest uptake of oxygen, g per g of yeast"
param K_S  : g/L = 0.1                                              "half-saturation of glucose"
param K_O  : g/L = 1e-4                                             "half-saturation of oxygen"
param K_E  : g/L = 0.1                                              "half-saturation of ethanol"
param K_iE : g/L = 10                                               "inhibition of respiration by ethanol"
param Y_1        = 0.49                                             "yeast by respiration of glucose"
param Y_2        = 0.05                                             "yeast by fermentation of glucose"
param Y_3        = 0.72                                             "yeast by respiration of ethanol"
param a_1        = 0.396                                            "oxygen by respiration of glucose"
param a_3        = 1.104                                            "oxygen by respiration of ethanol"
param Y_E        = 0.48                                             "ethanol by fermentation of glucose"
param kLa  : 1/h = 500                                              "transfer of oxygen"
param O_s  : g/L = 0.0075                                           "saturation of oxygen"
param S_f  : g/L = 350    ~ 350*uniform(0.95, 1.05)  in 300..400    "glucose in the feed of the batch"

action F : L/h = 0.05 in 0..0.6    "feed"

state X : g/L = 2      in 0..200                 "yeast"
state S : g/L = 0.1    in 0..100                 "glucose"
state E : g/L = 0.5    in 0..100                 "ethanol"
state O : g/L = 0.007  in 0..0.05  scale 1e-3    "oxygen"
state V : L   = 5      in 0..15                  "volume"

disturbance w = 1 ~ 1 + 0.9*(w - 1) + normal(0, 0.02) clip bounds in 0.7..1.2    "transfer of oxygen, relative"

let glucose  : 1/h = q_S*S/(K_S + S)                         "uptake of glucose"
let capacity : 1/h = q_O*O/(K_O + O)*K_iE/(K_iE + E)         "respiratory capacity"
let r_1      : 1/h = min(glucose, capacity/a_1)              "respiration of glucose"
let r_2      : 1/h = glucose - r_1                           "fermentation of glucose"
let r_3      : 1/h = (capacity - a_1*r_1)/a_3*E/(K_E + E)    "respiration of ethanol"
let mu       : 1/h = Y_1*r_1 + Y_2*r_2 + Y_3*r_3             "growth rate"

eq d/dt X = (mu - F/V)*X
eq d/dt S = F/V*(S_f - S) - (r_1 + r_2)*X
eq d/dt E = (Y_E*r_2 - r_3)*X - F/V*E
eq d/dt O = w*kLa*(O_s - O) - (a_1*r_1 + a_3*r_3)*X - F/V*O
eq d/dt V = F

observe X, S, E, O, V, left = 1 - n/200 in 0..1
level online "oxygen, ethanol in the gas, and volume" {
  observe O noise normal(0, 5e-5), E noise normal(0, 0.05), V, left = 1 - n/200 in 0..1
}

reward yeast default = (X*V - previous(X*V))/1 [g] - 0.1*max(E - 1 [g/L], 0 [g/L])/1 [g/L]    "yeast made, less ethanol beyond 1 g/L"
constraint ethanol when E > 5 [g/L]
fail full when V >= 10 [L]
episode { step = 0.1 [h], max_steps = 200, error_reward = -100 }
solver  { method = auto, rtol = 1e-8 }

policy recipe "exponential feed below the bottleneck" { F = min(0.0055 [L/h]*exp(0.18*n*step/1 [h]), 0.3 [L/h]) }
