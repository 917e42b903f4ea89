# Correlations of DIPPR (Design Institute for Physical Properties), and coefficients of vapour pressures and heats of vaporisation.
#
# Source: R. H. Perry and D. W. Green, Perry's Chemical Engineers' Handbook, 8th edition (2008), tables 2-8 and 2-150.
# Accuracy: vapour pressures 1 %, sulfur_dioxide 3 % above its boiling point; heats of vaporisation 2.5 %.
# Range: `dippr_low` to `dippr_high`, the critical temperature. Below it the equations extrapolate without a warning (validity.eq).
#
# T is in K; a form returns the number in the unit of its coefficients: `dippr_101(T, 73.649, -7258.2, -7.3037, 4.1653e-6, 2) as [Pa]`.

def dippr_100(T, A, B, C, D, E) = A + value(T, K)*(B + value(T, K)*(C + value(T, K)*(D + value(T, K)*E)))
def dippr_101(T, A, B, C, D, E) = exp(A + B/value(T, K) + C*ln(value(T, K)) + D*value(T, K)^E)
def dippr_102(T, A, B, C, D) = A*value(T, K)^B/(1 + C/value(T, K) + D/sq(value(T, K)))
def dippr_105(T, A, B, C, D) = A/B^(1 + (1 - value(T, K)/C)^D)
def dippr_106(T, T_c, A, B, C, D, E) = A*(1 - T/T_c)^(B + T/T_c*(C + T/T_c*(D + T/T_c*E)))
def dippr_107(T, A, B, C, D, E) = A + B*sq(C/value(T, K)/sinh(C/value(T, K))) + D*sq(E/value(T, K)/cosh(E/value(T, K)))

table over dippr_substances {
  columns: dippr_A [1], dippr_B [1], dippr_C [1], dippr_D [1], dippr_E [1], dippr_low [K], dippr_high [K], vaporisation_A [1], vaporisation_B [1], vaporisation_C [1], vaporisation_D [1]
  ammonia:           90.483, -4669.7, -11.607, 0.017194,  1, 195.41, 405.65,  31523, 0.3914,  -0.2289,  0.2309
  sulfur_dioxide:    47.365, -4084.5, -3.6469, 1.799e-17, 6, 197.67, 430.75,  36760, 0.4,     0,        0
  hydrogen_chloride: 104.27, -3731.2, -15.047, 0.03134,   1, 158.97, 324.65,  22093, 0.3466,  0,        0
  chlorine:          71.334, -3855,   -8.5171, 0.012378,  1, 172.12, 417.15,  30680, 0.8458,  -0.9001,  0.453
  hydrogen_sulfide:  85.584, -3839.9, -11.199, 0.018848,  1, 187.68, 373.53,  25676, 0.37358, 0,        0
  water:             73.649, -7258.2, -7.3037, 4.1653e-6, 2, 273.16, 647.096, 52053, 0.3199,  -0.212,   0.25795
  methanol:          82.718, -6904.5, -8.8622, 7.4664e-6, 2, 175.47, 512.5,   50451, 0.33594, 0,        0
  ethanol:           73.304, -7122.3, -7.1424, 2.8853e-6, 2, 159.05, 514,     55789, 0.31245, 0,        0
  acetone:           69.006, -5599.6, -7.0985, 6.2237e-6, 2, 178.45, 508.2,   42150, 0.3397,  0,        0
  benzene:           83.107, -6486.2, -9.2194, 6.9844e-6, 2, 278.68, 562.05,  45346, 0.39053, 0,        0
  toluene:           76.945, -6729.8, -8.179,  5.3017e-6, 2, 178.18, 591.75,  49507, 0.37742, 0,        0
  propane:           59.078, -3492.6, -6.0669, 1.0919e-5, 2, 85.47,  369.83,  29209, 0.78237, -0.77319, 0.39246
}

# Vapour pressure, and molar heat of vaporisation.
def dippr_pressure(i in dippr_substances, T) = dippr_101(T, dippr_A[i], dippr_B[i], dippr_C[i], dippr_D[i], dippr_E[i]) as [Pa]
def dippr_vaporisation(i in dippr_substances, T) = dippr_106(T, dippr_high[i], vaporisation_A[i], vaporisation_B[i], vaporisation_C[i], vaporisation_D[i], 0) as [J/mol]
