# Retention of cells: centrifuge, settler or hollow fibre between a bioreactor and its harvest. Streams are those of streams.eq.
#
# Perfusion: reactor -> retention, harvest by `permeate`, `retentate` back to the reactor with fresh medium through a Mixer.
# The model declares `table retained[species] : 1`, the share of each species that stays in the retentate, and sets permeate.Q.
# Source: balances; S. Pirt, Principles of Microbe and Cell Cultivation (1975), continuous culture with feedback of biomass.
# Range: no holdup, permeate below the inlet; retained species are dilute.

use "lib/streams.eq"

component Retention "cells stay in the retentate, medium passes; the model sets permeate.Q" {
  port inlet, permeate, retentate : Stream
  eq retentate.Q    = inlet.Q - permeate.Q
  eq permeate.c[i]  = (1 - retained[i])*inlet.c[i]                                   for i in species
  eq retentate.c[i] = (inlet.Q*inlet.c[i] - permeate.Q*permeate.c[i])/retentate.Q    for i in species
  eq permeate.T     = inlet.T
  eq retentate.T    = inlet.T
}
