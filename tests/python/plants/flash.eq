model FlashDrum "benzene and toluene: feed tank and flash drum"
time t : h
table over species {
  columns: T_c [K], p_c [bar], a [1], b [1], c_3 [1], c_6 [1]
  benzene: 562.1,  48.956,  -6.94739, 1.25253, -2.53686, -3.49284
  toluene: 591.72, 41.0645, -7.28607, 1.38091, -2.83433, -2.79168
}
action F_out  : m^3/h = 10  in 5..20      "flow from the tank to the drum"
action T_drum : degC  = 97  in 96..101    "temperature of the drum"
param p    : bar   = 1.2    "pressure of the drum"
param A    : m^2   = 4      "cross-section of the tank"
param F_in : m^3/h = 10     "feed"
param T_in : degC  = 25     "its temperature"
param c_in[i in species] : kmol/m^3 = { benzene: 6, toluene: 4 }    "its concentrations"
state h : m = 1 in 0..5    "level of the tank"
state c[i in species] : kmol/m^3 = 5 in 0..inf scale 1    "concentrations in the tank"
state T : degC = 25 in -50..500    "temperature of the tank"
var share = 0.5 in 0..1    "share of the feed that evaporates"
eq d/dt h    = (F_in - F_out)/A
eq d/dt c[i] = F_in*(c_in[i] - c[i])/(A*h)    for i in species
eq d/dt T    = F_in*(T_in - T)/(A*h)
let total : kmol/m^3 = sum(c[i] for i in species)
let F     : kmol/h   = F_out*total    "flow to the drum"
let z[i in species]   = c[i]/total
let tau[i in species] = 1 - kelvin(T_drum)/T_c[i]
let K[i in species]   = p_c[i]/p*exp((a[i]*tau[i] + b[i]*tau[i]^1.5 + c_3[i]*tau[i]^3 + c_6[i]*tau[i]^6)/(1 - tau[i]))
eq share = clip(share + sum(z[i]*(K[i] - 1)/(1 + share*(K[i] - 1)) for i in species), 0, 1)
let x[i in species] = z[i]/(1 + share*(K[i] - 1))    "mole fractions of the liquid"
let y[i in species] = K[i]*x[i]                      "mole fractions of the vapour"
let V : kmol/h = share*F    "vapour"
let L : kmol/h = F - V      "liquid"
observe h, share, y_b = y[benzene] in 0..1
episode { step = 0.1 [h], max_steps = 50 }
