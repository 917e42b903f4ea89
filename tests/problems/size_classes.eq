model SizeClasses "fractions of crystals below limits of size, whose sizes are normally distributed around a mean"

time t : s

set class = 1..3

param spread = 0.5 in 0.1..2    "standard deviation of sizes"

action growth = 0.6 in 0..2

state size         = 2  in 0..10    "mean size"
state below[class] = 0  in 0..1     "measured fractions, which follow those of the crystals"

def share(limit) = (1 + erf((limit - size)/(sqrt(2)*spread)))/2

eq d/dt size     = (growth - 0.3*size)/1 [s]
eq d/dt below[k] = (share(0.7*k) - below[k])/2 [s]    for k in class

observe size, below
episode { step = 0.5 [s], max_steps = 20 }
