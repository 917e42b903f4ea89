"""Models as CasADi functions compute what the machine code computes."""

import shutil
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import smpl
from exports.cases import CASES
from exports.library import Library
from exports.points import MODELS, Points, assert_equal, label, variants

ca = pytest.importorskip("casadi", reason="casadi is not installed")
ROOT = Path(__file__).resolve().parents[2]


def columns(function, *arguments):
    """A function at many points, one a column."""
    count = max(a.shape[1] for a in arguments)
    wide = [np.repeat(a, count, axis=1) if a.shape[1] == 1 else a for a in arguments]
    found = function.map(count)(*(ca.DM(a) if a.size else ca.DM(a.shape[0], count) for a in wide))
    return [np.array(f) for f in (found if isinstance(found, tuple) else (found,))]


def parameters(functions, model, points):
    """The vector p at each point, with the clock at the time."""
    p = np.repeat(functions.parameter_nominal[:, None], len(points.t), axis=1)
    names = list(functions.parameter_names)
    values = dict(zip([*model.discrete_names, *model.disturbance_names], [*points.d, *points.w], strict=True))
    values |= {"clock": points.t, functions.time_name: points.t}
    for name, value in values.items():
        if name in names:
            p[names.index(name)] = value
    points.set_instants(model, names, p)
    return p


def compare(model, count, **options):
    functions = smpl.export.casadi(model, **options)
    points = Points(model, smpl.export.json(model), count)
    states = len(model.state_names)
    p = parameters(functions, model, points)
    expected = points.machine_code(model)
    (found,) = columns(functions.residual, points.yp[:states], points.x, points.z, points.u, p)
    assert_equal(found, expected)
    if model.explicit:
        points.yp[:] = 0.0
        rates = points.machine_code(model)
        ode, algebraic = columns(functions.dae, points.x, points.z, points.u, p)
        assert_equal(np.concatenate([ode, algebraic]), rates)
        if not len(points.z):
            (found,) = columns(functions.rhs, points.x, points.u, p)
            assert_equal(found, rates)
    assert functions.state_names == model.state_names
    assert functions.action_names == model.action_names
    return functions


@pytest.mark.parametrize(("name", "arguments"), MODELS, ids=label)
def test_every_model_and_scenario_has_the_residual_of_the_machine_code(name, arguments):
    compare(smpl.compile(name, **arguments), 100 if "mab" in name or name == "atropine" else 1000)


@pytest.mark.parametrize("name", ["reactor", "beer", "pensim", "atropine", "mab"])
def test_every_variant_has_the_residual_of_the_machine_code(name):
    for variant in variants(name):
        try:
            model = smpl.compile(name, variants=[variant])
        except (smpl.CompileError, smpl.ScenarioError):
            continue  # variants that require others
        compare(model, 10)


@pytest.mark.parametrize("path", sorted((ROOT / "tests" / "problems").glob("*.eq")), ids=lambda path: path.stem)
def test_every_test_problem_has_the_residual_of_the_machine_code(path):
    compare(smpl.compile(path), 100)


@pytest.mark.parametrize(("title", "model"), CASES, ids=[title for title, _ in CASES])
def test_every_case_of_the_language_has_the_residual_of_the_machine_code(title, model):
    compare(model, 10)


