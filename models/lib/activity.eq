# Activity coefficients of binary liquids: Margules, van Laar, Wilson, NRTL, UNIQUAC; mixtures.eq has those of more components.
#
# Source: G. M. Wilson, J. Am. Chem. Soc. 86 (1964) 127; H. Renon and J. M. Prausnitz, AIChE J. 14 (1968) 135; D. S.
# Abrams and J. M. Prausnitz, AIChE J. 21 (1975) 116 (UNIQUAC, coordination number 10); J. M. Smith, H. C. Van Ness and
# M. M. Abbott, Introduction to Chemical Engineering Thermodynamics, chapters on solution thermodynamics.
# Range: that of the parameters. Wilson cannot describe two liquid phases.
#
# Each function is the logarithm of the activity coefficient of the component whose mole fraction is `x`; the first parameter is
# the one of this component with the other. For the other component exchange both: nrtl(1 - x, tau_21, tau_12, alpha).

def margules(x, A_12, A_21) = sq(1 - x)*(A_12 + 2*(A_21 - A_12)*x)
def van_laar(x, A_12, A_21) = A_12*sq(A_21*(1 - x)/(A_12*x + A_21*(1 - x)))

def wilson(x, L_12, L_21) = -ln(x + L_12*(1 - x)) + (1 - x)*(L_12/(x + L_12*(1 - x)) - L_21/(1 - x + L_21*x))
# L_12 from the molar volumes of the liquids and the energy a_12, all in units that fit R*T.
def wilson_parameter(T, V_1, V_2, a_12) = V_2/V_1*exp(-a_12/(8.31446261815324 [J/(mol K)]*T))

def nrtl(x, tau_12, tau_21, alpha) = {
  let G_12 = exp(-alpha*tau_12)
  let G_21 = exp(-alpha*tau_21)
  sq(1 - x)*(tau_21*sq(G_21/(x + (1 - x)*G_21)) + tau_12*G_12/sq(1 - x + x*G_12))
}

# `r` and `q` are volume and surface of the molecules, tau_12 = exp(-(u_12 - u_22)/(R*T)) with the energies u of Abrams and Prausnitz.
def uniquac(x, r_1, r_2, q_1, q_2, tau_12, tau_21) = {
  let R = x*r_1 + (1 - x)*r_2
  let Q = x*q_1 + (1 - x)*q_2
  let S_1 = (x*q_1 + (1 - x)*q_2*tau_21)/Q
  let S_2 = (x*q_1*tau_12 + (1 - x)*q_2)/Q
  let l_1 = 5*(r_1 - q_1) - r_1 + 1
  let l_2 = 5*(r_2 - q_2) - r_2 + 1
  let size = ln(r_1/R) + 5*q_1*ln(q_1*R/(r_1*Q)) + l_1 - r_1/R*(x*l_1 + (1 - x)*l_2)
  size + q_1*(1 - ln(S_1) - (x*q_1/S_1 + (1 - x)*q_2*tau_12/S_2)/Q)
}
