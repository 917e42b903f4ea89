# Pipe with dead time: plug flow, so that what leaves entered one volume of the pipe ago. Streams are those of streams.eq.
#
# The residence time theta obeys the balance of the volume between inlet and outlet: the integral of Q over the last theta is V.
# Source: derivative of that integral by time, 0 = Q(t) - (1 - dtheta/dt) Q(t - theta); before the start the flow is that at the start.
# Range: liquid of one density, no dispersion or heat loss, flow that does not turn or stop: theta within its bounds.

use "lib/streams.eq"

component Pipe "dead time of a pipe, as long as its volume takes to pass at the flow so far" {
  param V           : m^3 = 1        in 0..inf    "volume"
  param theta_least : h   = 0.001    in 0..inf    "smallest residence time"
  param theta_most  : h   = 10       in 0..inf    "largest residence time"
  port inlet, outlet : Stream
  state theta : h = 1 in theta_least..theta_most    "residence time of what leaves"
  initial eq theta*inlet.Q = V
  eq d/dt theta  = 1 - inlet.Q/delay(inlet.Q, theta)
  eq outlet.Q    = inlet.Q
  eq outlet.c[i] = delay(inlet.c[i], theta)    for i in species
  eq outlet.T    = delay(inlet.T, theta)
  fail reversal event inlet.Q < 0
  fail residence event theta >= theta_most
}
