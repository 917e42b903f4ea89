# Units of a chromatographic train. A liquid carries the product, a modifier (salt or acid) and, if wanted, a tracer that binds nowhere; flows may stand still.

connector Liquid { Q : L/min in 0..inf, c : mg/L, c_s : M, c_t : mg/L }

choice fluxes  = upwind | central    "convection in columns and loops: first order and monotone, or second order"
choice tracer  = off | on            "a tracer that binds nowhere, for the proxy of purity"
choice elution = smooth | flag       "where Protein A elutes: where the modifier has come, or in the whole bed from the first cut on"

component Bed "transport alone: a loop (eps = 1), a column in flow-through" {
  param L   : dm      in 0..inf    "length"
  param V   : L       in 0..inf    "volume with the packing"
  param D_v : dm                   "axial dispersion over superficial velocity"
  param eps      = 1               "void"
  param n_z                        "cells"
  port inlet, outlet : Liquid
  domain z in 0..L cells n_z scheme upwind
  state c[z]   : mg/L = 0  in 0..inf  scale 1       "product"
  state c_s[z] : M    = 0  in 0..inf  scale 0.01    "modifier"
  let  A = V / L
  let  v = inlet.Q / A
  flux J[z] = v*c[z] - eps*D_v*v*grad(c[z]), low = v*inlet.c
  flux S[z] = v*c_s[z] - eps*D_v*v*grad(c_s[z]), low = v*inlet.c_s
  eq   d/dt c[z]   = -div(J[z]) / eps    for z
  eq   d/dt c_s[z] = -div(S[z]) / eps    for z
  eq   outlet.Q    = inlet.Q
  eq   outlet.c    = c[z.last]
  eq   outlet.c_s  = c_s[z.last]
  eq   outlet.c_t  = 0 [mg/L]
  let  held : mg = A * eps * integral(c[z] for z)    "product in the unit"
  when fluxes = central { domain z in 0..L cells n_z scheme central }
  when tracer = on {
    state c_t[z] : mg/L = 0 in 0..inf scale 1    "tracer"
    flux  R[z] = v*c_t[z] - eps*D_v*v*grad(c_t[z]), low = v*inlet.c_t
    eq    d/dt c_t[z] = -div(R[z]) / eps    for z
    eq    outlet.c_t  = c_t[z.last]
  }
}

component LumpedColumn "binding in one lumped step, with a Henry factor that falls with the modifier" {
  param L         : dm         in 0..inf    "length"
  param V         : L          in 0..inf    "volume with the packing"
  param D_v       : dm                      "axial dispersion over superficial velocity"
  param eps                                 "void"
  param q_max     : mg/L                    "capacity"
  param k         : 1/min                   "rate"
  param H_0                                 "Henry factor at 1 M"
  param beta                                "its exponent"
  param c_s_floor : M     = 0               "the Henry factor does not grow below"
  param n_z                                 "cells"
  port inlet, outlet : Liquid
  domain z in 0..L cells n_z scheme upwind
  state c[z]   : mg/L = 0  in 0..inf  scale 1       "product, mobile"
  state q[z]   : mg/L = 0  in 0..inf  scale 1       "product, bound"
  state c_s[z] : M    = 0  in 0..inf  scale 0.01    "modifier"
  let  A        = V / L
  let  v        = inlet.Q / A
  let  henry[z] = H_0 * (max(c_s[z], c_s_floor) / 1 [M])^(-beta)
  flux J[z] = v*c[z] - eps*D_v*v*grad(c[z]), low = v*inlet.c
  flux S[z] = v*c_s[z] - eps*D_v*v*grad(c_s[z]), low = v*inlet.c_s
  eq   d/dt q[z]   = k * (henry[z]*(1 - q[z]/q_max)*c[z] - q[z])    for z
  eq   d/dt c[z]   = (-div(J[z]) - (1 - eps)*der(q[z])) / eps       for z
  eq   d/dt c_s[z] = -div(S[z]) / eps                               for z
  eq   outlet.Q    = inlet.Q
  eq   outlet.c    = c[z.last]
  eq   outlet.c_s  = c_s[z.last]
  eq   outlet.c_t  = 0 [mg/L]
  let  held : mg = A * integral(eps*c[z] + (1 - eps)*q[z] for z)    "product in the unit"
  when fluxes = central { domain z in 0..L cells n_z scheme central }
  when tracer = on {
    state c_t[z] : mg/L = 0 in 0..inf scale 1    "tracer"
    flux  R[z] = v*c_t[z] - eps*D_v*v*grad(c_t[z]), low = v*inlet.c_t
    eq    d/dt c_t[z] = -div(R[z]) / eps    for z
    eq    outlet.c_t  = c_t[z.last]
  }
}

