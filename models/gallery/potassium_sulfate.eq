model PotassiumSulfate "Batch cooling crystallisation of potassium sulfate: four moments and the solute"

# The system crystallization of pc-gym (M. Bloor et al., arXiv:2410.22093), with its parameters and start; kinetics from M. G. F. de
# Moraes et al., Industrial and Engineering Chemistry Research 62 (2023). Nucleation and growth stop without supersaturation;
# pc-gym takes the absolute value there.
#
# Task: by the temperature, a mean size of 15 um and a coefficient of variation of 1 at the end of the batch, with little fines.
#
# Checked: growth of volume is what the solute loses; trajectories of SciPy.

time t : min

param k_a            = 0.923714966      "rate of nucleation, 1/(cm3 min) of g/L and um3/cm3"
param k_b   : K      = -6754.878558     "activation temperature of nucleation"
param k_c            = 0.92229965554    "order in the supersaturation"
param k_d            = 1.341205945      "order in the third moment"
param k_g            = 48.07514464      "rate of growth, cm/min of g/L"
param k_1   : K      = -4921.261419     "activation temperature of growth"
param k_2            = 1.871281405      "order of growth"
param a              = 0.50523693       "growth without size"
param b     : 1/cm   = 7.271241375      "growth with the size"
param shape          = 7.510905767      "shape factor"
param rho   : g/cm^3 = 2.658            "density of the crystals"

action T : degC = 38 in 10..40    "temperature"

state mu_0 : 1/cm^3    = 1478.00986666666  in 0..1e6   scale 1e3    "number of crystals"
state mu_1 : um/cm^3   = 22995.8230590611  in 0..1e8   scale 1e4    "their length"
state mu_2 : um^2/cm^3 = 1800863.24079725  in 0..1e10  scale 1e6    "second moment"
state mu_3 : um^3/cm^3 = 248516167.940593  in 0..1e12  scale 1e8    "third moment"
state c    : g/cm^3    = 0.15861523304     in 0..0.5   scale 0.1    "solute"

param bad = 1 ~ 1 + normal(0, 0.05) in 0.7..1.3    "rate of nucleation of the batch, relative"
disturbance dT : K = 0 ~ 0.8*dT + 0.2 [K]*normal(0, 1) clip bounds in -2..2    "deviation of the temperature from its command"

let kelvins : K            = kelvin(T) + dT
let c_sat   : g/L          = -686.2686 [g/L] + 3.579165 [g/(L K)]*kelvins - 0.00292874 [g/(L K^2)]*sq(kelvins)    "solubility"
let excess  : g/L          = max(c - c_sat, 0 [g/L])                                      "supersaturation"
let B       : 1/(cm^3 min) = (bad*k_a*exp(k_b/kelvins)*value(excess, g/L)^k_c*value(mu_3, um^3/cm^3)^k_d) as [1/(cm^3 min)]    "nucleation"
let G       : cm/min       = (k_g*exp(k_1/kelvins)*value(excess, g/L)^k_2) as [cm/min]    "growth"
let L_n     : um           = mu_1/mu_0                                                    "mean size"
let CV      : 1            = sqrt(mu_2*mu_0/sq(mu_1) - 1)                                 "coefficient of variation"

eq d/dt mu_0 = B
eq d/dt mu_1 = G*(a*mu_0 + b*mu_1)
eq d/dt mu_2 = 2*G*(a*mu_1 + b*mu_2)
eq d/dt mu_3 = 3*G*(a*mu_2 + b*mu_3)
eq d/dt c    = -0.5*rho*shape*G*(a*mu_2 + b*mu_3)

observe mu_0, mu_1, mu_2, mu_3, c, L_n in 0..100, CV in 0..5, left = 1 - n/30 in 0..1
level online "size by image analysis, and the solute" {
  observe L_n in 0..100 noise normal(0, 0.3), c noise normal(0, 5e-4), left = 1 - n/30 in 0..1
}

reward size default = -sq((L_n - 15 [um])/1 [um]) - sq((CV - 1)/0.1)    "squared deviations from both aims"
constraint fines when CV > 2.5
fail dissolved when excess <= 0 [g/L] and n > 0
episode { step = 1 [min], max_steps = 30, error_reward = -100 }
solver  { method = auto, rtol = 1e-8 }
policy recipe "cubic cooling" { T = 37 - 16.5*(n/29)^3 }
