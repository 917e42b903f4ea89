# Flash drums with vapour pressures by Wagner, and activity coefficients by a property package.
#
# The model declares `set species` of members of `pure_substances`. The package `IdealLiquid` is Raoult's law; another one defines
# `ln_gamma`, `component Liquid { def ln_gamma(i in species, x[species], T) = mixture_nrtl(i, x, tau, alpha) }`, and is chosen
# by `use FlashDrum as drum(properties = Liquid)`.
# Source: J. M. Smith, H. C. Van Ness and M. M. Abbott, Introduction to Chemical Engineering Thermodynamics: modified Raoult's law.
# Range: low pressure (ideal vapour), temperatures between `wagner_low` and `critical_T` of all species; one liquid phase.
# The events `valid[i].left` report another temperature (validity.eq).

use "lib/flash.eq"
use "lib/substances.eq"
use "lib/validity.eq"

component IdealLiquid {
  def ln_gamma(i in species, x[species], T) = 0*x[i]
}

component FlashDrum(properties = IdealLiquid) extends Flash {
  param p : bar = 1 in 0..inf    "pressure"
  var T : degC = 80 in -50..500    "temperature, set by the model"
  use ValidRange as valid[i in species]
  eq valid[i].place = place_in(kelvin(T), wagner_low[i], critical_T[i])               for i in species
  eq K[i]           = exp(ln_gamma(i, liquid.x, kelvin(T)))*wagner(i, kelvin(T))/p    for i in species
}
