model Biofilm "Nitrification in a biofilm reactor: three stages of a fluidised bed and an absorber with recycle"

# The system biofilm_reactor of pc-gym (M. Bloor et al., arXiv:2410.22093), with its parameters; J. Ingham et al., Chemical
# Engineering Dynamics (Wiley-VCH), example on nitrification in a fluidised bed. Reactions consume ammonia and oxygen here;
# pc-gym 0.1.8 has the opposite sign in its three stages.
#
# Task: keep ammonia in the effluent low at little recycle while flow and ammonia of the feed vary.
#
# Checked: nitrogen that enters equals nitrogen that leaves, at rest; trajectories of SciPy.

time t : h

param V     : L        = 10     "volume of a stage"
param V_a   : L        = 15     "volume of the absorber"
param Kla   : 1/h      = 1.5    "transfer of oxygen"
param O_sat : mg/L     = 600    "saturation of oxygen in the absorber, as of pc-gym"
param v_1   : mg/(L h) = 0.8    "largest rate from ammonia to nitrite"
param v_2   : mg/(L h) = 1      "largest rate from nitrite to nitrate"
param K_1   : mg/L     = 0.5    "half-saturation of ammonia"
param K_2   : mg/L     = 0.1    "half-saturation of nitrite"
param K_O1  : mg/L     = 1.5    "half-saturation of oxygen, first reaction"
param K_O2  : mg/L     = 0.5    "half-saturation of oxygen, second reaction"
set places = 1..4    # 1 to 3: stages, 4: absorber

action F_r : L/h = 30  in 5..100    "recycle"
action F   : L/h = 3   in 0.5..8    "feed"

state S_1[i in places] : mg/L = 1    in 0..50      "ammonia"
state S_2[i in places] : mg/L = 0.5  in 0..50      "nitrite"
state S_3[i in places] : mg/L = 5    in 0..50      "nitrate"
state O[i in places]   : mg/L = 500  in 0..1000    "oxygen"

disturbance S_in : mg/L = 10 ~ 10 [mg/L] + 0.95*(S_in - 10 [mg/L]) + 0.2 [mg/L]*normal(0, 1) clip bounds in 5..15    "ammonia in the feed"

let r_1[i in places] : mg/(L h) = if i == 4 then 0 [mg/(L h)] else v_1*S_1[i]/(K_1 + S_1[i])*O[i]/(K_O1 + O[i])
let r_2[i in places] : mg/(L h) = if i == 4 then 0 [mg/(L h)] else v_2*S_2[i]/(K_2 + S_2[i])*O[i]/(K_O2 + O[i])

eq V * d/dt S_1[i]   = F_r*((if i == 1 then S_1[4] else S_1[i-1]) - S_1[i]) - V*r_1[i]    for i in 1..3
eq V * d/dt S_2[i]   = F_r*((if i == 1 then S_2[4] else S_2[i-1]) - S_2[i]) + V*(r_1[i] - r_2[i])    for i in 1..3
eq V * d/dt S_3[i]   = F_r*((if i == 1 then S_3[4] else S_3[i-1]) - S_3[i]) + V*r_2[i]    for i in 1..3
eq V * d/dt O[i]     = F_r*((if i == 1 then O[4] else O[i-1]) - O[i]) - V*(3.5*r_1[i] + 1.1*r_2[i])    for i in 1..3
eq V_a * d/dt S_1[4] = F_r*(S_1[3] - S_1[4]) + F*(S_in - S_1[4])
eq V_a * d/dt S_2[4] = F_r*(S_2[3] - S_2[4]) - F*S_2[4]
eq V_a * d/dt S_3[4] = F_r*(S_3[3] - S_3[4]) - F*S_3[4]
eq V_a * d/dt O[4]   = F_r*(O[3] - O[4]) + V_a*Kla*(O_sat - O[4])

steady { F_r = 30, F = 3 }
initial x = value(steady(x))    for x in states

observe S_1[4], S_2[4], S_3[4], O[4], S_in in 0..20
level online "ammonia with noise, two steps late, and oxygen" { observe S_1[4] delay 2 noise normal(0, 0.1), O[4] noise normal(0, 2) }

reward operation default = -sq((S_1[4] - steady(S_1[4]))/0.5 [mg/L]) - 0.1*sq((F - nominal(F))/1 [L/h]) - 1e-4*sq((F_r - nominal(F_r))/5 [L/h])
    "deviation of the effluent, of the throughput, and use of the pump"
constraint effluent when S_1[4] > 4 [mg/L]
fail state_box when outside bounds(S_1, S_2, S_3, O)
episode { step = 1 [h], max_steps = 150, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }

# ---- Tests: `smpl test models/gallery/biofilm.eq`, against balances ----

test "nitrogen is kept" {
  start steady
  expect S_1[4] + S_2[4] + S_3[4] within 1e-7 of 10
}