component AffinityColumn "Protein A through all phases: general rate model, loading and elution in one binding law" {
  param L         : dm         = 2                                "bed length"
  param A         : dm^2       = 50                  in 0..inf    "cross-section"
  param eps_c                  = 0.31                             "void between the beads"
  param eps_p                  = 0.94                             "porosity of the beads"
  param r_p       : dm         = 4.25e-4                          "radius of a bead"
  param D_eff     : dm^2/min   = 7.6e-7                           "effective diffusivity in the pores"
  param D_v       : dm         = 0.055                            "axial dispersion over superficial velocity"
  param k_f0      : dm/min     = 0.0254726895534776               "film coefficient at 1 dm/min"
  param n_f                    = 0.58                             "its exponent"
  param q_max1    : mg/L       = 36450                            "capacity of the fast sites"
  param q_max2    : mg/L       = 77850                            "capacity of the slow sites"
  param k_1       : L/(mg min) = 7.04e-4                          "adsorption rate of the fast sites"
  param k_2       : L/(mg min) = 2.1e-5                           "adsorption rate of the slow sites"
  param K         : L/mg       = 0.0153                           "equilibrium constant of loading"
  param q_max_elu : mg/L       = 114300                           "capacity in elution"
  param k_elu     : 1/min      = 0.64                             "rate of elution"
  param H0_elu                 = 2.2e-2                           "Henry factor of elution at 1 M"
  param beta_elu               = 0.2                              "its exponent"
  param c_s_half  : M          = 0.01                             "modifier at which elution is half switched on"
  param n_z                    = 50                               "cells along the bed"
  param n_r                    = 6                                "cells along the radius of a bead"

  port inlet, outlet : Liquid
  var eluting    # 1 from the first cut to the strip

  domain z in 0..L cells n_z scheme upwind
  domain r in 0..r_p cells n_r scheme central geometry spherical

  state c[z]     : mg/L = 0  in 0..inf  scale 1       "mobile phase"
  state cp[z, r] : mg/L = 0  in 0..inf  scale 1       "pore liquid"
  state q1[z]    : mg/L = 0  in 0..inf  scale 1       "bound, fast sites"
  state q2[z]    : mg/L = 0  in 0..inf  scale 1       "bound, slow sites"
  state c_s[z]   : M    = 0  in 0..inf  scale 0.01    "modifier"

  let v         = inlet.Q / A
  let k_f       = k_f0 * (v / 1 [dm/min])^n_f
  let k_rim     = 2*D_eff / (r_p/n_r)
  let c_surf[z] = (k_f*c[z] + k_rim*cp[z, r.last]) / (k_f + k_rim)
  let film[z]   = k_f * (c[z] - c_surf[z])
  let eps_t     = eps_c + (1 - eps_c)*eps_p    # total void, which the modifier fills

  # w: share of the binding law that is elution; local, so that cells which the buffer has not reached keep binding.
  let w[z] = sq(c_s[z]) / (sq(c_s[z]) + sq(c_s_half))
  when elution = flag { let w[z] = if eluting > 0.5 then 1 else 0 }
  let henry[z] = H0_elu * ((max(c_s[z], 0 [M]) + 1e-6 [M]) / 1 [M])^(-beta_elu)

  flux J[z] = v*c[z] - eps_c*D_v*v*grad(c[z]), low = v*inlet.c
  flux S[z] = v*c_s[z] - eps_t*D_v*v*grad(c_s[z]), low = v*inlet.c_s
  flux G[z, r] = -D_eff*grad(cp[z, r]), low = 0, high = -film[z]

  eq d/dt c[z]     = (-div(J[z]) - (1 - eps_c)*3/r_p*film[z]) / eps_c     for z
  eq d/dt cp[z, r] = (-div(G[z, r]) - der(q1[z]) - der(q2[z])) / eps_p    for z, r
  eq d/dt c_s[z]   = -div(S[z]) / eps_t                                   for z
  eq d/dt q1[z] = (1 - w[z])*k_1*((q_max1 - q1[z])*c_surf[z] - q1[z]/K)
                  + w[z]*k_elu*(henry[z]*(1 - (q1[z] + q2[z])/q_max_elu)*c_surf[z] - q1[z])    for z
  eq d/dt q2[z] = (1 - w[z])*k_2*((q_max2 - q2[z])*c_surf[z] - q2[z]/K) - w[z]*k_elu*q2[z]    for z

  eq outlet.Q   = inlet.Q
  eq outlet.c   = c[z.last]
  eq outlet.c_s = c_s[z.last]
  eq outlet.c_t = 0 [mg/L]

  let ball         = integral(1 for r)
  let bead[z]      = integral(eps_p*cp[z, r] + q1[z] + q2[z] for r) / ball
  let held    : mg = A * integral(eps_c*c[z] + (1 - eps_c)*bead[z] for z)    "product in the column"
  when fluxes = central { domain z in 0..L cells n_z scheme central }
  when tracer = on {
    state c_t[z] : mg/L = 0 in 0..inf scale 1    "tracer"
    flux  R[z] = v*c_t[z] - eps_t*D_v*v*grad(c_t[z]), low = v*inlet.c_t
    eq    d/dt c_t[z] = -div(R[z]) / eps_t    for z
    eq    outlet.c_t  = c_t[z.last]
  }
}
