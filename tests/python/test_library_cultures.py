"""Cell retention, biofilter and distribution of crystals of the library, against SciPy and closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import smpl
from plants import difference, rest

# The library compiles without warnings.
pytestmark = pytest.mark.filterwarnings("error::smpl.CompileWarning")

END = "solver { rtol = 1e-9, atol_factor = 1e-3 }\n"

PERFUSION = """
model Perfusion "perfusion culture with retention of cells"
time t : h
unit amount = 1 [g]
set species = { X, S, P }
table retained[species] : 1 = { X: 0.98, S: 0, P: 0.1 }
use "lib/bioreactor.eq"
use "lib/retention.eq"
action F : L/h = 50 in 0..100
action bleed : L/h = 5 in 0..20
use Bioreactor as B(Y_PX = 0.2)
use Retention as R
use Mixer as M
use Splitter as split
eq M.inlet_1.Q = F
eq M.inlet_1.c[i] = if i == S then 20 [g/L] else 0 for i in species
eq M.inlet_1.T = 37 [degC]
connect M.outlet -> B.inlet
connect B.outlet -> split.inlet
connect split.outlet_2 -> R.inlet
connect R.retentate -> M.inlet_2
eq B.outlet.Q = 300 [L/h]
eq split.share = bleed/(300 [L/h])
eq R.permeate.Q = F - bleed
observe B.c[X] in 0..1e5
episode { step = 0.5 [h], max_steps = 2000 }
"""


def perfusion(x, u):
    V, c = x[0], x[1:]
    F, bleed = u / 1000
    passes = np.array([0.02, 1.0, 0.9])
    back = 0.3 - F
    recycle = ((0.3 - bleed) * c - (F - bleed) * passes * c) / back
    feed = np.array([0, 20e3, 0])
    total = F + back
    s = max(c[1], 0) / 1000
    mu = 0.4 * s / (0.1 + s)
    grows = np.array([mu, -mu / 0.5 - 0.2 * mu, 0.2 * mu]) * c[0]
    inlet = (F * feed + back * recycle) / total
    return np.concatenate([[total - 0.3], total * (inlet - c) / V + grows])


def test_perfusion_with_retention_follows_its_balances():
    model = smpl.compile(source=PERFUSION + END)
    actions = np.repeat([[50.0, 5.0], [80.0, 5.0], [60.0, 15.0]], 20, axis=0)
    assert difference(model, perfusion, rest(model), actions, 0.5) < 1e-6


def test_perfused_culture_rests_at_the_rate_of_its_loss():
    """Growth equals what bleed and permeate carry away: mu V = bleed + 0.02 (F - bleed)."""
    model = smpl.compile(source=PERFUSION + END)
    run = model.rollout(rest(model), np.full((2000, 2), [50.0, 20.0]))
    V, X, S, _ = run.states[0, -1]
    mu = (0.02 + 0.02 * 0.03) / V
    assert pytest.approx(0.1 * mu / (0.4 - mu), rel=1e-6) == S / 1000
    assert pytest.approx(0.05 * (20e3 - S) / (mu * V * (1 / 0.5 + 0.2)), rel=1e-6) == X


FILTER = """
model Filter "biofilter for a gas or a water"
time t : h
unit amount = 1 [g]
set species = { S, other }
use "lib/biofilter.eq"
action Q : m^3/h = 1 in 0..5
use Biofilter as F(cells = 6, layers = 4, m = 0.5, X = X, K_S = K_S)
param X : g/L = 30
param K_S : g/L = 0.01
eq F.inlet.Q = Q
eq F.inlet.c[i] = if i == S then 50 [g/m^3] else 7 [g/m^3] for i in species
eq F.inlet.T = 20 [degC]
observe F.outlet.c[S] in 0..100
episode { step = 0.1 [h], max_steps = 1000 }
"""


def film(x, u, names):
    at = {name: k for k, name in enumerate(names)}
    c = x[[at[f"F.c[S,{z}]"] for z in range(1, 7)]]
    other = x[[at[f"F.c[other,{z}]"] for z in range(1, 7)]]
    s = np.array([[x[at[f"F.s[{z},{y}]"]] for y in range(1, 5)] for z in range(1, 7)])
    D, dy, rate = 1e-9 * 3600, 50e-6, u[0] / 0.5
    into = D * (c / 0.5 - s[:, 0]) / (dy / 2)
    faces = np.column_stack([into, -D * np.diff(s, axis=1) / dy, np.zeros(6)])
    slopes = np.empty_like(x)
    ds = -np.diff(faces, axis=1) / dy - 0.2 * 30e3 * s / (10 + s)
    dc = rate * 6 * (np.concatenate([[50], c[:-1]]) - c) - 200 / 0.5 * into
    do = rate * 6 * (np.concatenate([[7], other[:-1]]) - other)
    for z in range(6):
        slopes[at[f"F.c[S,{z + 1}]"]], slopes[at[f"F.c[other,{z + 1}]"]] = dc[z], do[z]
        for y in range(4):
            slopes[at[f"F.s[{z + 1},{y + 1}]"]] = ds[z, y]
    return slopes


def test_biofilter_follows_its_balances():
    model = smpl.compile(source=FILTER + END)
    names = list(model.state_names)
    actions = np.repeat([[1.0], [3.0], [0.5]], 8, axis=0)
    found = difference(model, lambda x, u: film(x, u, names), rest(model), actions, 0.1, method="BDF", rtol=1e-9)
    assert found < 1e-6


def test_fine_biofilter_has_the_effectiveness_of_a_first_order_film():
    """A large K_S makes the uptake linear: flux = c/m sqrt(k D) tanh(depth sqrt(k/D)), in a row of mixed cells."""
    source = FILTER.replace("layers = 4", "layers = 40")
    model = smpl.compile(source=source + END)
    run = model.rollout(rest(model), np.full((400, 1), 1.0), parameters={"K_S": 1e3, "X": 1e5})
    k, D = 0.2 * 1e5 / 1e3, 1e-9 * 3600
    uptake = 200 / 0.5 * math.sqrt(k * D) * math.tanh(200e-6 * math.sqrt(k / D)) / 0.5
    assert 2 < uptake < 4
    assert run.observations[0, -1, 0] == pytest.approx(50 * (1 + uptake / (6 * 2)) ** -6, rel=2e-3)


POPULATION = """
model Crystals "distribution of sizes in batch and continuous operation"
time t : h
unit amount = 1 [kg]
set species = { solute }
use "lib/crystalliser.eq"
action T : degC = 40 in 0..100
action Q : m^3/h = 0 in 0..1
use PopulationCrystalliser as C(cells = 30)
eq C.inlet.Q = Q
eq C.outlet.Q = Q
eq C.inlet.c[solute] = 110 [kg/m^3]
eq C.inlet.T = 60 [degC]
eq C.c_sat = (60 + value(T)) as [kg/m^3]
initial C.c[solute] = 115
observe C.m_0 in 0..1e12, C.m_3 in 0..10
episode { step = 0.1 [h], max_steps = 1000 }
"""


def population(x, u, cells):
    """Solution and cells of a distribution up to 1000 um, in um, with van Leer's limiter."""
    c, N = x[0], x[1:]
    width = 1000 / cells
    size = (np.arange(cells) + 0.5) * width * 1e-6
    sigma = max(c / (60 + u[0]) - 1, 0)
    G, B = 3600e6 * 1e-7 * sigma**1.5, 3600 * 1e8 * sigma**2
    faces = np.concatenate([[B], G * N])
    up, down = np.diff(N)[:-1], np.diff(N)[1:]
    product = up * down
    faces[2:-1] += G * np.where(product > 0, product / np.where(product > 0, up + down, 1), 0)
    eats = 3 * 2000 * 0.5 * G * 1e-6 * (N * size**2).sum() * width
    return np.concatenate([[u[1] * (110 - c) - eats], -np.diff(faces) / width - u[1] * N])


