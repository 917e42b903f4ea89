"""Runs of models of index above 1 by all methods, and references of SciPy on hand-reduced forms."""

import numpy as np
import pytest

import smpl

integrate = pytest.importorskip("scipy.integrate")

GRIDS = [("ida", 1), ("ida", 24), ("rosenbrock", 1), ("rosenbrock", 7), ("auto", 2)]
HEAD = "model M\ntime t : s\nepisode {{ step = {step} [s], max_steps = {steps} }}\nsolver {{ rtol = 1e-9 }}\n"


def ends(text, end, method, steps):
    """Values of all states and solved variables at the time `end`."""
    model = smpl.compile(source=HEAD.format(step=end / steps, steps=steps) + text)
    env = smpl.Env(model, method=method, normalize=False)
    env.reset(seed=0)
    for _ in range(steps):
        *_, info = env.step(np.zeros(len(model.action_names)))
        assert not info["failure"], info["failure"]
    names = model.state_names + model.algebraic_names
    return dict(zip(names, [*env.state, *env.algebraic], strict=True))


def follows(text, end, expected, tolerance=1e-6, grids=GRIDS):
    """Compare by all methods and grids."""
    for method, steps in grids:
        found = ends(text, end, method, steps)
        for name, value in expected.items():
            error = abs(found[name] - value)
            assert error <= tolerance * max(1e-3, abs(value)), (method, steps, name, found[name], value)


def solved(rates, start, end, method="DOP853"):
    found = integrate.solve_ivp(rates, (0, end), start, method, rtol=1e-11, atol=1e-13)
    assert found.success
    return found.y[:, -1]
