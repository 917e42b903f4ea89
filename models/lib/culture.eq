# Perfusion culture with cell retention and the buffer tank behind it; shared by mab.eq and mab_plant.eq.
# C. Kontoravdi et al. (2008, 2010), M. M. Papathanasiou et al. (2017), T. K. Villiger et al. (2016).

# ---- Culture ----

param a_mu     : 1/(h K)       = 0.0016           "slope of the largest growth rate over the temperature in degC"
param b_mu     : 1/h           = -0.0308          "its intercept"
param f_mu                     = 5                "factor on it; without it the cells wash out"
param mu_dmax  : 1/h           = 0.06             "largest death rate"
param n_d                      = 2                "exponent of the death rate"
param K_damm   : mM            = 1.76             "ammonia constant of death"
param K_glc    : mM            = 0.75             "Monod constant of glucose"
param K_gln    : mM            = 0.075            "Monod constant of glutamine"
param KI_lac   : mM            = 171.76           "inhibition by lactate"
param KI_amm   : mM            = 28.48            "inhibition by ammonia"
param K_dgln   : 1/h           = 9.6e-3           "decay of glutamine"
param m_glc    : mmol/(cell h) = 4.9e-14          "maintenance on glucose"
param alpha1   : mmol/(cell h) = 3.4e-13          "maintenance on glutamine"
param alpha2   : mM            = 4                "its half-saturation"
param Y_Xglc   : cell/mmol     = 2.6e8            "yield of cells on glucose"
param Y_Xgln   : cell/mmol     = 8e8              "yield of cells on glutamine"
param Y_lacglc : mmol/mmol     = 2.0              "lactate from glucose"
param Y_ammgln : mmol/mmol     = 0.45             "ammonia from glutamine"
param Q_mAb    : mg/(cell h)   = 6.59e-10         "specific productivity"
param eta_rec                  = 0.92             "share of the cells in F_1 that is recycled"
param eta_ret                  = 0.2              "the same for each solute"
param q_heat   : J/cell        = 1.2454042e-13    "heat of growth"
param rho      : g/L           = 1560             "density"
param c_p      : J/(g K)       = 1.244            "heat capacity"
param U        : J/(h K)       = 400              "heat transfer of the jacket"
param T_in     : degC          = 37               "temperature of the fresh medium"
param A_buf    : dm^2          = pi*2.5^2         "cross-section of the buffer tank"
param headroom                 = 1                "factor on the upper bounds"

action F_in   : L/min = 21.689197033088462    in 17.35135762647077..50     scale 50      "fresh medium"
action F_1    : L/min = 21.694198456642003    in 17.355358765313603..50    scale 50      "bioreactor to separator"
action F_r    : L/min = 0.005001423553539404  in 0.004001138842831524..50  scale 50      "recycle"
action F_2    : L/min = 21.689197033088462    in 17.35135762647077..50     scale 50      "separator to buffer tank"
action GLC_in : mM    = 1999.9986858573884    in 1599.9989486859108..2000  scale 2000    "glucose in the medium"
action GLN_in : mM    = 12.9962188965766      in 10.396975117261281..2000  scale 2000    "glutamine in the medium"
action T_c    : degC  = 36.9999946083737      in 29.59999568669896..50     scale 50      "coolant"
action F_out  : L/min = 21.689197033088462    in 17.35135762647077..50     scale 50      "buffer tank to column"

