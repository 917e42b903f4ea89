"""Models as JAX functions compute what the machine code computes."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

import smpl
from exports.cases import CASES
from exports.library import Library
from exports.points import MODELS, Points, assert_equal, label

jax = pytest.importorskip("jax", reason="jax is not installed")
jax.config.update("jax_enable_x64", True)

ROOT = Path(__file__).resolve().parents[2]


def parameters(functions, model, points):
    p = np.repeat(functions.parameter_nominal[:, None], len(points.t), axis=1)
    names = list(functions.parameter_names)
    values = dict(zip([*model.discrete_names, *model.disturbance_names], [*points.d, *points.w], strict=True))
    for name, value in (values | {"clock": points.t}).items():
        if name in names:
            p[names.index(name)] = value
    points.set_instants(model, names, p)
    return p


def columns(function, *vectors):
    return np.array(jax.jit(jax.vmap(function))(*(v.T for v in vectors))).T


def compare(model, count):
    functions = smpl.export.jax(model)
    points = Points(model, smpl.export.json(model), count)
    states = len(model.state_names)
    p = parameters(functions, model, points)
    found = columns(functions.residual, points.t, points.yp[:states], points.x, points.z, points.u, p)
    assert_equal(found, points.machine_code(model))
    assert functions.state_names == model.state_names


@pytest.mark.parametrize(("name", "arguments"), MODELS, ids=label)
def test_every_model_and_scenario_has_the_residual_of_the_machine_code(name, arguments):
    compare(smpl.compile(name, **arguments), 100 if "mab" in name or name == "atropine" else 1000)


@pytest.mark.parametrize("path", sorted((ROOT / "tests" / "problems").glob("*.eq")), ids=lambda path: path.stem)
def test_every_test_problem_has_the_residual_of_the_machine_code(path):
    compare(smpl.compile(path), 100)


@pytest.mark.parametrize(("title", "model"), CASES, ids=[title for title, _ in CASES])
def test_every_case_of_the_language_has_the_residual_of_the_machine_code(title, model):
    compare(model, 3)


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
@pytest.mark.parametrize("name", ["reactor", "beer", "pensim", "mab"])
def test_outputs_observations_rewards_conditions_and_updates_are_those_of_the_c_functions(name, tmp_path):
    model = smpl.compile(name)
    functions, library = smpl.export.jax(model), Library(model, tmp_path)
    points = Points(model, smpl.export.json(model), 3)
    p = parameters(functions, model, points)
    context = np.where(np.isfinite(functions.context_nominal), functions.context_nominal, 0.7)
    compared = 0
    for k in range(3):
        x, z, u, t = points.x[:, k], points.z[:, k], points.u[:, k], points.t[k]
        rates = np.zeros(len(points.y))
        rates[: len(x)] = functions.dae(t, x, z, u, p[:, k])[0]
        for name, function in functions.functions.items():
            if name in ("dae", "rhs", "residual"):
                continue
            expected = library(name, t, points.y[:, k], rates, u, p[:, k], context)
            found = function(t, x, z, u, p[:, k], *([context] if functions.takes_context(name) else []))
            if library.is_update(name):
                found, expected = np.concatenate(found), np.concatenate(expected)
            largest = np.abs(expected[np.isfinite(expected)]).max(initial=0.0)
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * largest, err_msg=name)
            compared += 1
    assert compared >= 3 * 4


def test_arrays_stay_array_operations():
    # 1970 rows written out one by one would be ten thousand operations at least.
    model = smpl.compile("mab")
    functions = smpl.export.jax(model)
    vectors = (functions.state_nominal, functions.algebraic_nominal, functions.action_nominal, functions.parameters())
    traced = jax.make_jaxpr(functions.dae)(0.0, *vectors)
    assert len(traced.jaxpr.eqns) < 4000


def test_derivatives_of_the_exported_rates_are_those_of_the_model():
    model = smpl.compile("reactor")
    functions = smpl.export.jax(model)
    x, u = np.array([0.8, 50.0, 0.6]), functions.action_nominal
    found = jax.jacfwd(functions.rhs, argnums=1)(0.0, x, u, functions.parameters())
    expected = model.jacobian(0.0, x, np.zeros(3), u, 0.0).toarray()
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_the_example_integrates_a_batch_as_the_environment_does():
    import jax_batch

    functions = smpl.export.jax(smpl.compile("reactor"))
    env = smpl.Env("reactor", normalize=False)
    x, u = env.steady_state * 1.02, env.steady_action
    env.reset(options={"state": x})
    for _ in range(jax_batch.STEPS):
        env.step(u)
    end = jax.jit(jax_batch.episode(functions, jax))(x, u, functions.parameters())
    np.testing.assert_allclose(end, env.state, rtol=1e-6)
    ends, slope = jax_batch.main(8)
    assert ends.shape == (8, 3)
    assert np.isfinite(slope).all()


def test_without_jax_the_error_names_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(ImportError, match="pip install jax"):
        smpl.export.jax(smpl.compile("reactor"))
