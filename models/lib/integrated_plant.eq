# The integrated plant: culture, two capture columns in turn, virus inactivation, two polishing steps.

# ---- Actions beside those of the culture: the last five are taken when the columns swap ----

action switch       = 0    in 0..1         "swap the columns and start a batch, when at least one half"
action c_s_elu  : M = 0.1  in 0.03..0.9    "modifier that elutes Protein A"
action c_s_load : M = 0.1  in 0.05..0.4    "modifier at which the cation exchanger is loaded"
action c_s_cex  : M = 0.5  in 0.2..0.9     "modifier that elutes the cation exchanger"
action V_elu    : L = 300  in 150..450     "volume of the elution of Protein A"
action V_flush  : L = 750  in 250..1000    "volume that flushes the virus inactivation loop"

# ---- Units ----

use AffinityColumn as col[k in 1..2]
use Bed as VI(L = 60 [dm], V = 500 [L], D_v = 0.29 [dm], n_z = 60)    # virus inactivation
use LumpedColumn as CEX(L = 1 [dm], V = 50 [L], D_v = 0.011 [dm], eps = 0.34, q_max = 150200 [mg/L], k = 0.99 [1/min],
                        H_0 = 6.9e-4, beta = 8.5, c_s_floor = 0.09 [M], n_z = 100)
use Bed as LOOP(L = 60 [dm], V = 500 [L], D_v = 0.29 [dm], n_z = 60)    # conditioning
use Bed as AEX(L = 1 [dm], V = 50 [L], D_v = 0.016 [dm], eps = 0.34, n_z = 40)

# ---- Schedule of one batch ----

param CV     : L   = 100    "volume of a capture column"
param CV_cex : L   = 50     "volume of the cation exchanger"
param t_hold : min = 45     "virus inactivation beyond the strip, while the column is equilibrated"
param V_cut  : L   = 60     "first cut of the elution, to waste; 0.6 column volumes"
param V_out  : L   = 800    "volume that flushes the conditioning loop, 1.6 loops"

phase idle until requested == 1 then wash {
  next loading      = 3 - loading    # the columns swap
  next c_s_elu_set  = c_s_elu
  next c_s_load_set = c_s_load
  next c_s_cex_set  = c_s_cex
  next V_elu_set    = V_elu
  next V_flush_set  = V_flush
  next m_fed_swap   = m_fed
}
phase wash for 3*CV / Q_capture[wash] then cut
phase cut for V_cut / Q_capture[cut] then elute    # what stands in the bed, to waste
phase elute for V_elu_set / Q_capture[elute] then strip
phase strip for 3*CV / Q_capture[strip] then hold
phase hold for t_hold then load_cex
phase load_cex for V_flush_set / Q_vi[load_cex] then wash_cex
phase wash_cex for 3*CV_cex / Q_cex[wash_cex] then elute_cex
phase elute_cex for 3*CV_cex / Q_cex[elute_cex] then flush
phase flush for V_out / Q_loop[flush] then idle { next m_fed_done = m_fed_swap }

table over phase {
  columns: Q_capture [L/min], Q_vi [L/min], Q_cex [L/min], Q_loop [L/min]
  idle:      0,      0,    0,    0
  wash:      21.689, 0,    0,    0
  cut:       20,     0,    0,    0
  elute:     20,     20,   20,   0
  strip:     20,     0,    0,    0
  hold:      21.689, 0,    0,    0
  load_cex:  0,      14.4, 14.4, 0
  wash_cex:  0,      0,    14.4, 0
  elute_cex: 0,      0,    7.27, 7.27
  flush:     0,      0,    14.4, 28.8
}

discrete loading           = 1    in 1..2    "column that is loaded"
discrete requested         = 0    in 0..1    "a swap is asked for and the train is free"
discrete refused           = 0               "requests refused, since the train was busy"
discrete c_s_elu_set  : M  = 0.1             "taken at the swap"
discrete c_s_load_set : M  = 0.1             "taken at the swap"
discrete c_s_cex_set  : M  = 0.5             "taken at the swap"
discrete V_elu_set    : L  = 300             "taken at the swap"
discrete V_flush_set  : L  = 750             "taken at the swap"
discrete m_fed_swap   : mg = 0               "antibody fed until the last swap"
discrete m_fed_done   : mg = 0               "antibody fed to the columns whose batches are finished"

