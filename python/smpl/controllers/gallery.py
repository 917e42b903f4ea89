"""Baselines of the gallery: decentralised loops, `pid`, and the recipes of batches, `recipe`.

Gains are in the units of the action over those of the measurement, times in the model's unit of
time. Set-points that move are observed as errors, of which the set-point is 0.
"""

from __future__ import annotations

from collections.abc import Callable

from smpl.controllers.pid import PID, Loops


def _tennessee_eastman() -> Loops:
    return Loops(
        PID("T_reactor", "u[reactor_cw]", -5, 0.5, set_point=120.4),
        PID("p_reactor", "u[purge]", -0.1, 20, set_point=2705),
        PID("L_reactor", "u[E_feed]", 0.5, 5, set_point=75),
        PID("L_sep", "u[underflow]", -0.5, set_point=50),
        PID("L_strip", "u[product]", -0.5, set_point=50),
    )


def _bsm1() -> Loops:
    """Loops of the benchmark; less oxygen than its 2 g/m3 costs less here."""
    return Loops(
        PID("tank[5].c[S_O]", "kLa5", 25, 0.05, set_point=0.7),
        PID("tank[2].c[S_NO]", "Q_a", 10000, 0.1, set_point=1),
    )


def _four_tanks() -> Loops:
    """Loops of Johansson 2000 for the minimum phase."""
    return Loops(PID("e_1", "v_1", -3, 30, set_point=0), PID("e_2", "v_2", -2.7, 40, set_point=0))


def _van_de_vusse() -> Loops:
    return Loops(PID("e", "f", -10, 0.05, set_point=0), PID("T", "Q_K", 500, 0.05))


def _williams_otto() -> Loops:
    return Loops(PID("X_A", "F_B", -20, 600, set_point=0.0875), PID("X_G", "T_R", 50, 600, set_point=0.1075))


def _column_a() -> Loops:
    return Loops(PID("x_D", "L", 26.1, 3.76, set_point=0.99), PID("x_B", "V", -37.5, 3.31, set_point=0.01))


def _ph_neutralisation() -> Loops:
    return Loops(PID("pH", "q_3", 5, 60, set_point=7), PID("h", "q_1", 0.5, 400, set_point=14))


def _evaporator() -> Loops:
    return Loops(
        PID("L_2", "F_2", -8, 20, set_point=1),
        PID("X_2", "P_100", 4, 20, set_point=25),
        PID("P_2", "F_200", -100, 10, set_point=50.5),
    )


def _first_order() -> Loops:
    return Loops(PID("e", "u", -2, 0.5, set_point=0))


def _second_order() -> Loops:
    return Loops(PID("e", "u", -20, 1.5, 0.3, set_point=0))


def _cstr() -> Loops:
    return Loops(PID("e", "T_c", 40, 0.8, set_point=0))


def _extraction() -> Loops:
    return Loops(PID("e", "L", -200, 0.3, set_point=0))


def _reactive_extraction() -> Loops:
    return Loops(PID("X[5]", "L", 0.03, 60))


def _reactor_separator() -> Loops:
    return Loops(
        PID("H_R", "F_R", -2, 100, set_point=1.5),
        PID("H_M", "F_M", -2, 100, set_point=1.5),
        PID("H_B", "P", -1, 100, set_point=1.5),
        PID("x_B[B]", "D", 2, 30),
    )


def _recycle_cascade() -> Loops:
    return Loops(PID("C_2", "T_c2", -1, 60))


def _distillation() -> Loops:
    return Loops(PID("x_D", "R", 60, 20))


def _heat_exchanger() -> Loops:
    return Loops(PID("T_t[8]", "F_s", -1, 10))


def _biofilm() -> Loops:
    return Loops(PID("S_1[4]", "F", 0.4, 10))


def _polymerisation() -> Loops:
    return Loops(PID("T", "T_f", 0.5, 60), PID("M", "F", 3, 60))


def _bioreactor() -> Loops:
    return Loops(PID("e", "D", 0.02, 10, set_point=0))


def _mma() -> Loops:
    return Loops(PID("e", "F_I", 7e-7, 0.1, set_point=0))


def _crystalliser() -> Loops:
    return Loops(PID("y", "u", 2, 10))


def _boiler_drum() -> Loops:
    return Loops(
        PID("P", "u_1", 0.02, 100, set_point=108),
        PID("e", "u_2", -0.005, 20, set_point=0),
        PID("L", "u_3", 0.3, 200, set_point=0),
    )


def _glucose_insulin() -> Loops:
    return Loops(PID("G", "U", -0.5, 200, 30, set_point=4.5))


def _lithium_ion() -> Loops:
    return Loops(PID("soc", "I", -20, set_point=0.9))


def _xylene_bed() -> Loops:
    return Loops(PID("T_hot", "T_w", 0.1, 200, set_point=678))


def _chylla_haase() -> Loops:
    return Loops(PID("T", "c", 10, 10, 2, set_point=355.382))


def _exchanger_network() -> Loops:
    return Loops(
        PID("T_c", "b_3", -0.03, 3),
        PID("T_h2", "b_1", 0.003, 1),
    )


LOOPS: dict[str, Callable[[], Loops]] = {
    "tennessee_eastman": _tennessee_eastman,
    "bsm1": _bsm1,
    "four_tanks": _four_tanks,
    "van_de_vusse": _van_de_vusse,
    "williams_otto": _williams_otto,
    "column_a": _column_a,
    "ph_neutralisation": _ph_neutralisation,
    "evaporator": _evaporator,
    "first_order": _first_order,
    "second_order": _second_order,
    "cstr": _cstr,
    "extraction": _extraction,
    "reactive_extraction": _reactive_extraction,
    "reactor_separator": _reactor_separator,
    "recycle_cascade": _recycle_cascade,
    "distillation": _distillation,
    "heat_exchanger": _heat_exchanger,
    "biofilm": _biofilm,
    "polymerisation": _polymerisation,
    "bioreactor": _bioreactor,
    "mma": _mma,
    "crystalliser": _crystalliser,
    "boiler_drum": _boiler_drum,
    "glucose_insulin": _glucose_insulin,
    "lithium_ion": _lithium_ion,
    "xylene_bed": _xylene_bed,
    "chylla_haase": _chylla_haase,
    "exchanger_network": _exchanger_network,
}

# Batches, which declare a policy `recipe`.
RECIPES = ("potassium_sulfate", "bakers_yeast")
