# Heat exchangers between two streams of streams.eq; their contents keep their composition.
#
# Source: D. E. Seborg et al., Process Dynamics and Control: energy balances of both sides; the distributed ones
# approach the logarithmic mean temperature difference as their cells become finer.
# Range: constant heat capacities and transfer coefficient, no change of phase, no heat capacity of the wall.

use "lib/streams.eq"

component LumpedExchanger "one mixed volume on each side" {
  param UA       : kW/K       = 1     in 0..inf    "heat transfer coefficient times area"
  param V_hot    : m^3        = 0.1   in 0..inf    "volume of the hot side"
  param V_cold   : m^3        = 0.1   in 0..inf    "volume of the cold side"
  param rho_cp_h : kJ/(m^3 K) = 4180  in 0..inf    "heat capacity by volume, hot side"
  param rho_cp_c : kJ/(m^3 K) = 4180  in 0..inf    "heat capacity by volume, cold side"
  port hot_in, hot_out, cold_in, cold_out : Stream
  state T_hot  : degC = 60  in -50..500  scale 100    "temperature of the hot side"
  state T_cold : degC = 20  in -50..500  scale 100    "temperature of the cold side"
  let duty : kW = UA*(T_hot - T_cold)    "heat from the hot to the cold side"
  eq d/dt T_hot    = hot_in.Q*(hot_in.T - T_hot)/V_hot - duty/(rho_cp_h*V_hot)
  eq d/dt T_cold   = cold_in.Q*(cold_in.T - T_cold)/V_cold + duty/(rho_cp_c*V_cold)
  eq hot_out.Q     = hot_in.Q
  eq cold_out.Q    = cold_in.Q
  eq hot_out.c[i]  = hot_in.c[i]     for i in species
  eq cold_out.c[i] = cold_in.c[i]    for i in species
  eq hot_out.T     = T_hot
  eq cold_out.T    = T_cold
}

component CountercurrentExchanger(cells = 30) "plug flow on both sides, in opposite directions" {
  param UA       : kW/K       = 1     in 0..inf    "heat transfer coefficient times area"
  param V_hot    : m^3        = 0.1   in 0..inf    "volume of the hot side"
  param V_cold   : m^3        = 0.1   in 0..inf    "volume of the cold side"
  param rho_cp_h : kJ/(m^3 K) = 4180  in 0..inf    "heat capacity by volume, hot side"
  param rho_cp_c : kJ/(m^3 K) = 4180  in 0..inf    "heat capacity by volume, cold side"
  port hot_in, hot_out, cold_in, cold_out : Stream
  domain z in 0..1 cells cells scheme upwind    "share of the length, from the inlet of the hot stream"
  state T_hot[z]  : K = 330  in 200..800  scale 100    "temperature of the hot side"
  state T_cold[z] : K = 290  in 200..800  scale 100    "temperature of the cold side"
  let  D_hot  : 1/h = hot_in.Q/V_hot
  let  D_cold : 1/h = cold_in.Q/V_cold
  flux H[z] = D_hot*T_hot[z], low = D_hot*kelvin(hot_in.T)
  flux C[z] = -D_cold*T_cold[z], high = -D_cold*kelvin(cold_in.T)
  let  duty : kW = UA*integral(T_hot[z] - T_cold[z] for z)    "heat from the hot to the cold side"
  eq d/dt T_hot[z]  = -div(H[z]) - UA*(T_hot[z] - T_cold[z])/(rho_cp_h*V_hot)     for z
  eq d/dt T_cold[z] = -div(C[z]) + UA*(T_hot[z] - T_cold[z])/(rho_cp_c*V_cold)    for z
  eq hot_out.Q      = hot_in.Q
  eq cold_out.Q     = cold_in.Q
  eq hot_out.c[i]   = hot_in.c[i]                                                 for i in species
  eq cold_out.c[i]  = cold_in.c[i]                                                for i in species
  eq hot_out.T      = celsius(T_hot[z.last])
  eq cold_out.T     = celsius(T_cold[z.first])
}

component CocurrentExchanger extends CountercurrentExchanger {
  flux C[z] = D_cold*T_cold[z], low = D_cold*kelvin(cold_in.T)
  eq cold_out.T = celsius(T_cold[z.last])
}
