# Vapour pressure by the equation of Antoine: log10(p/bar) = A - B/(T + C), T in K.
#
# Source: NIST Chemistry WebBook, SRD 69, which cites: D. R. Stull, Ind. Eng. Chem. 39 (1947) 517 (water); O. C. Bridgeman and
# E. W. Aldrich, J. Heat Transfer 86 (1964) 279 (water_cold, water_hot); D. Ambrose and C. H. S. Sprake, J. Chem.
# Thermodyn. 2 (1970) 631 (methanol, ethanol); D. Ambrose et al., J. Chem. Thermodyn. 6 (1974) 693 (acetone); C. B. Willingham
# et al., J. Res. Natl. Bur. Stand. 35 (1945) 219 (the hydrocarbons).
# Accuracy: 1 %, acetone 2 %, the wide row `water` 5 % near freezing and 2 % at its boiling point.
# Range: `antoine_low` to `antoine_high`. Outside of it the equation extrapolates without a warning; a model can test it,
# `constraint antoine_range when T < antoine_low[water]`.

table over antoine_substances {
  columns: antoine_A [1], antoine_B [K], antoine_C [K], antoine_low [K], antoine_high [K]
  water:        4.6543,  1435.264, -64.848, 255.9,  373
  water_cold:   5.40221, 1838.675, -31.737, 273,    303
  water_hot:    5.08354, 1663.125, -45.622, 344,    373
  methanol:     5.20409, 1581.341, -33.5,   288.1,  356.83
  ethanol:      5.24677, 1598.673, -46.424, 292.77, 366.63
  acetone:      4.42448, 1312.253, -32.445, 259.16, 507.6
  benzene:      4.01814, 1203.835, -53.226, 287.7,  354.07
  toluene:      4.07827, 1343.943, -53.773, 308.52, 384.66
  ethylbenzene: 4.07488, 1419.315, -60.539, 329.74, 410.27
  cyclohexane:  3.96988, 1203.526, -50.287, 293.06, 354.73
  hexane:       4.00266, 1171.53,  -48.784, 286.18, 342.69
  heptane:      4.02832, 1268.636, -56.199, 299.07, 372.43
  octane:       4.04867, 1355.126, -63.633, 326.08, 399.72
}

# Vapour pressure, and boiling temperature in K: `antoine(water, kelvin(T))`, `antoine_boiling(water, 1 [atm])`.
def antoine(i in antoine_substances, T) = (10^(antoine_A[i] - antoine_B[i]/(T + antoine_C[i]))) as [bar]
def antoine_boiling(i in antoine_substances, p) = antoine_B[i]/(antoine_A[i] - log10(p/(1 [bar]))) - antoine_C[i]
