# Pipe with dead time: plug flow, so that what leaves entered one volume of the pipe ago. Streams are those of streams.eq.
#
# Source: balance of the volume between inlet and outlet; the integral of the flow over the residence time is the volume.
# Range: liquid of one density, no dispersion or heat loss, a flow above zero. Before the start the flow is that at the start.

use "lib/streams.eq"

component Pipe "dead time of a pipe, as long as its volume takes to pass at the flow so far" {
  param V : m^3 = 1 in 0..inf    "volume"
  port inlet, outlet : Stream
  eq outlet.Q    = inlet.Q
  eq outlet.c[i] = transport(inlet.c[i], inlet.Q, V)    for i in species
  eq outlet.T    = transport(inlet.T, inlet.Q, V)
}