@pytest.mark.parametrize("name", ["reactor", "pensim", "mab"])
def test_numbers_written_out_and_loops_kept_are_the_same(name):
    compare(smpl.compile(name), 20, kind="SX")
    compare(smpl.compile(name), 20, kind="MX")


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
@pytest.mark.parametrize(("name", "arguments"), MODELS, ids=label)
def test_outputs_observations_rewards_conditions_and_updates_are_those_of_the_c_functions(name, arguments, tmp_path):
    model = smpl.compile(name, **arguments)
    functions, library = smpl.export.casadi(model), Library(model, tmp_path)
    points = Points(model, smpl.export.json(model), 5)
    p = parameters(functions, model, points)
    timed = functions.parameter_names[-1:] == (functions.time_name,) and library.sizes["PARAMETERS"] < len(p)
    random = np.random.default_rng(1)
    context = functions.context_nominal
    context = np.where(np.isfinite(context) & (context != 0.0), context, 0.7) * random.uniform(0.9, 1.1, context.shape)
    rates = np.zeros_like(points.y)
    compared = 0
    for k in range(5):
        x, z, u, pk, t = points.x[:, k], points.z[:, k], points.u[:, k], p[:, k], points.t[k]
        t = pk[-1] if timed else t
        pc = pk[:-1] if timed else pk
        if model.explicit:
            rates[: len(x), k] = np.array(functions.dae(x, z, u, pk)[0]).ravel()
        named = {"dx": rates[: len(x), k], "x": x, "z": z, "u": u, "p": pk, "c": context}
        rewards = [np.array(f(*(named[a] for a in f.name_in()))).ravel() for f in functions.rewards.values()]
        expected = {
            name: library(name, t, points.y[:, k], rates[:, k], u, pc, context)
            for name in library.arguments
            if name not in ("prepare", "jacobian")
        }
        if rewards:
            assert_equal(np.concatenate(rewards)[:, None], expected["rewards"][:, None])
        for name, function in functions.functions.items():
            if name not in expected or name == "residual":  # zero at these rates, but for rounding
                assert name in ("dae", "rhs", "residual")
                continue
            found = function(*(named[a] for a in function.name_in()))
            if library.is_update(name):
                y, changed = expected[name]
                found = np.concatenate([np.array(f).ravel() for f in found])
                values = np.concatenate([y, changed, pk[-1:]]) if timed else np.concatenate([y, changed])
            else:
                found, values = np.array(found).ravel(), expected[name]
            same = np.isclose(
                found,
                values,
                rtol=1e-12,
                atol=1e-12 * np.abs(values[np.isfinite(values)]).max(initial=0.0),
                equal_nan=True,
            )
            assert same.all(), (name, np.flatnonzero(~same)[:5], found[~same][:5], values[~same][:5])
            compared += 1
    assert compared >= 5 * 4


@pytest.mark.parametrize("name", ["mab", "mab_plant", "atropine"])
def test_large_models_are_exported_in_two_seconds(name):
    model = smpl.compile(name)
    begin = time.perf_counter()
    functions = smpl.export.casadi(model)
    assert time.perf_counter() - begin < 4.0  # twice, for a machine with other load
    assert functions.kind == "MX"


def test_a_smooth_export_approaches_the_exact_one_as_its_width_shrinks():
    source = """
model Switch "a rate with a switch, a limit and a size"
time t : s
param a : 1 = 1
action u : 1 = 0.3 in 0..1
state x : 1 = 0.5 in -10..10
eq d/dt x = ((if x > 0.4 then u else -u) + min(x, a) + max(x, a) + abs(x - a)) / 1 [s]
observe x
reward default_one default = -x
episode { step = 1 [s], max_steps = 5 }
"""
    model = smpl.compile(source=source)
    exact = smpl.export.casadi(model).rhs
    at = [ca.DM(x) for x in (-0.7, 0.1, 0.35, 0.5, 1.7)]
    errors = []
    for width in (1e-1, 1e-2, 1e-3):
        smooth = smpl.export.casadi(model, smooth=width).rhs
        errors.append(max(abs(float(smooth(x, 0.3, [1.0]) - exact(x, 0.3, [1.0]))) for x in at))
    # sqrt(d^2 + w^2) - |d| is less than w^2 / (2 |d|), and the distance to the switch is 0.05 at least.
    assert errors[2] < errors[1] < errors[0]
    assert errors[2] < 1e-4


def test_derivatives_of_the_exported_rates_are_those_of_the_model():
    model = smpl.compile("reactor")
    functions = smpl.export.casadi(model)
    x, u, p = ca.SX.sym("x", 3), functions.action_nominal, functions.parameters()
    jacobian = ca.Function("A", [x], [ca.jacobian(functions.rhs(x, u, p), x)])
    at = np.array([0.8, 50.0, 0.6])
    expected = model.jacobian(0.0, at, np.zeros(3), u, 0.0).toarray()
    np.testing.assert_allclose(np.array(jacobian(at)), expected, rtol=1e-12)


def test_names_of_parameters_that_there_are_not_are_refused():
    functions = smpl.export.casadi(smpl.compile("reactor"))
    assert functions.parameters({"k_0": 1.0})[functions.parameter_names.index("k_0")] == 1.0
    with pytest.raises(ValueError, match=r"unknown 'k0'; there are: .*k_0"):
        functions.parameters({"k0": 1.0})
    with pytest.raises(ValueError, match="kind is 'XX'"):
        smpl.export.casadi(smpl.compile("reactor"), kind="XX")


