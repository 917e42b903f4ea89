# Absorber or stripper with equilibrium stages. Flows are molar, as in flash.eq.
#
# The model declares `carrier` (the gas that is not absorbed), `solvent` (the liquid that does not evaporate) and the solutes in
# `species`, `set solutes` of those that move, and an equation for each `K[i]`: Henry's constant over the pressure.
# Source: J. D. Seader, E. J. Henley and D. K. Roper, Separation Process Principles, 3rd edition (2011), absorption and stripping;
# balances in mole ratios, so that concentrated gases are exact; efficiency of the stages by E. V. Murphree, Ind. Eng. Chem. 17 (1925) 747.
# Range: one temperature, no holdup of gas, a constant holdup of solvent, and liquids that do not boil (sum of K*x below one).

use "lib/flash.eq"

component Absorber(stages = 10) "equilibrium stages, numbered from the top; the model sets `K[i]` of the solutes" {
  param M : kmol = 1  in 0..inf    "solvent on a stage"
  param E : 1    = 1  in 0..1      "efficiency of a stage, of the gas"
  port gas_in, gas_out, liquid_in, liquid_out : Molar
  var K[solutes] : 1    "mole fraction in the gas over that in the liquid"
  state X[k in 1..stages, i in solutes] : 1 = 0 in 0..inf scale 0.01    "moles of solute by mole of solvent"
  var Y[k in 1..stages, i in solutes] : 1 = 0 in 0..inf    "moles of solute by mole of carrier, in the gas that leaves a stage"
  let G : kmol/h = gas_in.F*gas_in.x[carrier]          "flow of carrier"
  let L : kmol/h = liquid_in.F*liquid_in.x[solvent]    "flow of solvent"
  let boiling[k in 1..stages]            = sum(K[j]*X[k, j] for j in solutes)/(1 + sum(X[k, j] for j in solutes))
  let Y_eq[k in 1..stages, i in solutes] = K[i]*X[k, i]/(1 + sum(X[k, j] for j in solutes))/(1 - boiling[k])    # in equilibrium
  let Y_in[k in 1..stages, i in solutes] = if k == stages then gas_in.x[i]/gas_in.x[carrier] else Y[k+1, i]
  eq Y[k, i]            = Y_in[k, i] + E*(Y_eq[k, i] - Y_in[k, i])                 for k in 1..stages, i in solutes
  eq M*d/dt X[k, i]     = L*((if k == 1 then liquid_in.x[i]/liquid_in.x[solvent] else X[k-1, i]) - X[k, i]) + G*(Y_in[k, i] - Y[k, i])    for k in 1..stages, i in solutes
  eq gas_out.F          = G*(1 + sum(Y[1, i] for i in solutes))
  eq liquid_out.F       = L*(1 + sum(X[stages, i] for i in solutes))
  eq gas_out.x[i]       = Y[1, i]/(1 + sum(Y[1, j] for j in solutes))              for i in solutes
  eq liquid_out.x[i]    = X[stages, i]/(1 + sum(X[stages, j] for j in solutes))    for i in solutes
  eq gas_out.x[carrier] = G/gas_out.F
  eq liquid_out.x[solvent] = L/liquid_out.F
  eq gas_out.x[solvent]    = 0
  eq liquid_out.x[carrier] = 0
}
