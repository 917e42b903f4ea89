# Blocks of batch recipes, which start one another by signals of control.eq.
#
# A block starts when `go` rises above one half, and signals `done` when its `progress` is complete, until it starts again. While it
# runs `on` is 1: `eq jacket.Q = 2 [m^3/h]*heat.on`. Chains are connections, `connect charge.done -> heat.go`; the first block
# has `eq charge.go.y = 1`, or the signal of the last one in a cycle of batches, with `first = true`.
# Source: ISA-88.00.01 and IEC 60848 (GRAFCET): steps, transitions and actions.
# Range: one predecessor for each block; parallel branches start from one signal.

use "lib/control.eq"
use "lib/streams.eq"

component RecipeStep(first = false) "block that the model completes, for example `eq heat.progress = (T - T_0)/(T_end - T_0)`" {
  port go, done : Signal
  var progress : 1 = 0    "done when it reaches 1"
  discrete on       : 1 = if first then 1 else 0  in 0..1    "1 while the block runs"
  discrete finished : 1 = 0                       in 0..1    "1 from its end to its next start"
  event begins when go.y >= 0.5
  event ends when (if on >= 0.5 then progress else 0) >= 1
  at begins { next on = 1; next finished = 0 }
  at ends   { next on = 0; next finished = 1 }
  eq done.y = finished
}

component Hold extends RecipeStep {
  param duration : min = 60 in 0..inf    "time that the block takes"
  state age : min = 0 in 0..inf scale 1    "time since the start"
  at begins { next on = 1; next finished = 0; reset age = 0 }
  eq d/dt age = if on >= 0.5 then 1 else 0
  eq progress = age/duration
}

component Ramp extends Hold {
  param from : 1 = 0    "value at the start"
  param to   : 1 = 1    "value at the end, kept until the next start"
  let value : 1 = if on >= 0.5 then from + (to - from)*progress else if finished >= 0.5 then to else from
}

component Charge extends RecipeStep {
  param volume : m^3   = 1  in 0..inf    "volume to charge"
  param Q      : m^3/h = 1  in 0..inf    "flow while it runs"
  port inlet, outlet : Stream
  state charged : m^3 = 0 in 0..inf scale 1    "volume since the start"
  at begins { next on = 1; next finished = 0; reset charged = 0 }
  eq d/dt charged = outlet.Q
  eq progress     = charged/volume
  eq inlet.Q      = Q*on
  eq outlet.Q     = inlet.Q
  eq outlet.c[i]  = inlet.c[i]    for i in species
  eq outlet.T     = inlet.T
}
