# Secondary settler of ten layers, numbered from the bottom, fed at the sixth. Streams are those of streams.eq.
#
# The model declares `set species`, with `set solids` and `set solubles` its parts, and `unit amount = 1 [g]`. It sets underflow.Q.
# Source: I. Takacs, G. G. Patry and D. Nolasco, Water Research 25 (1991) 1263; parameters of the benchmark BSM1 (J. Alex et al. 2008).
# Range: one-dimensional settling of activated sludge without reaction; a feed with solids, whose composition all layers have.

use "lib/streams.eq"

component Settler "solids settle, solubles pass; effluent at the top" {
  param A         : m^2   = 1500      in 0..inf    "surface"
  param depth     : m     = 4         in 0..inf    "depth"
  param v_max     : m/d   = 250       in 0..inf    "largest settling velocity"
  param v_0       : m/d   = 474       in 0..inf    "Vesilind velocity"
  param r_h       : m^3/g = 0.000576  in 0..inf    "hindered settling"
  param r_p       : m^3/g = 0.00286   in 0..inf    "settling at low concentrations"
  param f_ns      : 1     = 0.00228   in 0..1      "share that does not settle"
  param X_t       : g/m^3 = 3000      in 0..inf    "threshold of the clarification zone"
  param to_solids : 1     = 0.75      in 0..inf    "suspended solids over the sum of the solids"
  port inlet, effluent, underflow : Stream
  state X[j in 1..10] : g/m^3 = 500 in 0..30000 scale 100    "suspended solids"
  state S[i in solubles, j in 1..10] : g/m^3 = 10 in 0..1000 scale 10    "solubles"
  let h            = depth/10
  let X_f  : g/m^3 = to_solids*sum(inlet.c[i] for i in solids)
  let v_in         = inlet.Q/A
  let v_up         = effluent.Q/A
  let v_dn         = underflow.Q/A
  let settling[j in 1..10] : g/(m^2 d) = X[j]*max(0 [m/d], min(v_max, v_0*(exp(-r_h*(X[j] - f_ns*X_f)) - exp(-r_p*(X[j] - f_ns*X_f)))))
  # from layer j to the one below
  let J[j in 2..10] = if j > 6 and X[j-1] <= X_t then settling[j] else min(settling[j], settling[j-1])
  eq h*d/dt X[j]    = v_up*(X[j-1] - X[j]) + (if j == 10 then 0 [g/(m^2 d)] else J[j+1]) - J[j]    for j in 7..10
  eq h*d/dt X[6]    = v_in*X_f - (v_up + v_dn)*X[6] + J[7] - J[6]
  eq h*d/dt X[j]    = v_dn*(X[j+1] - X[j]) + J[j+1] - (if j == 1 then 0 [g/(m^2 d)] else J[j])    for j in 1..5
  eq h*d/dt S[i, j] = v_up*(S[i, j-1] - S[i, j])                 for i in solubles, j in 7..10
  eq h*d/dt S[i, 6] = v_in*inlet.c[i] - (v_up + v_dn)*S[i, 6]    for i in solubles
  eq h*d/dt S[i, j] = v_dn*(S[i, j+1] - S[i, j])                 for i in solubles, j in 1..5
  eq effluent.Q     = inlet.Q - underflow.Q
  eq effluent.c[i]  = S[i, 10]                                   for i in solubles
  eq effluent.c[i]  = inlet.c[i]*X[10]/X_f                       for i in solids
  eq underflow.c[i] = S[i, 1]                                    for i in solubles
  eq underflow.c[i] = inlet.c[i]*X[1]/X_f                        for i in solids
  eq effluent.T     = inlet.T
  eq underflow.T    = inlet.T
}
