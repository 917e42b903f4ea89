"""A column of 41 stages written over a range of numbers, against the published operating point and linear model.

S. Skogestad, I. Postlethwaite, Multivariable Feedback Control (Wiley 1996), "column A": both products at 99 %,
steady-state gains from reflux and boilup to the products, a dominant time constant of 194 min.
"""

from pathlib import Path

import numpy as np
import pytest

import smpl

COLUMN = Path(__file__).resolve().parent.parent / "problems" / "column_a.eq"
NOMINAL = np.array([2.70629, 3.20629])
GAINS = np.array([[0.8754, -0.8618], [1.0846, -1.0982]])


@pytest.fixture(scope="module")
def column() -> smpl.Model:
    return smpl.compile(COLUMN)


def test_the_products_are_those_published(column):
    steady = dict(zip(column.unknown_names, column.steady_state(NOMINAL), strict=True))
    assert steady["x[41]"] == pytest.approx(0.99, abs=1e-6)
    assert steady["x[1]"] == pytest.approx(0.01, abs=1e-6)


def test_the_linear_model_has_the_published_gains_and_time_constant(column):
    A, B, C, D = column.linearize(column.steady_state(NOMINAL), NOMINAL)
    np.testing.assert_allclose(D - C @ np.linalg.solve(A, B), GAINS, atol=5e-5)
    slowest = -1.0 / np.linalg.eigvals(A).real.max()
    assert slowest == pytest.approx(194.0, abs=0.5)


def test_a_column_of_feed_separates_it():
    env = smpl.Env(smpl.compile(COLUMN), normalize=False)
    env.reset(seed=0)
    for _ in range(200):
        observation, _, terminated, _, _ = env.step(NOMINAL)
        assert not terminated
    # 2000 min are ten of the slowest time constants.
    np.testing.assert_allclose(observation, [0.99, 0.01], atol=1e-4)
