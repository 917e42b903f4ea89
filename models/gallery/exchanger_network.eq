model ExchangerNetwork "Heat exchanger network: two hot streams heat a cold one in three exchangers with bypasses"

# A network of this collection; bypasses as manipulated variables as in K. W. Mathisen, Integrated design and control of heat
# exchanger networks (thesis, NTH Trondheim, 1994). Each exchanger has five mixed segments on both sides; fluid and wall of a
# side share a temperature.
#
# Task: keep the outlets of the cold stream and of both hot streams at their set-points by three bypasses while inlets vary.
#
# Checked: heat lost by the hot streams is heat gained by the cold one, at rest; trajectories of SciPy.

time t : min

connector Stream { w : kW/K, T : degC }

component Exchanger(m = 5) "counter-current, heat capacity flows w" {
  param UA : kW/K          "heat transfer"
  param H  : kJ/K = 300    "heat capacity of each side"
  port hot_in, hot_out, cold_in, cold_out : Stream
  var by    "share of the hot stream that passes by"
  state T_h[j in 1..m] : degC = 120  in 0..300    "hot side"
  state T_c[j in 1..m] : degC = 80   in 0..300    "cold side"
  eq H/m * d/dt T_h[j] = (1 - by)*hot_in.w*((if j == 1 then hot_in.T else T_h[j-1]) - T_h[j]) - UA/m*(T_h[j] - T_c[j])    for j in 1..m
  eq H/m * d/dt T_c[j] = cold_in.w*((if j == m then cold_in.T else T_c[j+1]) - T_c[j]) + UA/m*(T_h[j] - T_c[j])    for j in 1..m
  eq hot_out.w         = hot_in.w
  eq hot_out.T         = T_h[m] + by*(hot_in.T - T_h[m])
  eq cold_out.w        = cold_in.w
  eq cold_out.T        = T_c[1]
}

action b_1 = 0.2  in 0..0.8    "bypass of the first exchanger"
action b_2 = 0.2  in 0..0.8    "bypass of the second exchanger"
action b_3 = 0.2  in 0..0.8    "bypass of the third exchanger"

param w_1 : kW/K = 2      "first hot stream"
param w_2 : kW/K = 1.5    "second hot stream"
param w_c : kW/K = 2.5    "cold stream"

disturbance T_1 : degC = 180 ~ 180 [degC] + 0.97*(T_1 - 180 [degC]) + 0.5 [K]*normal(0, 1) clip bounds  in 165..195    "first hot inlet"
disturbance T_2 : degC = 150 ~ 150 [degC] + 0.97*(T_2 - 150 [degC]) + 0.5 [K]*normal(0, 1) clip bounds  in 135..165    "second hot inlet"
disturbance T_0 : degC = 40  ~ 40 [degC] + 0.97*(T_0 - 40 [degC]) + 0.4 [K]*normal(0, 1) clip bounds  in 30..50      "cold inlet"

# The cold stream meets the second hot stream, then twice the first.
use Exchanger as A(UA = 3)
use Exchanger as B(UA = 3)
use Exchanger as C(UA = 3)
eq A.by        = b_1
eq B.by        = b_2
eq C.by        = b_3
eq A.cold_in.w = w_c
eq A.cold_in.T = T_0
connect A.cold_out -> B.cold_in
connect B.cold_out -> C.cold_in
eq A.hot_in.w = w_2
eq A.hot_in.T = T_2
eq C.hot_in.w = w_1
eq C.hot_in.T = T_1
connect C.hot_out -> B.hot_in

let T_c  : degC = C.cold_out.T    "outlet of the cold stream"
let T_h1 : degC = B.hot_out.T     "outlet of the first hot stream"
let T_h2 : degC = A.hot_out.T     "outlet of the second hot stream"

steady { b_1 = 0.2, b_2 = 0.2, b_3 = 0.2 }
initial x = value(steady(x))    for x in states

observe T_c in 0..300, T_h1 in 0..300, T_h2 in 0..300, T_0 in 0..100
level online "thermometers of the outlets" {
  observe T_c in 0..300 noise normal(0, 0.2), T_h1 in 0..300 noise normal(0, 0.2), T_h2 in 0..300 noise normal(0, 0.2)
}

reward outlets default = -sq((T_c - steady(T_c))/1 [K]) - sq((T_h2 - steady(T_h2))/2 [K])    "squared deviations of two outlets"
constraint cold when T_c < 115 [degC]
constraint warm when T_h2 > 110 [degC]
fail box when T_c > 175 [degC] or T_c < 90 [degC]
episode { step = 0.5 [min], max_steps = 200, error_reward = -1000 }
solver  { method = auto, rtol = 1e-8 }
