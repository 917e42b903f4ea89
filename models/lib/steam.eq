# Water and steam: IAPWS Industrial Formulation 1997, regions 1 (liquid), 2 (vapour) and 4 (saturation).
#
# Source: IAPWS R7-97(2012), equations 7, 15 to 17, 30 and 31, tables 2, 10, 11 and 34.
# Range: region 1 from 273.15 K to 623.15 K and from saturation to 100 MPa; region 2 from 273.15 K below saturation
# and the boundary to region 3, and to 1073.15 K below 100 MPa; saturation from 273.15 K to 647.096 K. Region 3 (around the
# critical point) and region 5 are missing. Outside of the range the equations extrapolate without a warning.
#
# `p` is absolute, `T` in K: write `kelvin(T)` for a temperature in degC. Volume v, enthalpy h and entropy s are per mass;
# internal energy and entropy of the liquid are zero at the triple point.

param if97_R : kJ/(kg K) = 0.461526    "specific gas constant of water"

# ---- Region 1: liquid ----

table over if97_terms_1 {
  columns: if97_I1 [1], if97_J1 [1], if97_n1 [1]
  1:  0,    -2,    0.14632971213167
  2:  0,    -1,    -0.84548187169114
  3:  0,    0,     -3.756360367204
  4:  0,    1,     3.3855169168385
  5:  0,    2,     -0.95791963387872
  6:  0,    3,     0.15772038513228
  7:  0,    4,     -0.016616417199501
  8:  0,    5,     8.1214629983568e-4
  9:  1,    -9,    2.8319080123804e-4
  10: 1,    -7,    -6.0706301565874e-4
  11: 1,    -1,    -0.018990068218419
  12: 1,    0,     -0.032529748770505
  13: 1,    1,     -0.021841717175414
  14: 1,    3,     -5.283835796993e-5
  15: 2,    -3,    -4.7184321073267e-4
  16: 2,    0,     -3.0001780793026e-4
  17: 2,    1,     4.7661393906987e-5
  18: 2,    3,     -4.4141845330846e-6
  19: 2,    17.0,  -7.2694996297594e-16
  20: 3,    -4,    -3.1679644845054e-5
  21: 3,    0,     -2.8270797985312e-6
  22: 3,    6,     -8.5205128120103e-10
  23: 4,    -5,    -2.2425281908e-6
  24: 4,    -2,    -6.5171222895601e-7
  25: 4,    1e1,   -1.4341729937924e-13
  26: 5,    -8,    -4.0516996860117e-7
  27: 8,    -11.0, -1.2734301741641e-9
  28: 8,    -6,    -1.7424871230634e-10
  29: 21.0, -29.0, -6.8762131295531e-19
  30: 23.0, -31.0, 1.4478307828521e-20
  31: 29.0, -38.0, 2.6335781662795e-23
  32: 3e1,  -39.0, -1.1947622640071e-23
  33: 31.0, -4e1,  1.8228094581404e-24
  34: 32.0, -41.0, -9.3537087292458e-26
}

def if97_pi1(p) = 7.1 - (p/(16.53 [MPa])) as [1]
def if97_tau1(T) = (1386 [K]/T) as [1]
def if97_gamma1(pi, tau) = sum(if97_n1[k]*pi^if97_I1[k]*(tau - 1.222)^if97_J1[k] for k in if97_terms_1)
def if97_gamma1_pi(pi, tau) = -sum(if97_n1[k]*if97_I1[k]*pi^(if97_I1[k] - 1)*(tau - 1.222)^if97_J1[k] for k in if97_terms_1)
def if97_gamma1_tau(pi, tau) = sum(if97_n1[k]*if97_J1[k]*pi^if97_I1[k]*(tau - 1.222)^(if97_J1[k] - 1) for k in if97_terms_1)

def water_v(p, T) = if97_R*T/(16.53 [MPa])*if97_gamma1_pi(if97_pi1(p), if97_tau1(T))
def water_h(p, T) = if97_R*(1386 [K])*if97_gamma1_tau(if97_pi1(p), if97_tau1(T))
def water_s(p, T) = {
  let pi_1 = if97_pi1(p)
  let tau = if97_tau1(T)
  if97_R*(tau*if97_gamma1_tau(pi_1, tau) - if97_gamma1(pi_1, tau))
}

# ---- Region 2: vapour, an ideal gas and a residual part ----

table over if97_terms_0 {
  columns: if97_J0 [1], if97_n0 [1]
  1: 0,  -9.6927686500217
  2: 1,  10.086655968018
  3: -5, -0.005608791128302
  4: -4, 0.071452738081455
  5: -3, -0.40710498223928
  6: -2, 1.4240819171444
  7: -1, -4.383951131945
  8: 2,  -0.28408632460772
  9: 3,  0.021268463753307
}

