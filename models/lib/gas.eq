# Ideal gases: heat capacity, enthalpy and entropy by the equations of Shomate.
#
# Source: NIST Chemistry WebBook, SRD 69, fitted to M. W. Chase, NIST-JANAF Thermochemical Tables, 4th edition (1998).
# Range: `shomate_low` to `shomate_high`; rows `_hot` continue the row of the same gas. Outside of it the equations extrapolate
# without a warning. Enthalpies count from the elements at 298.15 K and 1 bar, so that the enthalpy of formation is included.

param R_gas : J/(mol K) = 8.31446261815324    "gas constant"

table over shomate_gases {
  columns: shomate_A [1], shomate_B [1], shomate_C [1], shomate_D [1], shomate_E [1], shomate_F [1], shomate_G [1], shomate_low [K], shomate_high [K]
  N2:     28.98641,  1.853978,   -9.647459, 16.63537,  0.000117,  -8.671914, 226.4168,   100, 500
  N2_hot: 19.50583,  19.88705,   -8.598535, 1.369784,  0.527601,  -4.935202, 212.39,     500, 2000
  O2:     31.32234,  -20.23531,  57.86644,  -36.50624, -0.007374, -8.903471, 246.7945,   100, 700
  O2_hot: 30.03235,  8.772972,   -3.988133, 0.788313,  -0.741599, -11.32468, 236.1663,   700, 2000
  CO2:    24.99735,  55.18696,   -33.69137, 7.948387,  -0.136638, -403.6075, 228.2431,   298, 1200
  H2O:    30.092,    6.832514,   6.793435,  -2.53448,  0.082139,  -250.881,  223.3967,   500, 1700
  CH4:    -0.703029, 108.4773,   -42.52157, 5.862788,  0.678565,  -76.84376, 158.7163,   298, 1300
  H2:     33.066178, -11.363417, 11.432816, -2.772874, -0.158558, -9.980797, 172.707974, 298, 1000
  CO:     25.56759,  6.09613,    4.054656,  -2.671301, 0.131021,  -118.0089, 227.3665,   298, 1300
}

# Heat capacity, enthalpy and entropy at 1 bar: `shomate_enthalpy(CO2, kelvin(T))`.
def shomate_heat_capacity(i in shomate_gases, T) = {
  let t = (T/(1000 [K])) as [1]
  (shomate_A[i] + shomate_B[i]*t + shomate_C[i]*t^2 + shomate_D[i]*t^3 + shomate_E[i]/t^2) as [J/(mol K)]
}
def shomate_enthalpy(i in shomate_gases, T) = {
  let t = (T/(1000 [K])) as [1]
  (shomate_A[i]*t + shomate_B[i]*t^2/2 + shomate_C[i]*t^3/3 + shomate_D[i]*t^4/4 - shomate_E[i]/t + shomate_F[i]) as [kJ/mol]
}
def shomate_entropy(i in shomate_gases, T) = {
  let t = (T/(1000 [K])) as [1]
  (shomate_A[i]*ln(t) + shomate_B[i]*t + shomate_C[i]*t^2/2 + shomate_D[i]*t^3/3 - shomate_E[i]/(2*t^2) + shomate_G[i]) as [J/(mol K)]
}

def ideal_gas_pressure(n, T, V) = n*R_gas*T/V
def ideal_gas_concentration(p, T) = p/(R_gas*T)