def test_a_part_has_the_rates_of_its_states_and_names_what_it_gets_from_the_rest():
    model = smpl.compile("mab")
    functions = smpl.export.casadi(model)
    vessel = ("Xv1", "Xt1", "GLC1", "GLN1", "LAC1", "AMM1", "mAb1", "V1")
    culture, part = functions.part(functions.state_names[:17]), functions.part(vessel)
    assert culture.outside_names == ()  # the seventeen states of the culture know nothing of the column
    assert set(part.outside_names) <= set(functions.state_names[8:17])
    assert part.outside_names
    random = np.random.default_rng(0)
    x = functions.state_nominal * random.uniform(0.9, 1.1, len(functions.state_names))
    u, p = functions.action_nominal, functions.parameters()
    named = dict(zip(functions.state_names, x, strict=True))
    rates = dict(zip(model.state_names, model.rhs(0.0, x, u), strict=True))
    for some in (culture, part):
        inside, outside = ([named[name] for name in names] for names in (some.state_names, some.outside_names))
        found = some.rates(inside, outside, u, p).full().ravel()
        np.testing.assert_allclose(found, [rates[name] for name in some.state_names], rtol=1e-12)


def test_a_part_is_named_by_states_arrays_or_components():
    functions = smpl.export.casadi(smpl.compile("atropine"))
    reactor = functions.part(["R1"])
    assert set(reactor.state_names) == {name for name in functions.state_names if name.startswith("R1.")}
    assert functions.part(["R1.c"]).state_names == reactor.state_names
    with pytest.raises(ValueError, match="states: unknown 'R9'"):
        functions.part(["R9"])


def test_a_parameter_that_shaped_the_model_keeps_its_value():
    source = """
model Column "as many cells as a parameter says"
time t : s
param n : 1 = 3
action u : 1 = 0.3 in 0..1
state x[i in 1..n] : 1 = 0.5 in -10..10
eq d/dt x[i] = (u - n*x[i]) / 1 [s] for i in 1..n
observe x[1]
reward r default = -x[1]
episode { step = 1 [s], max_steps = 5 }
"""
    functions = smpl.export.casadi(smpl.compile(source=source))
    assert functions.parameters({"n": 3})[functions.parameter_names.index("n")] == 3.0
    with pytest.raises(ValueError, match=r"'n' shaped the model, exported with 3\.0"):
        functions.parameters({"n": 4})


def test_what_a_call_leaves_out_is_nominal_and_what_changes_from_step_to_step_must_be_given():
    functions = smpl.export.casadi(smpl.compile("reactor"))
    x, u, p = functions.state_nominal * 1.01, functions.action_nominal, functions.parameters()
    reward, c = functions.rewards["setpoint"], functions.context({"initial(T)": 55.0})
    assert float(reward(x, u, p, c)) == float(reward(x, [], u, p, c)) < 0.0
    with pytest.raises(TypeError, match=r"reward_0 needs c, for it reads initial\(T\)"):
        reward(x, u, p)
    np.testing.assert_array_equal(functions.observations(x, u).full().ravel(), x)
    np.testing.assert_array_equal(functions.rhs(x, u), functions.rhs(x, u, p))
    np.testing.assert_array_equal(functions.dae(x, [], u, p)[0], functions.rhs(x, u, p))
    changed = functions.rhs(x, u, {"k_0": 1e10})
    assert float(changed[0]) != float(functions.rhs(x, u, p)[0])
    np.testing.assert_array_equal(changed, functions.rhs(x, u, functions.parameters({"k_0": 1e10})))
    assert isinstance(functions.rhs, ca.Function)
    with pytest.raises(TypeError, match=r"needs c, for it reads .*draw"):
        functions.functions["initial_states"](x, u)
    with pytest.raises(TypeError, match=r"rhs\(x, u, p\) was called with 1 arguments"):
        functions.rhs(x)


def test_without_casadi_the_error_names_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(ImportError, match="pip install casadi"):
        smpl.export.casadi(smpl.compile("reactor"))
