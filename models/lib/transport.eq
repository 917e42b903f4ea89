# Viscosity and thermal conductivity of gases at low pressure.
#
# Source: DIPPR correlation 102 with the coefficients of R. H. Perry and D. W. Green, Perry's Chemical Engineers' Handbook, 8th
# edition (2008), tables 2-312 and 2-314; W. Sutherland, Phil. Mag. 36 (1893) 507.
# Accuracy: viscosities 5 %, conductivities 6 %.
# Range: `viscosity_low` to `viscosity_high`, `conductivity_low` to `conductivity_high`; some bar at most. Outside of it the
# equations extrapolate without a warning (validity.eq).

use "lib/dippr.eq"

table over transport_gases {
  columns: viscosity_A [1], viscosity_B [1], viscosity_C [1], viscosity_D [1], viscosity_low [K], viscosity_high [K], conductivity_A [1], conductivity_B [1], conductivity_C [1], conductivity_D [1], conductivity_low [K], conductivity_high [K]
  air:               1.425e-6,  0.5039,  108.3,  0,   80,     2000,    0.00031417, 0.7786,  -0.7116, 2121.7,   70,     2000
  nitrogen:          6.5592e-7, 0.6081,  54.714, 0,   63.15,  1970,    0.00033143, 0.7722,  16.323,  373.72,   63.15,  2000
  oxygen:            1.101e-6,  0.5634,  96.3,   0,   54.35,  1500,    0.00044994, 0.7456,  56.699,  0,        80,     2000
  hydrogen:          1.797e-7,  0.685,   -0.59,  140, 13.95,  3000,    0.002653,   0.7452,  12,      0,        22,     1600
  helium:            3.253e-7,  0.7162,  -9.6,   107, 20,     2000,    0.00226,    0.7305,  -18.63,  440,      30,     2000
  argon:             9.2121e-7, 0.60529, 83.24,  0,   83.78,  3273.1,  0.000633,   0.6221,  70,      0,        90,     3273.1
  carbon_monoxide:   1.1127e-6, 0.5338,  94.7,   0,   68.15,  1250,    0.00059882, 0.6863,  57.13,   501.92,   70,     1500
  carbon_dioxide:    2.148e-6,  0.46,    290,    0,   194.67, 1500,    3.69,       -0.3838, 964,     1860000,  194.67, 1500
  water:             1.7096e-8, 1.1146,  0,      0,   273.16, 1073.15, 6.2041e-6,  1.3973,  0,       0,        273.16, 1073.15
  methane:           5.2546e-7, 0.59006, 105.67, 0,   90.69,  1000,    8.3983e-6,  1.4268,  -49.654, 0,        111.63, 600
  ethane:            2.5906e-7, 0.67988, 98.902, 0,   90.35,  1000,    7.3869e-5,  1.1689,  500.73,  0,        184.55, 1000
  propane:           4.9054e-8, 0.90125, 0,      0,   85.47,  1000,    -1.12,      0.10972, -9834.6, -7535800, 231.11, 1000
  ethylene:          2.0789e-6, 0.4163,  352.7,  0,   169.41, 1000,    8.6806e-6,  1.4559,  299.72,  -29403,   170,    590.92
  ammonia:           4.1855e-8, 0.9806,  30.8,   0,   195.41, 1000,    9.6608e-6,  1.3799,  0,       0,        200,    900
  sulfur_dioxide:    6.863e-7,  0.6112,  217,    0,   197.67, 1000,    10.527,     -0.7732, -1333,   1506400,  250,    900
  hydrogen_chloride: 4.924e-7,  0.6702,  157.7,  0,   200,    1000,    0.001865,   0.49755, 358,     0,        190,    700
  chlorine:          2.6e-7,    0.7423,  98.3,   0,   200,    1000,    0.0009993,  0.5472,  458.6,   0,        200,    1000
  hydrogen_sulfide:  3.9314e-8, 1.0134,  0,      0,   250,    480,     1.381e-7,   1.8379,  -352.09, 46041,    212.8,  600
}

def gas_viscosity(i in transport_gases, T) = dippr_102(T, viscosity_A[i], viscosity_B[i], viscosity_C[i], viscosity_D[i]) as [Pa s]
def gas_conductivity(i in transport_gases, T) = dippr_102(T, conductivity_A[i], conductivity_B[i], conductivity_C[i], conductivity_D[i]) as [W/(m K)]
# From the viscosity at a temperature T_0 and the constant of the gas; air: sutherland(T, 17.16 [uPa s], 273.15 [K], 110.4 [K]).
def sutherland(T, mu_0, T_0, S) = mu_0*(T/T_0)^1.5*(T_0 + S)/(T + S)
