"""Right-hand side of the Tennessee Eastman process in the units of teprob.f: lb-mol, Btu, mmHg, h.

Components are A to H; streams have the numbers of the paper.
Written from Downs and Vogel (1993) and their program.
"""

import numpy as np
from scipy.optimize import brentq

LB, BTU = 0.454, 1000 * 0.454 / 1.8  # kmol in a lb-mol, Mcal in a million Btu
MASS = np.array([2.0, 25.4, 28, 32, 46, 48, 62, 76])
LIQUID = 1e-6 * np.array(
    [
        [1.0, 1.0, 1.0, 0.960, 0.573, 0.652, 0.515, 0.471],
        [0, 0, 0, 8.70e-3, 2.41e-3, 2.18e-3, 5.65e-4, 8.70e-4],
        [0, 0, 0, 4.81e-5, 1.82e-5, 1.94e-5, 3.82e-6, 2.62e-6],
    ]
)
GAS = 1e-6 * np.array(
    [
        [3.411, 0.3799, 0.2491, 0.3567, 0.3463, 0.3930, 0.170, 0.150],
        [7.18e-4, 1.08e-3, 1.36e-5, 8.51e-4, 8.96e-4, 1.02e-3, 0, 0],
        [6e-7, -3.98e-7, -3.93e-8, -3.12e-7, -3.27e-7, -3.12e-7, 0, 0],
    ]
)
EVAPORATION = 1e-6 * np.array([1, 1, 1, 86.7, 160, 160, 225, 209])
DENSITY = np.array(
    [
        [1.0, 1.0, 1.0, 23.3, 33.9, 32.8, 49.9, 50.5],
        [0, 0, 0, -0.07, -0.0957, -0.0995, -0.0191, -0.0541],
        [0, 0, 0, -0.0002, -0.000152, -0.000233, -0.000425, -0.00015],
    ]
)
ANTOINE = np.array(
    [[15.92, 16.35, 16.35, 16.43, 17.21], [-1444, -2114, -2114, -2748, -3318], [259, 265.5, 265.5, 232.9, 249.6]]
)
DRIVES = np.array([8, 8, 6, 9, 7, 5, 5, 5, 120, 5, 5, 5]) / 3600
FEEDS = np.array(
    [
        [0, 1e-4, 0, 0.9999, 0, 0, 0, 0],
        [0, 0, 0, 0, 0.9999, 1e-4, 0, 0],
        [0.9999, 1e-4, 0, 0, 0, 0, 0, 0],
        [0.485, 0.005, 0.51, 0, 0, 0, 0, 0],
    ]
)


def enthalpy(z, T, c=GAS, heat=EVAPORATION):
    """Million Btu per lb-mol of a mixture at T degC."""
    return (z * MASS * (1.8 * T * (c[0] + c[1] * T / 2 + c[2] * T**2 / 3) + heat)).sum()


def liquid(z, T):
    return enthalpy(z, T, LIQUID, 0.0)


def density(z, T):
    """Lb-mol per cubic foot."""
    return 1 / (z * MASS / (DENSITY[0] + (DENSITY[1] + DENSITY[2] * T) * T)).sum()


def temperature(value, of):
    return brentq(lambda T: of(T) - value, -20, 300, xtol=1e-13, rtol=1e-15)


def drum(n, energy, volume):
    """Temperature, pressure, vapour and liquid of a vessel in which A, B, C are gases."""
    x = np.r_[0, 0, 0, n[3:]] / n[3:].sum()
    T = temperature(energy / n[3:].sum(), lambda at: liquid(x, at))
    level = n[3:].sum() / density(x, T)
    p = np.r_[
        n[:3] * 998.9 * (T + 273.15) / (volume - level),
        x[3:] * np.exp(ANTOINE[0] + ANTOINE[1] / (T + ANTOINE[2])),
    ]
    return T, p, p / p.sum(), x, level


def reactions(p, T, vapour):
    """Rates of the four reactions, lb-mol/h."""
    K = T + 273.15
    k1, k2, k3 = np.exp(np.array([31.5859536, 3.00094014, 53.4060443]) - np.array([4e4, 2e4, 6e4]) / 1.987 / K)
    common = p[0] ** 1.1544 * p[2] ** 0.3735
    return vapour * np.array([k1 * common * p[3], k2 * common * p[4], k3 * p[0] * p[4], 0.767488334 * k3 * p[0] * p[3]])