at start {
  next requested = if switch >= 0.5 and phase == idle then 1 else 0
  next refused   = if switch >= 0.5 and phase != idle then refused + 1 else refused
}

# ---- Pipes: what is loaded gets the feed, the other column and the train what the phase says ----

let eluting        = phase == cut or phase == elute or phase == strip
let c_eluate       = if loading == 1 then col[2].outlet.c else col[1].outlet.c
let c_breakthrough = if loading == 1 then col[1].outlet.c else col[2].outlet.c

eq col[k].inlet.Q   = if k == loading then F_out else Q_capture[phase]       for k in 1..2
eq col[k].inlet.c   = if k == loading then c_buf else 0                      for k in 1..2
eq col[k].inlet.c_s = if k != loading and eluting then c_s_elu_set else 0    for k in 1..2
eq col[k].inlet.c_t = if k == loading then tracer_fed*c_buf else 0           for k in 1..2
eq col[k].eluting   = if k != loading and eluting then 1 else 0              for k in 1..2

eq VI.inlet.Q   = Q_vi[phase]
eq VI.inlet.c   = if phase == elute then c_eluate else 0
eq VI.inlet.c_s = if phase == elute then (if loading == 1 then col[2].outlet.c_s else col[1].outlet.c_s) else 0
eq VI.inlet.c_t = if phase == elute then (if loading == 1 then col[2].outlet.c_t else col[1].outlet.c_t) else 0

eq CEX.inlet.Q   = Q_cex[phase]
eq CEX.inlet.c   = if phase == elute or phase == load_cex then VI.outlet.c else 0
eq CEX.inlet.c_t = if phase == elute or phase == load_cex then VI.outlet.c_t else 0
eq CEX.inlet.c_s = if phase == elute_cex then c_s_cex_set else c_s_load_set    # ideal in-line conditioning

eq LOOP.inlet.Q   = Q_loop[phase]
eq LOOP.inlet.c   = if phase == elute_cex then CEX.outlet.c else 0
eq LOOP.inlet.c_t = if phase == elute_cex then CEX.outlet.c_t else 0
eq LOOP.inlet.c_s = if phase == elute_cex then CEX.outlet.c_s else 0
connect LOOP.outlet -> AEX.inlet

# ---- Books ----

set losses = { breakthrough, wash_off, strip_off, cex_off }

state m_fed          : mg  = 0  in 0..inf  scale 1e6    "antibody fed to the columns"
state m_pool         : mg  = 0  in 0..inf  scale 1e6    "antibody in the pool"
state V_pool         : L   = 0  in 0..inf  scale 1e3    "volume of the pool"
state s_pool         : mol = 0  in 0..inf  scale 100    "modifier in the pool"
state m_lost[losses] : mg  = 0  in 0..inf  scale 1e6    "antibody lost: loading, wash with first cut, strip with equilibration, cation exchanger"

eq d/dt m_fed  = F_out*c_buf
eq d/dt m_pool = AEX.outlet.Q*AEX.outlet.c
eq d/dt V_pool = AEX.outlet.Q
eq d/dt s_pool = AEX.outlet.Q*AEX.outlet.c_s
eq d/dt m_lost[breakthrough] = F_out*c_breakthrough
eq d/dt m_lost[wash_off]     = if phase == wash or phase == cut then Q_capture[phase]*c_eluate else 0
eq d/dt m_lost[strip_off]    = if phase == strip or phase == hold then Q_capture[phase]*c_eluate else 0
eq d/dt m_lost[cex_off]      = if phase == elute_cex then 0 else Q_cex[phase]*CEX.outlet.c

let c_pool   : mg/L = if V_pool > 0 then m_pool/V_pool else 0                                  "antibody in the pool"
let c_s_pool : M    = if V_pool > 0 then s_pool/V_pool else 0                                  "modifier in the pool"
let m_held   : mg   = col[1].held + col[2].held + VI.held + CEX.held + LOOP.held + AEX.held    "antibody in the train"