# Index 1: bioreactor, 2: separator.
state Xv1   : cell/L = 32634226513.896458  in 26107381211.11717..headroom*39161071816.67575   scale 3e10    "viable cells, bioreactor"
state Xt1   : cell/L = 82361684406.46858   in 65889347525.174866..headroom*98834021287.7623   scale 5e10    "total cells, bioreactor"
state GLC1  : mM     = 2467.739824646896   in 1974.191859717517..headroom*2961.2877895762754  scale 5000    "glucose, bioreactor"
state GLN1  : mM     = 5.767917835259436   in 4.614334268207549..headroom*6.921501402311322   scale 50      "glutamine, bioreactor"
state LAC1  : mM     = 63.364355312490446  in 50.69148424999236..headroom*76.03722637498853   scale 200     "lactate, bioreactor"
state AMM1  : mM     = 4.80086309325562    in 3.840690474604496..headroom*5.761035711906744   scale 50      "ammonia, bioreactor"
state mAb1  : mg/L   = 61.95767992869218   in 49.566143942953744..headroom*74.34921591443062  scale 150     "antibody, bioreactor"
state V1    : L      = 3000                in 2400..headroom*3000                             scale 3000    "volume, bioreactor"
state Xv2   : cell/L = 2611340144.040371   in 2089072115.232297..headroom*3133608172.848445   scale 2e10    "viable cells, separator"
state Xt2   : cell/L = 6590454131.000228   in 5272363304.800182..headroom*7908544957.2002735  scale 3e10    "total cells, separator"
state GLC2  : mM     = 1974.6470978310813  in 1579.717678264865..headroom*2369.5765173972973  scale 5000    "glucose, separator"
state GLN2  : mM     = 4.61539831767993    in 3.6923186541439446..headroom*5.538477981215916  scale 100     "glutamine, separator"
state LAC2  : mM     = 50.703173444299246  in 40.5625387554394..headroom*60.843808133159094   scale 250     "lactate, separator"
state AMM2  : mM     = 3.8415761185611363  in 3.073260894848909..headroom*4.609891342273364   scale 100     "ammonia, separator"
state mAb2  : mg/L   = 49.57757365045033   in 39.662058920360266..headroom*59.4930883805404   scale 200     "antibody, separator"
state V2    : L      = 2976.932623327295   in 2381.546098661836..headroom*3000                scale 3000    "volume, separator"
state T     : degC   = 37.00000036795219   in 33.0..headroom*37.0                             scale 37      "temperature, bioreactor"
state h     : dm     = 15                  in 0.0..headroom*50.0                              scale 3       "level, buffer tank"
state c_buf : mg/L   = 49.57757365045033   in 39.662058920360266..headroom*59.4930883805404   scale 200     "antibody, buffer tank"

let mu_max : 1/h = f_mu * (a_mu*(T - 0 [degC]) + b_mu)    "largest growth rate"
let mu : 1/h = mu_max * GLC1/(K_glc + GLC1) * GLN1/(K_gln + GLN1)
               * KI_lac/(KI_lac + LAC1) * KI_amm/(KI_amm + AMM1)    "growth rate"
let mu_d  : 1/h           = mu_dmax / (1 + (K_damm/AMM1)^n_d)          "death rate"
let q_glc : mmol/(cell h) = mu/Y_Xglc + m_glc                          "uptake of glucose"
let q_gln : mmol/(cell h) = mu/Y_Xgln + alpha1*GLN1/(alpha2 + GLN1)    "uptake of glutamine"
let q_lac : mmol/(cell h) = Y_lacglc * q_glc                           "formation of lactate"
let q_amm : mmol/(cell h) = Y_ammgln * q_gln                           "formation of ammonia"

# What the recycle carries is the share eta of what F_1 carries, so that nothing is divided by the tiny F_r.
def feed(s_in, s) = F_in/V1 * (s_in - s)
def washout(s) = -F_in/V1 * s
def recycle(s, eta) = (eta*F_1 - F_r)/V1 * s
def separator(s1, s2, eta) = F_1/V2 * (s1 - s2) - (eta*F_1*s1 - F_r*s2)/V2