def rates(reactor, separator, stripper, mixing, water, valves, commands):
    """Derivatives; vessels are eight holdups and an energy, water both coolant outlets in degC."""
    T_r, p_r, y_r, _, V_r = drum(reactor[:8], reactor[8], 1300)
    T_s, p_s, y_s, x_s, _ = drum(separator[:8], separator[8], 3500)
    x_c = stripper[:8] / stripper[:8].sum()
    T_c = temperature(stripper[8] / stripper[:8].sum(), lambda at: liquid(x_c, at))
    y_v = mixing[:8] / mixing[:8].sum()
    T_v = temperature(mixing[8] / mixing[:8].sum(), lambda at: enthalpy(y_v, at) - 3.57696e-6 * (at + 273.15))
    p_v = mixing[:8].sum() * 998.9 * (T_v + 273.15) / 5000

    feed = valves[:4] * [4, 4, 1, 15]
    f6 = 1937.6 * np.sqrt(p_v - p_r.sum()) / (MASS * y_v).sum()
    f7 = 4574.21 * np.sqrt(p_r.sum() - p_s.sum()) / (MASS * y_r).sum()
    mass_s = (MASS * y_s).sum()
    f9 = valves[5] * 0.151169 * np.sqrt(p_s.sum() - 760) / mass_s
    ratio = np.clip(p_v / p_s.sum(), 1, 1.3)
    compressed = 280275 * (1 + (1 - ratio**3) / 1.197)
    work = compressed * (T_s + 273.15) * 1.8e-6 * 1.9872 * (p_v - p_s.sum()) / (mass_s * p_s.sum())
    f8 = max(compressed - valves[4] * 53.349 * np.sqrt(p_v - p_s.sum()), 1e-3) / mass_s
    f10, f11 = valves[6] * 15, valves[7] * 10

    factor = 363.744 / (177 - T_c) - 2.22579488
    lift = np.array([8.5010, 11.402, 11.795, 0.0480, 0.0242]) * feed[3] / f10 * factor
    share = np.r_[0.995, 0.991, 0.99, lift / (1 + lift)]
    entering = feed[3] * FEEDS[3] + f10 * x_s
    f5 = share * entering

    covered = np.clip(0.025 * V_r / 7.8 - 0.25, 0, 1)
    stir = (valves[11] + 150) / 100
    to_water = covered * (-0.5 * stir**2 + 2.75 * stir - 2.5) * 0.855490 * (T_r - water[0])
    condensed = 0.404655 * (1 - 1 / (1 + (f7 / 3528.73) ** 4)) * (T_r - water[1])
    steam = valves[8] / 100 * 0.03 * (100 - T_c) if T_c < 100 else 0.0

    r1, r2, r3, r4 = reactions(p_r, T_r, 1300 - V_r)
    made = np.array([-r1 - r2 - r3, 0, -r1 - r2, -r1 - 1.5 * r4, -r2 - r3, r3 + r4, r1, r2])
    h_s, h5 = enthalpy(y_s, T_s), enthalpy(f5 / f5.sum(), T_c)
    h_in = [enthalpy(z, 45) for z in FEEDS]
    out_r, in_r = f7 * enthalpy(y_r, T_r), f6 * enthalpy(y_v, T_v)
    return (
        np.r_[f6 * y_v - f7 * y_r + made, in_r - out_r + 0.06899381054 * r1 + 0.05 * r2 - to_water],
        np.r_[
            f7 * y_r - (f8 + f9) * y_s - f10 * x_s,
            out_r - (f8 + f9) * h_s - work - f10 * liquid(x_s, T_s) - condensed,
        ],
        np.r_[
            entering - f5 - f11 * x_c,
            feed[3] * h_in[3] + f10 * liquid(x_s, T_s) - f5.sum() * h5 - f11 * liquid(x_c, T_c) + steam,
        ],
        np.r_[
            feed[:3] @ FEEDS[:3] + f5 + f8 * y_s - f6 * y_v,
            feed[:3] @ h_in[:3] + f5.sum() * h5 + f8 * h_s + work - in_r,
        ],
        np.array(
            [
                (valves[9] * 10 * 500.53 * (35 - water[0]) + to_water * 1e6 / 1.8) / 7060,
                (valves[10] * 12 * 500.53 * (40 - water[1]) + condensed * 1e6 / 1.8) / 11138,
            ]
        ),
        (commands - valves) / DRIVES,
    )
