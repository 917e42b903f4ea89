"""`max`, `min` and `product` over more elements than are written out, against NumPy."""

import numpy as np
import pytest

import smpl

SOURCE = """
domain z in 0..1 cells 100
action u = 0.5 in 0..2
state c[z] = 1
state m = 1
eq d/dt c[z] = -c[z] / 1 [s] for z
eq d/dt m = ({of} - m) / 1 [s]
observe o = 2*{of} in -100..100
"""
BODIES = {
    "max(c[z]*(1 + z) for z)": np.max,
    "min(c[z]*(1 + z) for z)": np.min,
    "product(c[z]*(1 + z) for z)": np.prod,
}
WEIGHTS = 1 + (np.arange(100) + 0.5) / 100


def gradient(of: str, values: np.ndarray) -> np.ndarray:
    """With respect to the elements; of equal ones the mean of the derivatives."""
    if of.startswith("product"):
        return np.array([np.prod(np.delete(values, k)) for k in range(100)])
    extreme = values == BODIES[of](values)
    return extreme / extreme.sum()


def cells(kind: str) -> np.ndarray:
    c = np.random.default_rng(3).uniform(0.5, 0.9, 100)
    if kind == "equal":
        return 1 / WEIGHTS
    for k in range({"no zero": 0, "one zero": 1, "two zeros": 2}[kind]):
        c[17 + 40 * k] = 0.0
    return c


@pytest.mark.parametrize("kind", ["no zero", "one zero", "two zeros", "equal"])
@pytest.mark.parametrize("of", list(BODIES))
def test_a_long_reduction_has_its_derivative(of, kind):
    model = smpl.compile(source=SOURCE.format(of=of))
    order = [model.state_names.index(f"c[{k}]") for k in range(1, 101)]
    last = model.state_names.index("m")
    y = np.empty(101)
    y[order], y[last] = cells(kind), 0.3
    values = y[order] * WEIGHTS
    assert model.rhs(0.0, y, np.array([0.5]))[last] == pytest.approx(BODIES[of](values) - 0.3, abs=1e-12)
    if kind == "equal":
        # One rounding may part them: any mean of their derivatives will do.
        row = model.jacobian(0.0, y, np.zeros(101), np.array([0.5]), 0.0).toarray()[last][order] / WEIGHTS
        assert row.sum() == pytest.approx(100 if of.startswith("product") else 1)
        return
    expected = gradient(of, values) * WEIGHTS
    row = model.jacobian(0.0, y, np.zeros(101), np.array([0.5]), 0.0).toarray()[last]
    np.testing.assert_allclose(row[order], expected, rtol=1e-12, atol=1e-15)
    a, _, c, _ = model.linearize(y, np.array([0.5]))
    np.testing.assert_allclose(a[last][order], expected, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(c[0][order], 2 * expected, rtol=1e-12, atol=1e-15)


def test_the_largest_of_cells_in_each_row_of_an_array():
    model = smpl.compile(
        source="""
        set s = 1..20
        domain z in 0..1 cells 70
        state c[s, z] = 1
        eq d/dt c[i, z] = (max(sq(c[i, z]) for z) - c[i, z]) / 1 [s] for i in s, z
        """
    )
    names = [f"c[{i},{z}]" for i in range(1, 21) for z in range(1, 71)]
    order = [model.state_names.index(name) for name in names]
    c = np.random.default_rng(5).uniform(0.5, 1, (20, 70))
    y = np.empty(1400)
    y[order] = c.ravel()
    np.testing.assert_allclose(model.rhs(0.0, y, np.zeros(0))[order], ((c**2).max(1)[:, None] - c).ravel(), atol=1e-13)
    expected = -np.eye(1400)
    for i in range(20):
        k = int(c[i].argmax())
        expected[70 * i : 70 * (i + 1), 70 * i + k] += 2 * c[i, k]
    found = model.jacobian(0.0, y, np.zeros(1400), np.zeros(0), 0.0).toarray()[np.ix_(order, order)]
    np.testing.assert_allclose(found, expected, atol=1e-13)


COAGULATION = """
model Coagulation "Smoluchowski's equations with a constant kernel"
time t : s
param K : cm^3/s = 1e-9 in 0..1
set size = 1..{sizes}
state c[k in size] : 1/m^3 = 0 in 0..1e13 scale 1e11
state N : 1/cm^3 = 1e6 in 0..inf scale 1e6
initial c[k] = if k == 1 then 1e6 [1/cm^3] else 0 [1/cm^3] for k in size
eq d/dt c[k] = 0.5*K*sum(c[j]*c[k-j] for j in 1..k-1) - K*c[k]*N for k in size
eq d/dt N = -0.5*K*sq(N)
episode {{ step = 300 [s], max_steps = 10 }}
solver {{ rtol = 1e-8, method = rosenbrock }}
"""


@pytest.mark.parametrize("sizes", [5, 40])
def test_sums_of_nothing_have_the_unit_that_their_place_needs(sizes):
    env = smpl.Env(smpl.compile(source=COAGULATION.format(sizes=sizes)), normalize=False)
    env.reset(seed=0)
    number = np.arange(1, sizes + 1)
    for step in range(1, 11):
        env.step([])
        tau = 0.5 * 1e-9 * 1e6 * 300 * step
        expected = 1e12 * tau ** (number - 1) / (1 + tau) ** (number + 1)
        np.testing.assert_allclose(env.state[:-1], expected, rtol=1e-8, atol=1.0)
