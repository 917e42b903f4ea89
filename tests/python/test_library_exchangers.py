"""Heat exchangers of the library, against SciPy and closed forms."""

import math

import numpy as np
import pytest

import smpl
from plants import difference, rest

# The library compiles without warnings.
pytestmark = pytest.mark.filterwarnings("error::smpl.CompileWarning")

END = "solver { rtol = 1e-9, atol_factor = 1e-3 }\n"

EXCHANGERS = """
model Exchangers "a lumped and a distributed exchanger in series on the hot side"
time t : h
unit amount = 1 [mol]
set species = { A }
use "lib/heat_exchangers.eq"
action Q : m^3/h = 2 in 1..3
use LumpedExchanger as one(UA = 2 [kW/K], V_hot = 0.05 [m^3], rho_cp_c = 2000)
use CountercurrentExchanger as two(cells = 30, UA = 4 [kW/K], V_hot = 0.05 [m^3], rho_cp_c = 2000)
eq one.hot_in.Q = Q
eq one.hot_in.c[A] = 7 [mol/m^3]
eq one.hot_in.T = 90 [degC]
eq one.cold_in.Q = 4 [m^3/h]
eq one.cold_in.c[A] = 0
eq one.cold_in.T = 20 [degC]
connect one.hot_out -> two.hot_in
eq two.cold_in.Q = 3 [m^3/h]
eq two.cold_in.c[A] = 0
eq two.cold_in.T = 10 [degC]
observe two.hot_out.T in 0..100
episode { step = 0.02 [h], max_steps = 100 }
"""


def exchangers(x, u):
    hot, cold, pairs = x[0], x[1], x[2:].reshape(30, 2)
    H, C = pairs[:, 0], pairs[:, 1]
    duty = 2 * (hot - cold) * 3600
    passed = 4 * (H - C) * 3600
    H_in, C_in = np.concatenate([[hot + 273.15], H[:-1]]), np.concatenate([C[1:], [283.15]])
    return np.concatenate([
        [u[0] * (90 - hot) / 0.05 - duty / (4180 * 0.05), 4 * (20 - cold) / 0.1 + duty / (2000 * 0.1)],
        np.column_stack([
            u[0] / 0.05 * (H_in - H) * 30 - passed / (4180 * 0.05), 3 / 0.1 * (C_in - C) * 30 + passed / (2000 * 0.1)
        ]).ravel(),
    ])  # fmt: skip


def test_heat_exchangers_follow_their_balances():
    model = smpl.compile(source=EXCHANGERS + END)
    actions = np.repeat([[2.0], [3.0], [1.2]], 10, axis=0)
    assert difference(model, exchangers, rest(model), actions, 0.02) < 1e-6


def test_fine_countercurrent_exchanger_has_the_effectiveness_of_the_closed_form():
    source = EXCHANGERS.replace("cells = 30", "cells = 400")
    model = smpl.compile(source=source + END)
    run = model.rollout(rest(model), np.full((60, 1), 2.0), outputs=True)
    values = dict(zip(model.algebraic_names, run.outputs[0, -1], strict=True))
    C_h, C_c, T_h = 2 * 4180 / 3600, 3 * 2000 / 3600, run.states[0, -1, 0]
    r, n = C_c / C_h, 4 / C_c
    share = (1 - math.exp(-n * (1 - r))) / (1 - r * math.exp(-n * (1 - r)))
    assert values["two.duty"] == pytest.approx(share * C_c * (T_h - 10), rel=5e-3)
    assert C_h * (T_h - values["two.hot_out.T"]) == pytest.approx(values["two.duty"], rel=1e-6)


def test_fine_cocurrent_exchanger_has_the_effectiveness_of_the_closed_form():
    source = EXCHANGERS.replace("cells = 30", "cells = 400").replace("Countercurrent", "Cocurrent")
    model = smpl.compile(source=source + END)
    run = model.rollout(rest(model), np.full((60, 1), 2.0), outputs=True)
    values = dict(zip(model.algebraic_names, run.outputs[0, -1], strict=True))
    C_h, C_c, T_h = 2 * 4180 / 3600, 3 * 2000 / 3600, run.states[0, -1, 0]
    r, n = C_c / C_h, 4 / C_c
    share = (1 - math.exp(-n * (1 + r))) / (1 + r)
    assert values["two.duty"] == pytest.approx(share * C_c * (T_h - 10), rel=5e-3)