eq d/dt Xv1  = (mu - mu_d)*Xv1 + washout(Xv1) + recycle(Xv1, eta_rec)
eq d/dt Xt1  = mu*Xv1 + washout(Xt1) + recycle(Xt1, eta_rec)
eq d/dt GLC1 = -q_glc*Xv1 + feed(GLC_in, GLC1) + recycle(GLC1, eta_ret)
eq d/dt GLN1 = -q_gln*Xv1 - K_dgln*GLN1 + feed(GLN_in, GLN1) + recycle(GLN1, eta_ret)
eq d/dt LAC1 = q_lac*Xv1 + washout(LAC1) + recycle(LAC1, eta_ret)
eq d/dt AMM1 = q_amm*Xv1 + K_dgln*GLN1 + washout(AMM1) + recycle(AMM1, eta_ret)
eq d/dt mAb1 = Q_mAb*Xv1 + washout(mAb1) + recycle(mAb1, eta_ret)
eq d/dt V1   = F_in + F_r - F_1

eq d/dt Xv2  = separator(Xv1, Xv2, eta_rec)
eq d/dt Xt2  = separator(Xt1, Xt2, eta_rec)
eq d/dt GLC2 = separator(GLC1, GLC2, eta_ret)
eq d/dt GLN2 = separator(GLN1, GLN2, eta_ret)
eq d/dt LAC2 = separator(LAC1, LAC2, eta_ret)
eq d/dt AMM2 = separator(AMM1, AMM2, eta_ret)
eq d/dt mAb2 = separator(mAb1, mAb2, eta_ret)
eq d/dt V2   = F_1 - F_2 - F_r

eq d/dt T = F_in/V1 * (T_in - T) + q_heat*mu*Xv1/(rho*c_p) + U*(T_c - T)/(V1*rho*c_p)

# ---- Buffer tank ----

eq d/dt h     = (F_2 - F_out) / A_buf
eq d/dt c_buf = F_2*(mAb2 - c_buf) / (A_buf*h)

# The tanks' box reaches 5 % above the bounds, with a tolerance of 1e-6 of their range; a start is drawn inside it, 1 % of its width from either end.
def excess(x) = max(value(low(x)) - value(x), value(x) - 1.05*value(high(x))) / (value(high(x)) - value(low(x))) - 1e-6
def inner_low(x) = 0.99*value(low(x)) + 0.01*1.05*value(high(x))
def inner_high(x) = 0.01*value(low(x)) + 0.99*1.05*value(high(x))

# ---- The plant's world: what else changes, each alone or together ----

variant feed_disturbances "temperature and glucose of the fresh medium wander" {
  param T_in_mean : degC = 37    "mean temperature of the fresh medium"
  disturbance T_in_shift = 0 ~ 0.9*T_in_shift + normal(0, 1)    "temperature beyond its mean, in tenths of a kelvin"
  disturbance GLC_shift  = 0 ~ 0.9*GLC_shift + normal(0, 1)     "glucose beyond what is asked for, in parts of a thousand"
  let T_in : degC = T_in_mean + T_in_shift*0.1 [K]    "temperature of the fresh medium"
  eq d/dt GLC1 = -q_glc*Xv1 + feed(GLC_in*(1 + 0.001*GLC_shift), GLC1) + recycle(GLC1, eta_ret)
}
variant fouling "the jacket fouls, faster in some campaigns than in others" {
  param U_clean : J/(h K) = 400    "heat transfer of the clean jacket"
  random foulness ~ uniform(0.5, 1.5)
  disturbance fouled = 0 ~ min(fouled + 0.001*foulness, 0.5)    "share of the heat transfer that is lost"
  let U : J/(h K) = U_clean * (1 - fouled)    "heat transfer of the jacket"
}
variant sticking_valve "the valve of the coolant moves only where it is to move by more than its band" {
  param stiction : K = 0.1 in 0..2    "band of the valve"
  discrete T_valve : degC = 36.9999946083737 in 29.59999568669896..50    "temperature of the coolant behind the valve"
  at start { next T_valve = if abs(T_c - T_valve) > stiction then T_c else T_valve }
  eq d/dt T = F_in/V1 * (T_in - T) + q_heat*mu*Xv1/(rho*c_p) + U*(T_valve - T)/(V1*rho*c_p)
}
