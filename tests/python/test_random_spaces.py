"""Random models on spatial domains against the documented finite volumes, evaluated in NumPy.

The expected numbers come from `random_models.space`: faces by each scheme, gradients, divergences, measures of the
geometries, sums and integrals. Left out: outputs (`let` with a unit, `var`) over two domains at once.
"""

import numpy as np
import pytest

import smpl
from random_models import RandomSpace
from test_random_models import Point, check_equations, seeds


@pytest.mark.parametrize("seed", seeds())
def test_a_random_space_computes_the_documented_finite_volumes(seed):
    drawn = RandomSpace(seed)
    generator = np.random.default_rng((seed, 1))
    try:
        model = smpl.compile(source=drawn.text)
        point = Point(drawn, model, generator, 0.0)
        check_equations(drawn, model, point, 0.0, generator)
    except Exception as error:
        pytest.fail(f"{drawn.text}\nseed {seed}: {error}", pytrace=False)
