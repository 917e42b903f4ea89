model Beer "Batch fermentation of beer: finish in as few hours as possible by choosing the temperature"

# de Andres-Toro et al., Mathematics and Computers in Simulation 48 (1998) 65-74;
# Rodman and Gerogiorgis, Food and Bioproducts Processing 100 (2016) 255-274.

time t : h

# Every temperature function is exp(a + b/T) with T in kelvin, times one unit of the rate.
param a_mu_x0  = 108.31,   b_mu_x0  : K = -31934.09    "growth"
param a_Y_EA   = 89.92,    b_Y_EA   : K = -26589       "ester made per new biomass"
param a_mu_S0  = -41.92,   b_mu_S0  : K = 11654.64     "sugar uptake per active biomass"
param a_mu_L   = 30.72,    b_mu_L   : K = -9501.54     "lag to active"
param a_mu_DT  = 130.16,   b_mu_DT  : K = -38313       "death"
param a_mu_SD0 = 33.82,    b_mu_SD0 : K = -10033.28    "settling of dead cells"
param a_mu_e0  = 3.27,     b_mu_e0  : K = -1267.24     "ethanol formation per active biomass"
param a_k_S    = -119.63,  b_k_S    : K = 34203.95     "Monod constant of sugar"

param mu_DY : mg L/(g^2 h) = 0.000127672    "formation of diacetyl"
param mu_AB : L/(g h)      = 0.00113864     "reduction of diacetyl"
param S_0   : g/L          = 130            "sugar that scales the kinetics"

action T : degC = 13 in 9..16    "temperature of the fermentation"

state X_A  : g/L  = 0                        in 0..15     "active biomass"
state X_L  : g/L  = 2   ~ uniform(1.8, 2.2)  in 0..15     "latent biomass"
state X_D  : g/L  = 2   ~ uniform(1.8, 2.2)  in 0..15     "dead, suspended biomass"
state S    : g/L  = 130 ~ uniform(117, 143)  in 0..150    "sugar"
state EtOH : g/L  = 0                        in 0..150    "ethanol"
state DY   : mg/L = 0                        in 0..10     "diacetyl"
state EA   : mg/L = 0                        in 0..10     "ethyl acetate"

discrete elapsed        : h   = 0        in 0..200    "hours since the start"
discrete biomass_before : g/L = biomass               "biomass at the end of the previous step"

def arrhenius(a, b) = exp(a + b / kelvin(T))

let k_x     : g/L = 0.5 * S_0                                                      "ethanol that halves growth"
let mu_x    : 1/h = arrhenius(a_mu_x0, b_mu_x0) as [1/h] * S / (k_x + EtOH)        "specific growth rate"
let mu_SD   : 1/h = arrhenius(a_mu_SD0, b_mu_SD0) as [1/h] * k_x / (k_x + EtOH)    "settling rate"
let k_S     : g/L = arrhenius(a_k_S, b_k_S) as [g/L]                               "Monod constant of sugar"
let mu_S    : 1/h = arrhenius(a_mu_S0, b_mu_S0) as [1/h] * S / (k_S + S)           "specific sugar uptake"
let mu_e    : 1/h = arrhenius(a_mu_e0, b_mu_e0) as [1/h] * S / (k_S + S)           "specific ethanol formation"
let f       : 1   = 1 - EtOH / k_x                                                 "inhibition by ethanol"
let biomass : g/L = X_A + X_L + X_D                                                "suspended biomass"

let mu_L  = arrhenius(a_mu_L, b_mu_L) as [1/h]
let mu_DT = arrhenius(a_mu_DT, b_mu_DT) as [1/h]
let Y_EA  = arrhenius(a_Y_EA, b_Y_EA) as [mg/g]

eq d/dt X_A  = mu_x * X_A - mu_DT * X_A + mu_L * X_L
eq d/dt X_L  = -mu_L * X_L
eq d/dt X_D  = -mu_SD * X_D + mu_DT * X_A
eq d/dt S    = -mu_S * X_A
eq d/dt EtOH = f * mu_e * X_A
eq d/dt DY   = mu_DY * S * X_A - mu_AB * DY * EtOH
eq d/dt EA   = Y_EA * mu_x * X_A

