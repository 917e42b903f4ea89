model Ticks "several rates inside of a step"
time t : s
action r    = 1  in -10..10
action hold = 0  in 0..2
state x = 0
state y = 0
discrete a = 0
discrete b = 0
discrete u = 0  in 0..2.5
eq d/dt x = a / 1 [s]
eq d/dt y = (u - y) / 5 [s]
at every 3 [s]   { next a = a + 1 }
at every 0.7 [s] { next b = b + a }
control u from y setpoint r gain 0.8 reset 4 [s] manual (if hold > 1 then u else 1.5) when hold > 0.5 every 3 [s]
phase one for 6 [s] then two
phase two for 24 [s] then three
phase three
event mark when t >= 15 [s]
at mark { next marked = 1 }
discrete marked     = 0
discrete ticks_two  = 0
discrete ticks_mark = 0
at every 3 [s] {
  next ticks_two  = ticks_two + (if phase == two then 1 else 0)
  next ticks_mark = ticks_mark + marked
}
observe x in -1e9..1e9, y in -1e9..1e9
reward q default = -sq(y - r)
episode { step = 10 [s], max_steps = 100 }
solver { rtol = 1e-10 }

# Number of instants, and integrals of a staircase, in closed form; the last b has a meeting of both intervals, at 21 s.
test "instants lie at multiples of their intervals" {
  start nominal
  steps 1
  expect a within 0 of 4
  expect b within 0 of 32
  expect x within 1e-7 of 22
  steps 2
  expect a within 0 of 10
  expect b within 0 of 231
  expect x within 1e-7 of 165
}

# Counted: 6, 9, ..., 27 and 15, 18, ..., 27, although the phase ends inside of a step once and at its end once.
test "events and ends of phases precede an instant at the same time" {
  start nominal
  steps 3
  expect ticks_two within 0 of 8
  expect ticks_mark within 0 of 5
  steps 1
  expect ticks_two within 0 of 8
  expect ticks_mark within 0 of 9
}

# NumPy with the exact step of a first-order lag between the instants.
test "a controller follows its set-point" {
  start nominal
  steps 3
  expect y within 1e-7 of 0.9902588565903578
  r = 2
  steps 3
  expect y within 1e-7 of 1.9985465586501348
  expect u within 1e-7 of 1.9996970454695662
}

test "a controller leaves its limit at once" {
  start nominal
  r = 5
  steps 3
  expect u within 0 of 2.5
  r = 1
  steps 1
  expect u within 1e-7 of 0.9625630424624371
  steps 2
  expect y within 1e-7 of 0.9978665565450371
}

test "manual operation sets the output" {
  start nominal
  steps 1
  hold = 1
  steps 1
  expect u within 0 of 1.5
  expect y within 1e-7 of 1.3609769666554983
  hold = 0
  steps 2
  expect y within 1e-7 of 1.0255250014691397
}

test "manual operation keeps the output" {
  start nominal
  steps 1
  hold = 2
  steps 1
  expect y within 1e-7 of 0.9235995634868944
  hold = 0
  steps 2
  expect u within 1e-7 of 0.999403491985054
}