table over if97_terms_2 {
  columns: if97_I2 [1], if97_J2 [1], if97_n2 [1]
  1:  1,    0,    -0.0017731742473213
  2:  1,    1,    -0.017834862292358
  3:  1,    2,    -0.045996013696365
  4:  1,    3,    -0.057581259083432
  5:  1,    6,    -0.05032527872793
  6:  2,    1,    -3.3032641670203e-5
  7:  2,    2,    -1.8948987516315e-4
  8:  2,    4,    -0.0039392777243355
  9:  2,    7,    -0.043797295650573
  10: 2,    36.0, -2.6674547914087e-5
  11: 3,    0,    2.0481737692309e-8
  12: 3,    1,    4.3870667284435e-7
  13: 3,    3,    -3.227767723857e-5
  14: 3,    6,    -0.0015033924542148
  15: 3,    35.0, -0.040668253562649
  16: 4,    1,    -7.8847309559367e-10
  17: 4,    2,    1.2790717852285e-8
  18: 4,    3,    4.8225372718507e-7
  19: 5,    7,    2.2922076337661e-6
  20: 6,    3,    -1.6714766451061e-11
  21: 6,    16.0, -0.0021171472321355
  22: 6,    35.0, -23.895741934104
  23: 7,    0,    -5.905956432427e-18
  24: 7,    11.0, -1.2621808899101e-6
  25: 7,    25.0, -0.038946842435739
  26: 8,    8,    1.1256211360459e-11
  27: 8,    36.0, -8.2311340897998
  28: 9,    13.0, 1.9809712802088e-8
  29: 1e1,  4,    1.0406965210174e-19
  30: 1e1,  1e1,  -1.0234747095929e-13
  31: 1e1,  14.0, -1.0018179379511e-9
  32: 16.0, 29.0, -8.0882908646985e-11
  33: 16.0, 5e1,  0.10693031879409
  34: 18.0, 57.0, -0.33662250574171
  35: 2e1,  2e1,  8.9185845355421e-25
  36: 2e1,  35.0, 3.0629316876232e-13
  37: 2e1,  48.0, -4.2002467698208e-6
  38: 21.0, 21.0, -5.9056029685639e-26
  39: 22.0, 53.0, 3.7826947613457e-6
  40: 23.0, 39.0, -1.2768608934681e-15
  41: 24.0, 26.0, 7.3087610595061e-29
  42: 24.0, 4e1,  5.5414715350778e-17
  43: 24.0, 58.0, -9.436970724121e-7
}

def if97_pi2(p) = (p/(1 [MPa])) as [1]
def if97_tau2(T) = (540 [K]/T) as [1]
def if97_ideal(pi, tau) = ln(pi) + sum(if97_n0[k]*tau^if97_J0[k] for k in if97_terms_0)
def if97_ideal_tau(tau) = sum(if97_n0[k]*if97_J0[k]*tau^(if97_J0[k] - 1) for k in if97_terms_0)
def if97_residual(pi, tau) = sum(if97_n2[k]*pi^if97_I2[k]*(tau - 0.5)^if97_J2[k] for k in if97_terms_2)
def if97_residual_pi(pi, tau) = sum(if97_n2[k]*if97_I2[k]*pi^(if97_I2[k] - 1)*(tau - 0.5)^if97_J2[k] for k in if97_terms_2)
def if97_residual_tau(pi, tau) = sum(if97_n2[k]*if97_J2[k]*pi^if97_I2[k]*(tau - 0.5)^(if97_J2[k] - 1) for k in if97_terms_2)
def if97_gamma2_tau(pi, tau) = if97_ideal_tau(tau) + if97_residual_tau(pi, tau)

def steam_v(p, T) = if97_R*T/p*(1 + if97_pi2(p)*if97_residual_pi(if97_pi2(p), if97_tau2(T)))
def steam_h(p, T) = if97_R*(540 [K])*if97_gamma2_tau(if97_pi2(p), if97_tau2(T))
def steam_s(p, T) = {
  let pi_2 = if97_pi2(p)
  let tau = if97_tau2(T)
  if97_R*(tau*if97_gamma2_tau(pi_2, tau) - if97_ideal(pi_2, tau) - if97_residual(pi_2, tau))
}

# ---- Region 4: saturation ----

def water_psat(T) = {
  let k = (T/(1 [K])) as [1]
  let theta = k - 0.23855557567849/(k - 650.17534844798)
  let A = sq(theta) + 1167.0521452767*theta - 724213.16703206
  let B = -17.073846940092*sq(theta) + 12020.82470247*theta - 3232555.0322333
  let C = 14.91510861353*sq(theta) - 4823.2657361591*theta + 405113.40542057
  ((2*C/(-B + sqrt(sq(B) - 4*A*C)))^4) as [MPa]
}

def water_Tsat(p) = {
  let beta = if97_pi2(p)^0.25
  let E = sq(beta) - 17.073846940092*beta + 14.91510861353
  let F = 1167.0521452767*sq(beta) + 12020.82470247*beta - 4823.2657361591
  let G = -724213.16703206*sq(beta) - 3232555.0322333*beta + 405113.40542057
  let D = 2*G/(-F - sqrt(sq(F) - 4*E*G))
  let s = 650.17534844798 + D
  ((s - sqrt(sq(s) - 4*(-0.23855557567849 + 650.17534844798*D)))/2) as [K]
}
