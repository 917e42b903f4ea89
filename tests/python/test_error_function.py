"""The function `erf`: values and derivatives against SciPy, in equations and in exports."""

from pathlib import Path

import numpy as np
import pytest

import smpl

special = pytest.importorskip("scipy.special", reason="SciPy is not installed")
PROBLEM = Path(__file__).resolve().parents[1] / "problems" / "size_classes.eq"
POINTS = np.concatenate([np.linspace(-6, 6, 241), [-1e-9, 1e-300, 0.84375, 1.25, 1 / 0.35, 30.0]])
MODEL = """model M
time t : 1
state x = 0 in -100..100
eq d/dt x = erf(x)
episode { step = 1, max_steps = 5 }
"""


def test_value_and_derivative_are_those_of_scipy():
    model = smpl.compile(source=MODEL)
    values = [model.rhs(0.0, [x], [])[0] for x in POINTS]
    np.testing.assert_allclose(values, special.erf(POINTS), rtol=1e-15, atol=0)
    slopes = [model.jacobian(0.0, [x], [0.0], [], 0.0)[0, 0] for x in POINTS]
    np.testing.assert_allclose(slopes, 2 / np.sqrt(np.pi) * np.exp(-(POINTS**2)), rtol=4e-14, atol=1e-300)


def test_a_constant_argument_is_computed_when_the_model_is_compiled():
    model = smpl.compile(source=MODEL.replace("erf(x)", "x*erf(0.5)"))
    assert model.rhs(0.0, [1.0], [])[0] == special.erf(0.5)


@pytest.mark.parametrize("argument", ["2 [m]", "x, 1", ""])
def test_an_argument_with_a_unit_or_another_number_of_arguments_is_refused(argument):
    with pytest.raises(smpl.CompileError):
        smpl.compile(source=MODEL.replace("erf(x)", f"erf({argument})"))


@pytest.mark.parametrize("method", ["ida", "rosenbrock", "explicit", "auto"])
def test_a_trajectory_is_that_of_scipy(method):
    integrate = pytest.importorskip("scipy.integrate")
    env = smpl.Env(PROBLEM, normalize=False, method=method, settings={"rtol": 1e-9})
    env.reset(seed=0, options={"start": "nominal"})

    def rates(_, y):
        shares = (1 + special.erf((0.7 * np.arange(1, 4) - y[0]) / (np.sqrt(2) * 0.5))) / 2
        return np.concatenate([[1.5 - 0.3 * y[0]], (shares - y[1:]) / 2])

    for _ in range(8):
        env.step([1.5])
    expected = integrate.solve_ivp(rates, (0, 4), [2, 0, 0, 0], rtol=1e-11, atol=1e-12).y[:, -1]
    np.testing.assert_allclose(env.state, expected, rtol=1e-6, atol=1e-8)
