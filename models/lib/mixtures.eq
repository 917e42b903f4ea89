# Activity coefficients of liquids of any number of components: Wilson, NRTL, UNIQUAC. The model declares `set species`.
#
# Source: G. M. Wilson, J. Am. Chem. Soc. 86 (1964) 127; H. Renon and J. M. Prausnitz, AIChE J. 14 (1968) 135; D. S. Abrams and
# J. M. Prausnitz, AIChE J. 21 (1975) 116 (coordination number 10).
# Range: that of the parameters. Wilson cannot describe two liquid phases.
#
# Each function is the logarithm of the activity coefficient of species `i` in a liquid of mole fractions `x`. The parameters are
# matrices with the indices of the authors; their diagonals are 1 (`L`, `tau` of UNIQUAC) or 0 (`tau` of NRTL). `r` and `q` are volumes and surfaces of the molecules.

def mixture_wilson(i in species, x[species], L[species, species]) = {
  let other = sum(x[j]*L[j, i]/sum(x[k]*L[j, k] for k in species) for j in species)
  1 - ln(sum(x[j]*L[i, j] for j in species)) - other
}

def mixture_nrtl(i in species, x[species], tau[species, species], alpha[species, species]) = {
  let own = sum(x[j]*tau[j, i]*exp(-alpha[j, i]*tau[j, i]) for j in species)/sum(x[j]*exp(-alpha[j, i]*tau[j, i]) for j in species)
  own + sum(x[j]*exp(-alpha[i, j]*tau[i, j])/sum(x[k]*exp(-alpha[k, j]*tau[k, j]) for k in species)
            * (tau[i, j] - sum(x[k]*tau[k, j]*exp(-alpha[k, j]*tau[k, j]) for k in species)
               / sum(x[k]*exp(-alpha[k, j]*tau[k, j]) for k in species)) for j in species)
}

def mixture_uniquac(i in species, x[species], r[species], q[species], tau[species, species]) = {
  let R = sum(x[j]*r[j] for j in species)
  let Q = sum(x[j]*q[j] for j in species)
  let l_i = 5*(r[i] - q[i]) - r[i] + 1
  let l = sum(x[j]*(5*(r[j] - q[j]) - r[j] + 1) for j in species)
  let own = sum(x[j]*q[j]*tau[j, i] for j in species)/Q
  let other = sum(x[j]*q[j]*tau[i, j]/sum(x[k]*q[k]*tau[k, j] for k in species) for j in species)
  ln(r[i]/R) + 5*q[i]*ln(q[i]*R/(r[i]*Q)) + l_i - r[i]/R*l + q[i]*(1 - ln(own) - other)
}
