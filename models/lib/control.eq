# Instruments and continuous controllers. A signal is a fraction of a range, 0 to 1, as instruments send it.
#
# Source: K. J. Astrom and T. Hagglund, Advanced PID Control (2006): back-calculation with a tracking time, derivative of the filtered
# measurement; Q. P. He et al., Ind. Eng. Chem. Res. 46 (2007) 2010: stiction of valves.
# Range: gains in fractions of the ranges; a negative gain makes a controller direct-acting.

connector Signal { y : 1 }

component Sensor "lag of first order and a bias; noise belongs to the observation" {
  param tau  : s = 10  in 0..inf    "time constant"
  param bias : 1 = 0                "bias"
  port input, output : Signal
  state y : 1 = 0.5 in -1..2 scale 1    "fraction of the range, without the bias"
  eq d/dt y   = (input.y - y)/tau
  eq output.y = y + bias
}

# In automatic mode the integral tracks the limited output, in manual mode (`auto` below one half) the output `manual` of the
# operator, so that the change of the mode causes no bump: the model updates both, `at start { next TC.auto = 0 }`.
component PI "proportional and integral, with anti-windup and manual mode" {
  param K    : 1 = 1                 "gain"
  param T_i  : s = 60   in 0..inf    "integral time"
  param T_t  : s = T_i  in 0..inf    "tracking time"
  param low  : 1 = 0                 "lowest output"
  param high : 1 = 1                 "highest output"
  port measured, output : Signal
  var setpoint : 1 = 0.5
  discrete auto   : 1 = 1    in 0..1     "automatic mode, if at least one half"
  discrete manual : 1 = 0.5  in -1..2    "output in manual mode"
  state I : 1 = 0.5 in -10..10 scale 1    "integral part"
  let unlimited : 1 = K*(setpoint - measured.y) + I    "output without limits"
  eq output.y = if auto >= 0.5 then clip(unlimited, low, high) else manual
  eq d/dt I   = K*(setpoint - measured.y)/T_i + (output.y - unlimited)/T_t
}

component PID extends PI {
  param T_d : s = 10             in 0..inf    "derivative time"
  param N   : 1 = 10             in 0..inf    "derivative time over the time constant of its filter"
  param T_t : s = sqrt(T_i*T_d)  in 0..inf    "tracking time"
  state f : 1 = 0.5 in -1..2 scale 1    "filtered measurement"
  let slope     : 1/s = (measured.y - f)*N/T_d
  let unlimited : 1   = K*(setpoint - measured.y - T_d*slope) + I    "output without limits"
  eq d/dt f = slope
}

# Between a controller and a valve: `connect TC.output -> S.input`, `connect S.output -> V.opening`.
component Stiction "stem that sticks until the signal has moved by the static friction, and then slips" {
  param static  : 1 = 0.05  in 0..inf    "static friction, in the unit of the signal"
  param kinetic : 1 = 0.02  in 0..inf    "kinetic friction, less than the static one"
  port input, output : Signal
  discrete stem : 1 = input.y in -1..2    "position of the stem"
  event slips when abs(input.y - stem) > static
  at slips { next stem = input.y - sign(input.y - stem)*kinetic }
  eq output.y = stem
}
