# Mixed crystallisers by the moments of the size distribution, or by the distribution itself. Streams are those of streams.eq and carry the solution without crystals.
#
# The model declares a species `solute`, `unit amount = 1 [kg]`, and sets the solubility `c_sat` at the temperature. Batch: both
# flows zero; continuous (MSMPR): `eq C.outlet.Q = C.inlet.Q`, crystals leave with the outlet.
# Source: A. D. Randolph and M. A. Larson, Theory of Particulate Processes, 2nd edition (1988): size-independent growth, nuclei of size
# zero, power laws of the supersaturation.
# Range: constant volume of the slurry, thin slurries (crystals take no volume of the solution), no agglomeration or breakage; no
# dissolution below saturation. Crystals that grow beyond L_max leave the distribution.

use "lib/streams.eq"

component CrystalliserVessel "nucleation and growth from solution; the components below define `surface`" {
  param V     : m^3       = 1     in 0..inf      "volume of the slurry"
  param rho_c : kg/m^3    = 2000  in 0..inf      "density of the crystals"
  param k_v   : 1         = 0.5   in 0..inf      "shape factor of the volume"
  param k_g   : m/s       = 1e-7  in 0..inf      "growth rate at a relative supersaturation of one"
  param g     : 1         = 1.5   in 1..inf      "its exponent"
  param k_b   : 1/(m^3 s) = 1e8   in 0..inf      "nucleation rate at a relative supersaturation of one"
  param b     : 1         = 2     in 1..inf      "its exponent"
  param T     : degC      = 25    in -50..500    "temperature of the outlet"
  port inlet, outlet : Stream
  var c_sat   : kg/m^3  = 100  in 0..inf    "solubility"
  var surface : m^2/m^3 = 0    in 0..inf    "second moment of the sizes"
  state c[i in species] : amount/m^3 = 100 in 0..inf scale 100    "concentrations of the solution"
  let D     : 1/h       = inlet.Q/V                      "dilution rate"
  let sigma : 1         = max(c[solute]/c_sat - 1, 0)    "relative supersaturation"
  let G     : m/s       = k_g*sigma^g                    "growth rate"
  let B     : 1/(m^3 s) = k_b*sigma^b                    "nucleation rate"
  eq d/dt c[i]   = D*(inlet.c[i] - c[i]) - (if i == solute then 3*rho_c*k_v*G*surface else 0)    for i in species
  eq outlet.c[i] = c[i]    for i in species
  eq outlet.T    = T
}

component Crystalliser extends CrystalliserVessel {
  state m_0 : 1/m^3   = 0  in 0..inf  scale 1e9     "number of crystals by volume"
  state m_1 : m/m^3   = 0  in 0..inf  scale 1e5     "first moment: length of the crystals"
  state m_2 : m^2/m^3 = 0  in 0..inf  scale 10      "second moment"
  state m_3 : m^3/m^3 = 0  in 0..inf  scale 1e-3    "third moment"
  let mean_size : um     = m_1/max(m_0, 1 [1/m^3])    "mean size by number"
  let yield     : kg/m^3 = rho_c*k_v*m_3              "mass of crystals by volume"
  eq surface  = m_2
  eq d/dt m_0 = B - D*m_0
  eq d/dt m_1 = G*m_0 - D*m_1
  eq d/dt m_2 = 2*G*m_1 - D*m_2
  eq d/dt m_3 = 3*G*m_2 - D*m_3
}

# Moments are sums over the cells with the size of their centres; `cells` cells of equal width.
component PopulationCrystalliser(cells = 100) extends CrystalliserVessel {
  param L_max : um = 1000 in 0..inf    "largest size"
  domain L in 0..L_max cells cells scheme limited
  state N[L] : 1/(m^3 um) = 0 in 0..inf scale 1e6    "crystals by size and volume"
  flux  J[L] = G*N[L], low = B
  let m_0       : 1/m^3   = integral(N[L] for L)        "number of crystals by volume"
  let m_1       : m/m^3   = integral(N[L]*L for L)      "first moment: length of the crystals"
  let m_2       : m^2/m^3 = integral(N[L]*L^2 for L)    "second moment"
  let m_3       : m^3/m^3 = integral(N[L]*L^3 for L)    "third moment"
  let mean_size : um      = m_1/max(m_0, 1 [1/m^3])     "mean size by number"
  let yield     : kg/m^3  = rho_c*k_v*m_3               "mass of crystals by volume"
  eq surface   = m_2
  eq d/dt N[L] = -div(J[L]) - D*N[L]    for L
}
