"""Fluxes against the direction of the index: closed forms, and finite volumes in NumPy with SciPy's integrator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import smpl

EXCHANGER = """
model Exchanger
time t : s
param U  : 1/s = 1.3    "heat transfer over heat capacity"
param u  : m/s = 1   in 0..inf
param w  : m/s = {w} in {bounds}
domain z in 0 [m]..1 [m] cells {cells} scheme {scheme}
state T[z] : K = 320
state S[z] : K = 320
flux H[z] = u*T[z], low  = u*360 [K]
flux C[z] = {sign}w*S[z], high = {sign}w*300 [K]
eq d/dt T[z] = -div(H[z]) - U*(T[z] - S[z])    for z
eq d/dt S[z] = -div(C[z]) + U*(T[z] - S[z])    for z
observe hot : K = T[z.last] in 0..1000, cold : K = S[z.first] in 0..1000
action idle = 0 in 0..1
episode {{ step = 20 [s], max_steps = 2 }}
"""


def effectiveness(ntu: float, ratio: float) -> float:
    """Of a counter-current exchanger with the ratio of the smaller to the larger heat capacity flow."""
    e = np.exp(-ntu * (1 - ratio))
    return (1 - e) / (1 - ratio * e)


@pytest.mark.parametrize(
    ("sign", "w", "bounds"), [("-", 1.5, "0..inf"), ("", -1.5, "-inf..0"), ("", -1.5, "-inf..inf"), ("-", 1.5, "-2..2")]
)
@pytest.mark.parametrize("scheme", ["upwind", "upwind2", "limited"])
def test_a_counter_current_exchanger_has_its_effectiveness(sign, w, bounds, scheme):
    def outlets(cells: int) -> np.ndarray:
        source = EXCHANGER.format(w=w, sign=sign, bounds=bounds, cells=cells, scheme=scheme)
        env = smpl.Env(smpl.compile(source=source), normalize=False)
        env.reset(seed=0)
        return np.asarray(env.step(np.zeros(1, np.float32))[0], float)

    heat = effectiveness(1.3, 1 / 1.5) * 60
    exact = np.array([360 - heat, 300 + heat / 1.5])
    coarse, fine = (np.abs(outlets(n) - exact).max() for n in (20, 80))
    assert fine < {"upwind": 0.3, "upwind2": 0.01, "limited": 0.01}[scheme]
    assert coarse / fine > {"upwind": 3.5, "upwind2": 10, "limited": 10}[scheme]


REVERSED = """
model Reversed
time t : s
action v : m/s = 1 in -2..2
domain z in 0 [m]..1 [m] cells 25 scheme {scheme}
state c[z] : mol/m^3 = 0
flux J[z] = v*c[z], low = v*2 [mol/m^3], high = v*3 [mol/m^3]
eq d/dt c[z] = -div(J[z]) for z
observe c[5] in 0..10
solver {{ rtol = 1e-9 }}
episode {{ step = 0.1 [s], max_steps = 50 }}
"""


def rates(c: np.ndarray, v: float, scheme: str) -> np.ndarray:
    """First order, linear, or van Leer's: in the direction of the flow, which is turned to go up."""
    if v < 0:
        return rates(c[::-1], -v, scheme + "-")[::-1]
    inflow = 3.0 if scheme.endswith("-") else 2.0
    near, before, after = c[1:-1], c[1:-1] - c[:-2], c[2:] - c[1:-1]
    if scheme.startswith("upwind2"):
        near = near + before / 2
    elif scheme.startswith("limited"):
        product = before * after
        near = near + np.divide(product, before + after, where=product > 0, out=np.zeros_like(product))
    faces = np.concatenate([[inflow, c[0]], near, [c[-1]]])
    return -v * np.diff(faces) * len(c)


@pytest.mark.parametrize("scheme", ["upwind", "upwind2", "limited"])
def test_a_flow_that_turns_takes_the_value_of_the_end_where_it_enters(scheme):
    env = smpl.Env(smpl.compile(source=REVERSED.format(scheme=scheme)), normalize=False)
    env.reset(seed=0)
    expected = np.zeros(25)
    for v in (1.0, 1.0, 0.5, -0.5, -2.0, -2.0, 0.0, 1.5):
        env.step(np.array([v], np.float32))
        expected = solve_ivp(
            lambda t, c, v=v: rates(c, v, scheme), (0, 0.1), expected, rtol=1e-9, atol=1e-11, method="LSODA"
        ).y[:, -1]
        np.testing.assert_allclose(env.state, expected, atol=2e-6)


BURGERS = """
domain z in 0 [m]..1 [m] cells 40 scheme upwind
state u[z] : m/s = 0
flux J[z] = sq(u[z])/2, low = 0, high = 0
eq d/dt u[z] = -div(J[z]) for z
"""


def test_a_quadratic_flux_follows_its_slope():
    model = smpl.compile(source=BURGERS)
    u = np.cos(np.linspace(0, 7, 40))
    mean = (u[1:] + u[:-1]) / 2
    inner = np.where(mean >= 0, u[:-1], u[1:]) ** 2 / 2
    faces = np.concatenate([[0.0], inner, [0.0]])
    np.testing.assert_allclose(model.rhs(0.0, u, np.zeros(0)), -np.diff(faces) * 40, atol=1e-12)


CELLS = """
action w : m/s = 1 in -2..2
domain z in 0 [m]..1 [m] cells 12 scheme {scheme}
state c[z] : mol/m^3 = 1
state v[z] : m/s = 1
flux J[z] = {flux}
eq d/dt c[z] = -div(J[z]) for z
eq d/dt v[z] = w*0 [1/s] for z
"""


@pytest.mark.parametrize("scheme", ["upwind", "upwind2", "limited"])
@pytest.mark.parametrize(
    "flux", ["v[z]*c[z]", "v[z]*upwind(v[z], c[z])", "w*upwind(w, c[z]) - v[z]*upwind(-v[z], c[z])*0.3"]
)
def test_a_flow_the_other_way_is_its_mirror_image(scheme, flux):
    model = smpl.compile(source=CELLS.format(scheme=scheme, flux=flux))
    generator = np.random.default_rng(1)
    c, v = generator.uniform(0, 2, 12), generator.uniform(-1, 1, 12)
    # The rates of c by cell, whatever the order of the states.
    order = [model.state_names.index(f"{name}[{k}]") for name in "cv" for k in range(1, 13)]

    def rate(c: np.ndarray, v: np.ndarray, w: float) -> np.ndarray:
        x = np.empty(24)
        x[order] = np.concatenate([c, v])
        return model.rhs(0.0, x, np.array([w]))[order[:12]]

    there, back = rate(c, v, 0.7), rate(c[::-1], -v[::-1], -0.7)
    np.testing.assert_allclose(there, back[::-1], atol=1e-12)
    assert np.abs(there).max() > 0.1
