model Reactor "Continuous stirred-tank reactor: A -> B, first order, exothermic, with a cooling jacket"

# Pannocchia and Rawlings, AIChE Journal 49 (2003) 426-437; Rawlings and Mayne, Model Predictive Control, Example 1.11.

time t : min

param q_in   : m^3/min        = 0.1                   "feed flow"
param T_f    : degC           = 76.85                 "feed temperature"
param c_Af   : kmol/m^3       = 1.0                   "concentration of A in the feed"
param r      : m              = 0.219   in 0.05..5    "radius of the tank"
param k_0    : 1/min          = 7.2e10                "pre-exponential factor"
param E_R    : K              = 8750                  "activation energy over the gas constant"
param U      : kJ/(min m^2 K) = 54.94                 "heat-transfer coefficient of the wall"
param rho    : kg/m^3         = 1000                  "density of the mixture"
param c_p    : kJ/(kg K)      = 0.239                 "heat capacity of the mixture"
param dH     : kJ/kmol        = -5.0e4                "heat of reaction (negative: exothermic)"
param V_0    : m^3            = 1e-8                  "heel volume; guards the division when the tank runs empty"
param spread : 1              = 0.3     in 0..1       "half width of the initial distribution, relative to the set-point"
param D_rel  : 1              = 0       in 0..1       "optional floor of the distance scale, relative to the set-point"

action T_c   : degC    = 26.85  in 15..35       "temperature of the coolant in the jacket"
action q_out : m^3/min = 0.1    in 0.05..0.2    "outflow"

state c_A : kmol/m^3 = 0.8778252    in 1e-8..1      "concentration of A"
state T   : degC     = 51.34660837  in 1e-8..100    "temperature of the mixture"
state h   : m        = 0.659        in 1e-8..1      "level"

let V    : m^3            = pi * r^2 * h + V_0             "volume"
let k    : 1/min          = k_0 * exp(-E_R / kelvin(T))    "rate constant"
let rate : kmol/(m^3 min) = k * c_A                        "reaction rate"

eq d/dt c_A = q_in/V * (c_Af - c_A) - rate
eq d/dt T   = q_in/V * (T_f - T) - dH/(rho*c_p) * rate + 2*U/(r*rho*c_p) * (T_c - T)
eq d/dt h   = (q_in - q_out) / (pi*r^2)

invariant A = V*c_A rate q_in*c_Af - q_out*c_A - V*rate    "moles of A"

steady { T_c = 26.85, q_out = 0.1, h = 0.659 }

set box = (c_A, T, h)
initial x ~ value(steady(x)) * uniform(1 - spread, 1 + spread) clip bounds    for x in box

observe c_A, T, h

level online "thermometer and level gauge; the concentration is hidden" {
  observe T noise normal(0, 0.1), h noise normal(0, 0.002)
}
level laboratory extends online "with a sample every five steps, analysed three steps later" {
  observe c_A every 5 delay 3 noise normal(0, 0.005)
}

let distance = -mean(sq(x - steady(x)) / max(sq(initial(x) - steady(x)), sq(1e-4 [unit(x)]), sq(D_rel * value(steady(x)) as [unit(x)])) for x in box)

let limited = max(-1000, distance)

reward setpoint default = limited                        "squared distance, relative to that of the start"
reward setpoint_change  = limited - previous(limited)    "its change over the step"

fail state_box when outside bounds(box)
fail empty event h <= 1e-8 [m]    "the tank has run empty"

# `auto` keeps the states of whole random episodes within 1e-7 of their ranges: `python -m smpl.bench episodes`.
episode { step = 0.1 [min], max_steps = 100, error_reward = -1000 }
solver  { method = auto, rtol = 5e-10, one_step_rtol = 1e-9 }

variant published_setpoint "set-point as printed, rounded to single precision" {
  steady { c_A = 0.8778252005577087, T = 51.34660720825195, h = 0.6589999794960022, T_c = 26.85, q_out = 0.1 }
}
variant limited_change "losses of a step are limited, gains are not: an episode that goes far and comes back is paid without end" {
  reward setpoint_change = max(-1000, distance - previous(distance))    "its change over the step"
}
variant reward_floor "a reward at the error reward ends the episode" { fail reward_floor when reward <= error_reward }

# ---- The plant's world: what else changes, each alone or together ----

