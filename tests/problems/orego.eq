model OREGO "Oregonator: the Belousov-Zhabotinskii reaction, three variables, a stiff limit cycle"

# R. J. Field, R. M. Noyes, Journal of Chemical Physics 60 (1974) 1877-1884; problem OREGO of E. Hairer, G. Wanner, Solving Ordinary
# Differential Equations II, and of the Test Set for Initial Value Problem Solvers. Reference values at t = 360:
# y1 = 1.000814870318523, y2 = 1228.178521549917, y3 = 132.0554942846706.

state y1 = 1 scale 1
state y2 = 2 scale 1
state y3 = 3 scale 1

eq d/dt y1 * 1 [s] = 77.27 * (y2 + y1*(1 - 8.375e-6*y1 - y2))
eq d/dt y2 * 1 [s] = (y3 - (1 + y1)*y2) / 77.27
eq d/dt y3 * 1 [s] = 0.161 * (y1 - y3)

observe y1 in 0..2e5, y2 in 0..2e5, y3 in 0..2e5

episode { step = 360 [s], max_steps = 1 }
solver  { rtol = 1e-10 }
