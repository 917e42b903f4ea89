# Cubic equations of state for one substance: Soave-Redlich-Kwong (SRK) and Peng-Robinson (PR).
#
# Source: G. Soave, Chem. Eng. Sci. 27 (1972) 1197; D.-Y. Peng and D. B. Robinson, Ind. Eng. Chem. Fundam. 15 (1976) 59. Critical
# constants are those of substances.eq.
# Range: nonpolar and weakly polar substances; densities of liquids deviate by some 5 % (PR) to 15 % (SRK), vapour pressures by
# some 1 % for a reduced temperature above 0.6.

use "lib/substances.eq"

param R_cubic : J/(mol K) = 8.31446261815324    "gas constant"

# Attraction `a` and covolume `b` from critical temperature, critical pressure and acentric factor.
def cubic_alpha(T, T_c, m) = sq(1 + m*(1 - sqrt(T/T_c)))
def pr_m(omega) = 0.37464 + 1.54226*omega - 0.26992*omega^2
def pr_a(T, T_c, p_c, omega) = 0.457235528921382*sq(R_cubic*T_c)/p_c*cubic_alpha(T, T_c, pr_m(omega))
def pr_b(T_c, p_c) = 0.0777960739038885*R_cubic*T_c/p_c
def srk_m(omega) = 0.48 + 1.574*omega - 0.176*omega^2
def srk_a(T, T_c, p_c, omega) = 0.427480233540341*sq(R_cubic*T_c)/p_c*cubic_alpha(T, T_c, srk_m(omega))
def srk_b(T_c, p_c) = 0.0866403499649577*R_cubic*T_c/p_c

# Pressure at a molar volume.
def pr_pressure(T, v, a, b) = R_cubic*T/(v - b) - a/(v^2 + 2*b*v - b^2)
def srk_pressure(T, v, a, b) = R_cubic*T/(v - b) - a/(v*(v + b))

# The polynomial whose roots are the compressibility factors, and the logarithm of the fugacity coefficient;
# A = a*p/(R*T)^2, B = b*p/(R*T).
def pr_polynomial(Z, A, B) = Z^3 - (1 - B)*Z^2 + (A - 3*B^2 - 2*B)*Z - (A*B - B^2 - B^3)
def pr_ln_phi(Z, A, B) = Z - 1 - ln(Z - B) - A/(2*sqrt(2)*B)*ln((Z + (1 + sqrt(2))*B)/(Z + (1 - sqrt(2))*B))
def pr_volume_polynomial(u, q, B) = B*u^3 - (1 - B)*u^2 + (q - 3*B - 2)*u - (q - 1 - B)    # u = v/b, q = A/B
def srk_polynomial(Z, A, B) = Z^3 - Z^2 + (A - B - B^2)*Z - A*B
def srk_volume_polynomial(u, q, B) = B*u^3 - u^2 + (q - 1 - B)*u - q
def srk_ln_phi(Z, A, B) = Z - 1 - ln(Z - B) - A/B*ln(1 + B/Z)

# The phase is that of the root, which guess and bounds of the variable choose: a liquid has less than the critical volume, 3.951*b (SRK
# 3.847*b), a vapour more than the least volume of a saturated vapour near the critical point. The start fails if the phase has no root.
component PengRobinsonVapour "compressibility, molar volume and fugacity of the vapour" {
  param T_c   : K      "critical temperature"
  param p_c   : bar    "critical pressure"
  param omega : 1      "acentric factor"
  var T : K   = 300
  var p : bar = 1
  var Z : 1   = 1  in 0.25..2    "compressibility factor"
  let A    = pr_a(T, T_c, p_c, omega)*p/sq(R_cubic*T)
  let B    = pr_b(T_c, p_c)*p/(R_cubic*T)
  let zero = pr_polynomial(Z, A, B)
  eq zero = 0
  let v      : m^3/mol = Z*R_cubic*T/p         "molar volume"
  let ln_phi : 1       = pr_ln_phi(Z, A, B)    "logarithm of the fugacity coefficient"
}

component PengRobinsonLiquid "compressibility, molar volume and fugacity of the liquid" {
  param T_c   : K      "critical temperature"
  param p_c   : bar    "critical pressure"
  param omega : 1      "acentric factor"
  var T : K   = 300
  var p : bar = 1
  var u : 1   = 1.2  in 1..3.951    "molar volume over covolume"
  let A    = pr_a(T, T_c, p_c, omega)*p/sq(R_cubic*T)
  let B    = pr_b(T_c, p_c)*p/(R_cubic*T)
  let Z    = u*B
  let zero = pr_volume_polynomial(u, A/B, B)
  eq zero = 0
  let v      : m^3/mol = Z*R_cubic*T/p         "molar volume"
  let ln_phi : 1       = pr_ln_phi(Z, A, B)    "logarithm of the fugacity coefficient"
}

component SoaveVapour extends PengRobinsonVapour {
  let A          = srk_a(T, T_c, p_c, omega)*p/sq(R_cubic*T)
  let B          = srk_b(T_c, p_c)*p/(R_cubic*T)
  let zero       = srk_polynomial(Z, A, B)
  let ln_phi : 1 = srk_ln_phi(Z, A, B)    "logarithm of the fugacity coefficient"
}

component SoaveLiquid extends PengRobinsonLiquid {
  var u : 1 = 1.4 in 1..3.847    "molar volume over covolume"
  let A          = srk_a(T, T_c, p_c, omega)*p/sq(R_cubic*T)
  let B          = srk_b(T_c, p_c)*p/(R_cubic*T)
  let zero       = srk_volume_polynomial(u, A/B, B)
  let ln_phi : 1 = srk_ln_phi(Z, A, B)    "logarithm of the fugacity coefficient"
}