variant feed_disturbances "temperature and concentration of the feed wander" {
  param T_f_mean  : degC     = 76.85    "mean temperature of the feed"
  param c_Af_mean : kmol/m^3 = 1.0      "mean concentration of A in the feed"
  disturbance T_f_shift  : K        = 0 ~ 0.95*T_f_shift + 0.5 [K]*normal(0, 1)              "temperature of the feed beyond its mean"
  disturbance c_Af_shift : kmol/m^3 = 0 ~ 0.95*c_Af_shift + 0.005 [kmol/m^3]*normal(0, 1)    "concentration beyond its mean"
  let T_f  : degC     = T_f_mean + T_f_shift      "feed temperature"
  let c_Af : kmol/m^3 = c_Af_mean + c_Af_shift    "concentration of A in the feed"
}
variant fouling "the wall fouls: its heat transfer falls, faster in some episodes than in others" {
  param U_clean : kJ/(min m^2 K) = 54.94    "heat-transfer coefficient of the clean wall"
  random foulness ~ uniform(0.5, 1.5)
  disturbance fouled = 0 ~ min(fouled + 0.0015*foulness, 0.3)    "share of the heat transfer that is lost"
  let U : kJ/(min m^2 K) = U_clean * (1 - fouled)    "heat-transfer coefficient of the wall"
}
variant sticking_valve "the valve of the outflow moves only where it is to move by more than its band" {
  param stiction : m^3/min = 0.005 in 0..0.05    "band of the valve"
  discrete q_valve : m^3/min = 0.1 in 0.05..0.2    "flow that the valve lets through"
  at start { next q_valve = if abs(q_out - q_valve) > stiction then q_out else q_valve }
  eq d/dt h = (q_in - q_valve) / (pi*r^2)
  invariant A = V*c_A rate q_in*c_Af - q_valve*c_A - V*rate    "moles of A"
}
variant sensor_bias "the thermometer has an offset that drifts, the level gauge one that stays" {
  random offset_T ~ normal(0, 1)
  random offset_h ~ normal(0, 1)
  disturbance drift_T : K = 0 ~ drift_T + 0.02 [K]*normal(0, 1)    "drift of the thermometer"
  observe T : degC = T + offset_T*0.5 [K] + drift_T in 1e-8..100
  observe h : m = h + offset_h*0.01 [m] in 1e-8..1
}
variant setpoint_schedule "set-points of temperature and level that change before steps 30 and 60" {
  disturbance T_sp : degC = 51.34660837 ~ if n < 30 then 51.34660837 else if n < 60 then 48 else 53    "set-point of the temperature"
  disturbance h_sp : m    = 0.659       ~ if n < 30 then 0.659 else if n < 60 then 0.6 else 0.7        "set-point of the level"
  observe T_sp in 30..70, h_sp in 0.4..0.9
  reward setpoint default = -sq((T - T_sp)/5 [K]) - sq((h - h_sp)/0.05 [m])    "squared distance from the set-points in force"
}
variant setpoint_random extends setpoint_schedule "set-points of temperature and level that change every 25 steps, to what is drawn" {
  disturbance T_sp : degC = 51.34660837 ~ if n > 0 and mod(n, 25) == 0 then 47 [degC] + 8 [K]*uniform(0, 1) else T_sp    "set-point of the temperature"
  disturbance h_sp : m    = 0.659       ~ if n > 0 and mod(n, 25) == 0 then 0.55 [m] + 0.2 [m]*uniform(0, 1) else h_sp    "set-point of the level"
}

# ---- Tests: `smpl test models/reactor.eq`, against the published steady states ----

test "the set-point is the published stable steady state, and the plant rests there" {
  start steady
  expect c_A within 1e-9 of 0.8778252005501434
  expect T within 1e-7 of 51.34660619295078
  steps 100
  expect steady
  expect T within 1e-6 of 51.34660619295078
}
test "the saddle is a steady state too, and a slightly warmer jacket ignites the plant from there" {
  start steady
  c_A = 0.501894113975015
  T = 76.84405451311673
  expect steady
  T_c = 27.5 for 2 [min]
  expect failure state_box
}
test "the closed outlet overfills the tank" {
  start steady
  q_out = 0.05 for 10 [min]
  expect failure state_box
}
