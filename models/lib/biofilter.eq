# Biofilter: a stream passes a bed of carriers, whose biofilm takes up a substrate. Streams are those of streams.eq.
#
# The model declares a species `S`; all others pass unchanged. The stream may be water (`m = 1`) or a gas with the partition coefficient `m`.
# Source: S. P. P. Ottengraf and A. H. C. van den Oever, Biotechnol. Bioeng. 25 (1983) 3089; Monod kinetics in the film.
# Range: constant thickness and density of the film, plug flow by mixed cells, one temperature, no transfer resistance of the stream.

use "lib/streams.eq"

component Biofilter(cells = 10, layers = 5) "bed of `cells` mixed cells, with a film of `layers` layers in each" {
  param V     : m^3     = 1     in 0..inf    "volume of the bed"
  param eps   : 1       = 0.5   in 0..1      "share of the stream in the bed"
  param area  : m^2/m^3 = 200   in 0..inf    "surface of the film by volume of the bed"
  param depth : um      = 200   in 0..inf    "thickness of the film"
  param D     : m^2/s   = 1e-9  in 0..inf    "diffusion in the film"
  param m     : 1       = 1     in 0..inf    "concentration of the stream over that in the film, in equilibrium"
  param X     : g/L     = 30    in 0..inf    "biomass in the film"
  param q_max : 1/h     = 0.2   in 0..inf    "largest uptake by biomass"
  param K_S   : g/L     = 0.01  in 0..inf    "half-saturation"
  port inlet, outlet : Stream
  domain z in 0..1 cells cells scheme upwind          "share of the length"
  domain y in 0..depth cells layers scheme central    "depth in the film"
  state c[i in species, z] : amount/m^3 = 0  in 0..inf  scale 1    "concentrations of the stream"
  state s[z, y]            : amount/m^3 = 0  in 0..inf  scale 1    "substrate in the film"
  let rate      : 1/h = inlet.Q/(eps*V)    # one over the residence time
  let supply[z]       = D*(c[S, z]/m - s[z, y.first])/(depth/(2*layers))    # into the film
  flux J[i in species, z] = rate*c[i, z], low = rate*inlet.c[i]
  flux N[z, y] = -D*grad(s[z, y]), low = supply[z], high = 0
  eq d/dt c[i, z] = -div(J[i, z]) - (if i == S then area/eps*supply[z] else 0)    for i in species, z
  eq d/dt s[z, y] = -div(N[z, y]) - q_max*X*s[z, y]/(K_S + s[z, y])               for z, y
  eq outlet.Q     = inlet.Q
  eq outlet.c[i]  = c[i, z.last]                                                  for i in species
  eq outlet.T     = inlet.T
}