invariant cells = biomass rate mu_x*X_A - mu_SD*X_D    "what wakes up or dies only changes its kind"

at start { next biomass_before = biomass }
at end   { next elapsed = elapsed + 1 [h] }

observe X_A, X_L, X_D, S, EtOH, DY, EA, elapsed

level online "clock and gravity; cells, ethanol and flavours are hidden" {
  observe elapsed, S noise normal(0, 0.5)
}
level laboratory extends online "with samples twice a day: cells and ethanol two hours later, flavours six" {
  observe biomass in 0..45 every 12 delay 2 noise normal(0, 0.1), EtOH every 12 delay 2 noise normal(0, 0.5)
  observe DY every 12 delay 6 noise normal(0, 0.02), EA every 12 delay 6 noise normal(0, 0.02)
}

success finished when (biomass < 0.5 [g/L] or abs(biomass - biomass_before) < 0.01 [g/L]) and S < 0.5 [g/L] and EtOH > 50 [g/L]
fail state_box when outside bounds(X_A, X_L, X_D, S, EtOH, DY, EA, elapsed)

reward finish default = if success then 200 else if timeout then -200 else -1    "one less an hour, a prize for finishing"

# `auto` keeps the states of whole random episodes within 1e-7 of their ranges: `python -m smpl.bench episodes`.
episode { step = 1 [h], max_steps = 200, error_reward = -200 }
solver  { method = auto, rtol = 1e-8, one_step_rtol = 1e-6 }

policy profile "industrial temperature profile" {
  T = if n < 25 then 11 + n/8 else if n < 120 then 14 else if n < 145 then 14 + 2*(n - 120)/25
      else if n < 170 then 16 else if n < 184 then 16 - 8*(n - 170)/15 else 9
}

variant batch_sugar "the initial sugar of the batch scales the kinetics, as in the literature" {
  let S_0 : g/L = initial(S)
}
variant short_step "each step of one hour integrates 0.99 h, as the original does" { episode { integrate = 0.99 [h] } }

# ---- The plant's world: what else changes, each alone or together ----

variant cooling_disturbances "the broth is not what the coolant's controller says: it wanders, and its valve sticks" {
  param stiction : K = 0.2 in 0..2    "smallest change that the valve follows"
  disturbance T_shift : K = 0 ~ 0.9*T_shift + 0.1 [K]*normal(0, 1)    "temperature of the broth beyond that of the valve"
  discrete T_valve : degC = 13 in 9..16    "temperature that the valve keeps"
  at start { next T_valve = if abs(T - T_valve) > stiction then T else T_valve }
  def arrhenius(a, b) = exp(a + b / kelvin(T_valve + T_shift))
}
variant sensor_bias "the hydrometer has an offset that drifts" {
  random offset_S ~ normal(0, 1)
  disturbance drift_S : g/L = 0 ~ drift_S + 0.05 [g/L]*normal(0, 1)    "drift of the hydrometer"
  observe S : g/L = S + offset_S*0.5 [g/L] + drift_S in 0..150
}
variant weak_yeast "the yeast of some batches is weaker: less of it wakes" {
  param weakness = 0.5 ~ uniform(0, 1) in 0..1    "of the yeast of the batch"
  def waking() = 1 - 0.3*weakness
  eq d/dt X_A = mu_x * X_A - mu_DT * X_A + mu_L * X_L * waking()
  eq d/dt X_L = -mu_L * X_L * waking()
}

# ---- Tests: `smpl test models/beer.eq`, against published batches ----

test "the industrial profile finishes the batch in step 145" {
  start nominal
  policy profile
  for 144 [h]
  expect S < 1 [g/L]
  steps 1
  expect success finished
}
test "at 13 degC the batch takes 187 h" {
  start nominal
  T = 13 for 186 [h]
  expect EtOH > 50 [g/L]
  steps 1
  expect success finished
}