def test_distribution_of_crystals_follows_its_balance():
    model = smpl.compile(source=POPULATION + END.replace("{", "{ method = rosenbrock,"))
    actions = np.repeat([[40.0, 0.0], [30.0, 0.0], [30.0, 0.5]], 10, axis=0)
    start = rest(model)
    assert list(model.state_names[:2]) == ["C.c[solute]", "C.N[1]"]
    assert difference(model, lambda x, u: population(x, u, 30), start, actions, 0.1) < 1e-6


def test_distribution_of_crystals_by_ida_is_as_near_as_its_tolerance():
    """Cells are compared with the largest one: empty ones lie far below their absolute tolerances."""
    model = smpl.compile(source=POPULATION + END)
    actions = np.repeat([[40.0, 0.0], [30.0, 0.0], [30.0, 0.5]], 10, axis=0)
    x = start = rest(model)
    states = model.rollout(start, actions).states[0]
    for action, found in zip(actions, states[1:], strict=True):
        x = solve_ivp(
            lambda _, x, u=action: population(x, u, 30), (0, 0.1), x, "Radau", rtol=1e-11, atol=1e-12 * x.max()
        ).y[:, -1]
        assert found[0] == pytest.approx(x[0], rel=1e-9)
        assert found[1:] == pytest.approx(x[1:], abs=2e-8 * x[1:].max())


def test_distribution_approaches_the_moments_of_the_other_component():
    """A batch that does not reach the largest size: 400 cells deviate by less than 0.2 %, half as much as 200."""

    def end(text):
        model = smpl.compile(source=POPULATION.replace("PopulationCrystalliser as C(cells = 30)", text) + END)
        return model.rollout(rest(model), np.full((100, 2), [40.0, 0.0])).observations[0, -1]

    exact = end("Crystalliser as C")
    coarse, fine = (end(f"PopulationCrystalliser as C(cells = {n}, L_max = 500 [um])") / exact - 1 for n in (200, 400))
    assert np.all(np.abs(fine) < 2e-3)
    assert np.all(np.abs(fine) < 0.5 * np.abs(coarse))


def test_continuous_distribution_rests_at_the_exponential_of_randolph_and_larson():
    """Population density B/G exp(-D L/G) of a mixed crystalliser with product removal."""
    text = POPULATION.replace("cells = 30", "cells = 200, L_max = 200 [um]")
    model = smpl.compile(source=text + END)
    run = model.rollout(rest(model), np.full((600, 2), [40.0, 1.0]))
    c, *N = run.states[0, -1]
    sigma = c / 100 - 1
    G, B = 3600e6 * 1e-7 * sigma**1.5, 3600 * 1e8 * sigma**2
    size = np.arange(200) + 0.5
    exact = B / G * np.exp(-size / G)
    seen = slice(2, 80)
    assert np.array(N)[seen] == pytest.approx(exact[seen], rel=0.02)