invariant antibody = m_held + m_pool + sum(m_lost[i] for i in losses) - m_fed    "what was fed is held, in the pool or lost"

# A proxy: nothing but a tracer that binds nowhere stands for all impurities.
param tracer_fed = 1 in 0..inf    "tracer in the feed over antibody in it"
when tracer = on {
  state m_tracer : mg = 0 in 0..inf scale 1    "tracer in the pool"
  eq d/dt m_tracer = AEX.outlet.Q*AEX.outlet.c_t
  steady { m_tracer = 0 }
  reward purity = if m_pool > 0 then m_pool/(m_pool + m_tracer) else 0    "antibody in the pool over antibody and tracer"
}

# ---- Control problem ----

param spread              = 0.05  in 0..1    "half width of the initial distribution, relative to the steady state"
param c_s_pool_max : M    = 0.2              "limit of the modifier in the pool"
param c_pool_min   : mg/L = 1000             "limit of the concentration in the pool"

steady {
  V1 = 3000, V2 = 2976.932623327295, h = 15, col = 0, VI = 0, CEX = 0, LOOP = 0, AEX = 0
  m_fed = 0, m_pool = 0, V_pool = 0, s_pool = 0, m_lost = 0
}

initial x ~ value(steady(x)) * uniform(1 - spread, 1 + spread) clip inner_low(x)..inner_high(x)
    for x in (Xv1, Xt1, GLC1, GLN1, LAC1, AMM1, mAb1, V1, Xv2, Xt2, GLC2, GLN2, LAC2, AMM2, mAb2, V2, T, h, c_buf)

observe Xv1, Xt1, GLC1, GLN1, LAC1, AMM1, mAb1, V1, Xv2, Xt2, GLC2, GLN2, LAC2, AMM2, mAb2, V2, T, h, c_buf
observe col[k].held in 0..1e7 for k in 1..2
observe col[k].outlet.c in 0..60 for k in 1..2
observe VI.held in 0..1e7, CEX.held in 0..1e7, LOOP.held in 0..1e7, AEX.held in 0..1e7
observe phase in 1..10, phase_time in 0..12000, loading, m_pool in 0..1e8, V_pool in 0..1e5, c_s_pool in 0..1

level online "volumes, temperature, level of the buffer tank, outlets of the columns by ultraviolet, phase; compositions are hidden" {
  observe V1, V2, T noise normal(0, 0.05), h, c_buf noise normal(0, 1)
  observe col[k].outlet.c in 0..60 noise normal(0, 0.5) for k in 1..2
  observe phase in 1..10, phase_time in 0..12000, loading, V_pool in 0..1e5
}

reward recovered : mg/h default = (m_pool - previous(m_pool)) / step    "product that entered the pool"
reward yield = if m_fed_done > 0 then m_pool/m_fed_done else 0    "pool over feed of finished batches"

fail box when max(excess(x) for x in (Xv1, Xt1, GLC1, GLN1, LAC1, AMM1, mAb1, V1, Xv2, Xt2, GLC2, GLN2, LAC2, AMM2, mAb2, V2,
                                      T, h, c_buf)) > 0    "a tank outside its box"
fail tank_empty event h <= 0.1 [dm]    "the buffer tank has run empty"

constraint vi_hold when t_hold + 3*CV/Q_capture[strip] < 60 [min]    "virus inactivation of at least an hour"
constraint pool_modifier when c_s_pool > c_s_pool_max
constraint swap_refused when refused > previous(refused)    "the train was busy"
constraint pool_dilute when V_pool > 0 and c_pool < c_pool_min

episode { step = 60 [min], max_steps = 200, error_reward = -100 }
solver  { rtol = 1e-6, atol_factor = 1, algebraic_error_control = true }

policy nominal "level of the buffer tank by F_out, a swap every 20 h" {
  F_out = clip(21.689197033088462 + 50/180*(value(h) - 15), value(low(F_out)), value(high(F_out)))
  switch = if mod(n, 20) == 19 then 1 else 0
}
