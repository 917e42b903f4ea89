"""Random models against an independent evaluation in NumPy.

Nothing of the compiler has a part in the expected numbers: `random_models` writes a model and evaluates its own
expressions, with derivatives by a complex step. A failure shows the text of the model, its seed and the difference.

    SMPL_RANDOM_MODELS=1000:5000 pytest tests/python/test_random_models.py

runs the seeds 1000 to 4999 instead of the usual ones; a single number runs that seed alone.
"""

import os

import numpy as np
import pytest

import smpl
from random_models import Key, Number, PartedModel, RandomModel, World, flat, real

TOLERANCE = 1e-11
STEP = 1e-30  # of the complex step


def seeds() -> range:
    first, _, last = os.environ.get("SMPL_RANDOM_MODELS", "0:150").partition(":")
    return range(int(first), int(last or int(first) + 1))


def in_order(keys: list[Key], names: tuple[str, ...]) -> list[Key]:
    """The elements in the order of the compiled model, which has these and no others."""
    by_name = {flat(key): key for key in keys}
    assert sorted(by_name) == sorted(names)
    return [by_name[name] for name in names]


def assert_close(what: str, found: np.ndarray, expected: np.ndarray, tolerance: float = TOLERANCE) -> None:
    """Equal, relative to the largest number of the row where that is above 1."""
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.shape == expected.shape, what
    if expected.size == 0:
        return
    largest = np.abs(expected).max(axis=1, keepdims=True) if expected.ndim == 2 else np.abs(expected)
    errors = np.nan_to_num(np.abs(found - expected) / np.maximum(largest, 1.0), nan=np.inf)
    worst = tuple(int(k) for k in np.unravel_index(np.argmax(errors), errors.shape))
    assert errors[worst] <= tolerance, f"{what}{list(worst)} is {found[worst]}, expected {expected[worst]}"


class Point:
    """A random point of a model; values and derivatives by states and actions follow from the drawn definitions."""

    def __init__(self, drawn: RandomModel, model: smpl.Model, generator: np.random.Generator, time: float) -> None:
        self.states = in_order(drawn.elements("state"), model.state_names)
        actions = in_order(drawn.elements("action"), model.action_names)
        self.x = generator.uniform(0.3, 1.7, len(self.states))
        self.u = generator.uniform(0.3, 1.7, len(actions))
        parameters = {
            k: float(generator.uniform(0.5, 1.5)) for k in drawn.elements("param") if generator.random() < 0.5
        }
        self.p = {flat(key): value for key, value in parameters.items()}
        moved = np.concatenate([self.x, self.u])[:, None] + 1j * STEP * np.eye(len(self.x) + len(self.u))
        given = dict(zip([*self.states, *actions], moved, strict=True))
        self.world = World(drawn.definitions, {**given, **parameters}, time)
        self.rates = self._split([self.world.evaluate(drawn.rates[key]) for key in self.states])

    def values(self, keys: list[Key]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values, derivatives by states, derivatives by actions."""
        return self._split([self.world.get(key) for key in keys])

    def _split(self, rows: list[Number]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        width, states = len(self.x) + len(self.u), len(self.x)
        table = np.zeros((len(rows), width), complex)
        for row, value in zip(table, rows, strict=True):
            row[:] = value
        return table[:, 0].real.copy(), table[:, :states].imag / STEP, table[:, states:].imag / STEP


def check_equations(
    drawn: RandomModel, model: smpl.Model, point: Point, time: float, generator: np.random.Generator
) -> None:
    """Residual, rates and Jacobian where the algebraic unknowns, if any are left, have their values."""
    n = len(point.x)
    rates, by_states, _ = point.rates
    variables = {flat(key): key for key in drawn.elements("var")}
    y = np.concatenate([point.x, point.values([variables[name] for name in model.unknown_names[n:]])[0]])
    yp, cj = generator.normal(size=y.size), 2.5
    residual = model.residual(time, y, yp, point.u, point.p)
    assert_close("residual", residual[:n], rates - yp[:n])
    assert_close("residual of an algebraic equation", residual[n:], np.zeros(y.size - n))
    if model.explicit and y.size == n:
        assert_close("rate", model.rhs(time, y, point.u, point.p), rates)
    jacobian = model.jacobian(time, y, yp, point.u, cj, point.p).toarray()
    reduced = jacobian[:n, :n] - jacobian[:n, n:] @ np.linalg.solve(jacobian[n:, n:], jacobian[n:, :n])
    assert_close("jacobian", reduced, by_states - cj * np.eye(n))
    if time == 0:
        _, c, d = point.values(in_order(drawn.observed, model.observation_names))
        for what, found, expected in zip(
            "ABCD", model.linearize(y, point.u, point.p), (by_states, point.rates[2], c, d), strict=True
        ):
            assert_close(what, found, expected)


def check_start(drawn: RandomModel, model: smpl.Model, parameters: dict[str, float]) -> None:
    """Initial values, algebraic variables and observations after a reset with parameters."""
    named = {flat(key): key for key in drawn.elements("param")}
    given = {named[name]: value for name, value in parameters.items()} | dict.fromkeys(drawn.elements("action"), 0.5)
    world = World(drawn.initials | drawn.definitions, given, 0.0)
    env = smpl.Env(model, normalize=False)
    observation, _ = env.reset(seed=0, options={"parameters": parameters})
    for what, found, keys, names in (
        ("initial value", env.state, drawn.elements("state"), model.state_names),
        ("algebraic", env.algebraic, drawn.elements("var", "let"), model.algebraic_names),
    ):
        assert_close(what, found, np.array([real(world.get(key)) for key in in_order(keys, names)]))
    seen = [real(world.get(key)) for key in in_order(drawn.observed, model.observation_names)]
    assert_close("observation", observation, np.array(seen), 1e-6)


@pytest.mark.parametrize("kind", [RandomModel, PartedModel])
@pytest.mark.parametrize("seed", seeds())
def test_a_random_model_computes_what_its_text_says(seed, kind):
    drawn = kind(seed)
    generator = np.random.default_rng((seed, 1))
    try:
        model = smpl.compile(source=drawn.text)
        for time in (0.0, 1.7):
            point = Point(drawn, model, generator, time)
            check_equations(drawn, model, point, time, generator)
        check_start(drawn, model, point.p)
    except Exception as error:
        pytest.fail(f"{drawn.text}\nseed {seed}: {error}", pytrace=False)
