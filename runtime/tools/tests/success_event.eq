# A success inside of a step.
time t : s
state h : m = 0 in 0..10
action q : m/s = 0.3 in 0..1
eq d/dt h = q
observe h
reward r default = if success then 100 else -1
fail over event h >= 3 [m]
success full event h >= 1 [m] "full"
episode { step = 1 [s], max_steps = 20, error_reward = -1000 }
test "full inside of a step" { start nominal; steps 10; expect success full; expect h within 1e-9 of 1; expect t within 1e-9 of 3.3333333333333333 [s] }
