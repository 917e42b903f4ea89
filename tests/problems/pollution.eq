model Pollution "Chemistry of air pollution: 20 species, 25 reactions"

# J. G. Verwer, SIAM Journal on Scientific Computing 15 (1994) 1243-1250. Reference values at t = 60: Test Set for Initial Value Problem
# Solvers, release 2.4, problem POLLU.

time t : min

set species = 1..20
set reactions = 1..25

table start[species] default 0 { 2: 0.2, 4: 0.04, 7: 0.1, 8: 0.3, 9: 0.01, 17: 0.007 }
table k[reactions] : 1/min = {
  1: 0.35, 2: 26.6, 3: 12300, 4: 8.6e-4, 5: 8.2e-4, 6: 15000, 7: 1.3e-4, 8: 24000, 9: 16500
  10: 9000, 11: 0.022, 12: 12000, 13: 1.88, 14: 16300, 15: 4.8e6, 16: 3.5e-4, 17: 0.0175, 18: 1e8
  19: 4.44e11, 20: 1240, 21: 2.1, 22: 5.78, 23: 0.0474, 24: 1780, 25: 3.12
}
table order[reactions, species] default 0 "exponents of the rate laws" {
  1: 1 = 1
  2: 2 = 1, 4 = 1
  3: 5 = 1, 2 = 1
  4: 7 = 1
  5: 7 = 1
  6: 7 = 1, 6 = 1
  7: 9 = 1
  8: 9 = 1, 6 = 1
  9: 11 = 1, 2 = 1
  10: 11 = 1, 1 = 1
  11: 13 = 1
  12: 10 = 1, 2 = 1
  13: 14 = 1
  14: 1 = 1, 6 = 1
  15: 3 = 1
  16: 4 = 1
  17: 4 = 1
  18: 16 = 1
  19: 16 = 1
  20: 17 = 1, 6 = 1
  21: 19 = 1
  22: 19 = 1
  23: 1 = 1, 4 = 1
  24: 19 = 1, 1 = 1
  25: 20 = 1
}
table nu[reactions, species] default 0 "stoichiometric coefficients" {
  1: 1 = -1, 2 = 1, 3 = 1
  2: 1 = 1, 2 = -1, 4 = -1
  3: 1 = 1, 2 = -1, 5 = -1, 6 = 1
  4: 5 = 2, 7 = -1, 8 = 1
  5: 7 = -1, 8 = 1
  6: 5 = 1, 6 = -1, 7 = -1, 8 = 1
  7: 5 = 1, 8 = 1, 9 = -1, 10 = 1
  8: 6 = -1, 9 = -1, 11 = 1
  9: 1 = 1, 2 = -1, 10 = 1, 11 = -1, 12 = 1
  10: 1 = -1, 11 = -1, 13 = 1
  11: 1 = 1, 11 = 1, 13 = -1
  12: 1 = 1, 2 = -1, 10 = -1, 14 = 1
  13: 5 = 1, 7 = 1, 14 = -1
  14: 1 = -1, 6 = -1, 15 = 1
  15: 3 = -1, 4 = 1
  16: 4 = -1, 16 = 1
  17: 3 = 1, 4 = -1
  18: 6 = 2, 16 = -1
  19: 3 = 1, 16 = -1
  20: 5 = 1, 6 = -1, 17 = -1, 18 = 1
  21: 2 = 1, 19 = -1
  22: 1 = 1, 3 = 1, 19 = -1
  23: 1 = -1, 4 = -1, 19 = 1
  24: 1 = -1, 19 = -1, 20 = 1
  25: 1 = 1, 19 = 1, 20 = -1
}

state y[i in species] named "y{}" = start[i] scale 1e-6

let rate[j in reactions] = k[j] * product(y[i]^order[j, i] for i in species)

eq d/dt y[i] = sum(nu[j, i] * rate[j] for j in reactions)    for i in species

episode { step = 60 [min], max_steps = 1 }
solver  { rtol = 1e-10, max_steps = 100000 }
