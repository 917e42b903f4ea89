# Bioreactor with biomass X, substrate S and product P. Streams are those of streams.eq.
#
# The model declares `set species = { X, S, P }` (more may be listed) and `unit amount = 1 [g]`. Batch: both flows zero; fed batch:
# outlet zero; chemostat: `eq B.outlet.Q = B.inlet.Q`.
# Source: J. Nielsen et al., Bioreaction Engineering Principles: Monod kinetics with the inhibition by substrate of Haldane; product
# by R. Luedeking and E. L. Piret, J. Biochem. Microbiol. Technol. Eng. 1 (1959) 393.
# Range: one limiting substrate, constant temperature and oxygen.

use "lib/streams.eq"

component Bioreactor "growth, maintenance, death and product in a mixed vessel" {
  param mu_max : 1/h  = 0.4  in 0..inf    "largest growth rate"
  param K_S    : g/L  = 0.1  in 0..inf    "half-saturation"
  param i_S    : L/g  = 0    in 0..inf    "inhibition by substrate, one over the constant of Haldane"
  param Y_XS   : 1    = 0.5  in 0..inf    "biomass from substrate"
  param m_S    : 1/h  = 0    in 0..inf    "substrate for maintenance per biomass"
  param k_d    : 1/h  = 0    in 0..inf    "death rate"
  param Y_PX   : 1    = 0    in 0..inf    "product that goes with growth, per biomass"
  param beta   : 1/h  = 0    in 0..inf    "product that goes with biomass"
  param Y_PS   : 1    = 1    in 0..inf    "product from substrate"
  param T      : degC = 30   in 0..100    "temperature of the culture"
  port inlet, outlet : Stream
  state V : m^3 = 1 in 0..inf    "volume"
  state c[i in species] : amount/m^3 = 1 in 0..inf scale 1e3    "concentrations"
  let s   : g/L            = max(c[S], 0 [g/L])
  let mu  : 1/h            = mu_max*s/(K_S + s + i_S*sq(s))    "growth rate"
  let fed                  = s/(0.001*K_S + s)    # maintenance and product cease without substrate
  let r_P : amount/(m^3 h) = (Y_PX*mu + fed*beta)*c[X]         "formation of product"
  eq d/dt V = inlet.Q - outlet.Q
  eq d/dt c[i] = inlet.Q*(inlet.c[i] - c[i])/V
                 + (if i == X then (mu - k_d)*c[X] else 0)
                 - (if i == S then mu*c[X]/Y_XS + fed*m_S*c[X] + r_P/Y_PS else 0)
                 + (if i == P then r_P else 0)    for i in species
  eq outlet.c[i] = c[i]    for i in species
  eq outlet.T    = T
}
