model MAbPlant "Monoclonal antibody, integrated: culture, two capture columns in turn, virus inactivation, two polishing steps"

# J. Gomis-Fons et al. (2020) for the downstream chain and its parameters.

time t : min

choice chain = integrated | legacy    "the plant, or the four separate phases of the original"

when chain = legacy { use "lib/separate_phases.eq" }

when chain = integrated {
  use "lib/culture.eq"
  use "lib/chromatography.eq"
  use "lib/integrated_plant.eq"
}

variant wide_boxes "boxes of two actions as wide as the sensitivities that were worked out" {
  action c_s_elu : M = 0.1  in 0.01..0.9    "modifier that elutes Protein A"
  action V_flush : L = 750  in 250..3000    "volume that flushes the virus inactivation loop"
}
