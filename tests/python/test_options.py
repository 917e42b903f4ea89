"""Option objects of constructors and functions with many optional arguments."""

import dataclasses
import inspect
import pickle
import re
import warnings

import numpy as np
import pytest

import smpl
from smpl.analysis.least_squares import FitOptions
from smpl.controllers import (
    NMPC,
    PID,
    BayesianOptimization,
    BayesianOptions,
    EstimatorOptions,
    ExtendedKalmanFilter,
    MovingHorizonEstimator,
    MovingHorizonOptions,
    NMPCConstraints,
    NMPCObjective,
    NMPCOptions,
    NMPCPrediction,
    NMPCSolver,
    PIDOptions,
    SamplingMPC,
    SamplingOptions,
)
from smpl.controllers.identity import identity
from smpl.optimize import EpisodeOptions, SteadyOptions, episode, steady
from smpl.support.options import Options, takes

KINDS = {
    NMPC: NMPCOptions,
    PID: PIDOptions,
    SamplingMPC: SamplingOptions,
    BayesianOptimization: BayesianOptions,
    ExtendedKalmanFilter: EstimatorOptions,
    MovingHorizonEstimator: MovingHorizonOptions,
    smpl.fit: FitOptions,
    steady: SteadyOptions,
    episode: EpisodeOptions,
}


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class Size(Options):
    width: float = 1.0
    rows: int = 1


@dataclasses.dataclass(frozen=True, kw_only=True, repr=False)
class Box(Size):
    label: str | None = None


@takes(Box, "width")
def box(name, options, **others):
    return name, options, others


@takes(Size)
def size(name, options):
    return name, options


def test_options_are_given_as_objects_as_keywords_or_both():
    assert box("a") == ("a", Box(), {})
    assert (
        box("a", 2.0, label="x") == box("a", Box(width=2.0, label="x")) == box("a", options=Box(width=2.0, label="x"))
    )
    assert box("a", Size(width=2.0), label="x", depth=3) == ("a", Box(width=2.0, label="x"), {"depth": 3})


def test_an_option_is_given_once():
    with pytest.raises(TypeError, match=r"option 'rows' is given twice; change a copy by dataclasses\.replace"):
        box("a", Box(rows=2), rows=3)
    with pytest.raises(TypeError, match="option 'rows' is given twice"):
        box("a", Box(rows=2), Size(rows=3))
    with pytest.raises(TypeError, match="multiple values for argument 'width'"):
        box("a", 2.0, Box(width=3.0))
    # A default is not given.
    assert box("a", Box(rows=1), rows=3)[1].rows == 3


def test_options_of_another_function_and_unknown_ones_are_refused():
    with pytest.raises(TypeError, match="options are PIDOptions, expected Box"):
        box("a", PIDOptions(form="velocity"))
    with pytest.raises(TypeError, match="options are Box, expected Size"):
        size("a", Box(rows=2))
    with pytest.raises(TypeError, match="size has no argument 'height'; there are: name, width, rows"):
        size("a", height=3)
    with pytest.raises(TypeError, match="size: missing a required argument: 'name'"):
        size()
    with pytest.raises(TypeError, match="unexpected keyword argument 'height'"):
        Size(height=3)


def test_options_show_what_differs_from_the_defaults():
    assert repr(Box()) == "Box()"
    assert repr(Box(label="x", width=1.0)) == "Box(label='x')"
    # A whole number is not a truth value, and another type may be refused later.
    assert Size(rows=True).changed() == {"rows": True}
    assert list(EstimatorOptions(initial=np.zeros(3)).changed()) == ["initial"]
    assert len(repr(Box(label="x" * 1000))) < 90


def test_options_cannot_be_changed_but_copied():
    first = NMPCOptions(horizon=30)
    with pytest.raises(dataclasses.FrozenInstanceError):
        first.horizon = 20
    assert dataclasses.replace(first, solver="sqp") == NMPCOptions(horizon=30, solver="sqp")


@pytest.mark.parametrize("taker", KINDS, ids=lambda one: one.__name__)
def test_signatures_list_every_option_with_its_default_and_docstrings_describe_it(taker):
    kind = KINDS[taker]
    parameters = inspect.signature(taker).parameters
    fields = {one.name: one.default for one in dataclasses.fields(kind)}
    assert fields.items() <= {name: one.default for name, one in parameters.items()}.items()
    assert all(one.default is not dataclasses.MISSING for one in dataclasses.fields(kind))
    for base in kind.__mro__[: kind.__mro__.index(Options)]:
        described = re.findall(r"^    (\w[\w, ]*):", inspect.getdoc(base), re.MULTILINE)
        assert [name for names in described for name in names.split(", ")] == list(
            vars(base).get("__annotations__", {})
        )


def test_groups_of_a_predictive_controller_have_all_its_options_once():
    groups = (NMPCObjective, NMPCConstraints, NMPCPrediction, NMPCSolver)
    names = [one.name for group in groups for one in dataclasses.fields(group)]
    assert sorted(names) == sorted(one.name for one in dataclasses.fields(NMPCOptions))
    assert len(names) == len(set(names)) == 35


def test_a_controller_is_the_same_however_its_options_are_given():
    plain = PID("T", "T_c", -2.0, 5.0, set_point=52.0)
    other = PID("T", "T_c", -2.0, PIDOptions(integral_time=5.0, set_point=52.0))
    assert identity(plain) == identity(other) == identity(PID("T", "T_c", gain=-2.0, integral_time=5.0, set_point=52.0))
    assert identity(other)[".integral_time"] == "5.0"
    assert repr(other) == "PID('T', 'T_c', -2.0, integral_time=5.0, set_point=52.0)"
    assert identity(SamplingMPC(horizon=5)) == identity(SamplingMPC(SamplingOptions(horizon=5)))
    assert identity(SamplingMPC(horizon=5)) != identity(SamplingMPC(SamplingOptions(horizon=6)))
    reactor = smpl.compile("reactor")
    options = EstimatorOptions(process_noise={"T": 0.1})
    filters = [ExtendedKalmanFilter(reactor, options), ExtendedKalmanFilter(reactor, process_noise={"T": 0.1})]
    assert identity(filters[0]) == identity(filters[1])
    assert identity(options) == {
        "": "class smpl.controllers.kalman.EstimatorOptions", ".initial": "None", ".deviation": "None",
        ".process_noise": "dict of 1", ".process_noise['T']": "0.1", ".parameters": "None", ".noise": "None",
        ".p": "None", ".disturbances": "None",
    }  # fmt: skip


class Gentle(PID):
    """A subclass with its own arguments."""

    def __init__(self, gain):
        super().__init__("T", "T_c", gain, PIDOptions(integral_time=3.0), set_point=52.0)


class Wide(SamplingMPC):
    def __init__(self, *given, **options):
        super().__init__(*given, **{"samples": 8, **options})


def test_subclasses_pass_option_objects_on():
    own = Gentle(-1.0)
    assert (own.integral_time, own.set_point, repr(own)) == (3.0, 52.0, "Gentle(-1.0)")
    assert list(identity(own)) == ["", ".gain"]
    wide = Wide(SamplingOptions(horizon=7))
    assert (wide.horizon, wide._samples) == (7, 8)


def test_options_and_controllers_made_from_them_are_pickled():
    options = SamplingOptions(horizon=5, deviation={"T_c": 1.0})
    assert pickle.loads(pickle.dumps(options)) == options
    controller = SamplingMPC(options)
    assert identity(pickle.loads(pickle.dumps(controller))) == identity(controller)


def test_the_same_options_serve_both_estimators():
    reactor = smpl.compile("reactor")
    options = EstimatorOptions(deviation={"T": 1.0, "c_A": 0.1, "h": 0.1}, noise={"T": 0.5})
    window = MovingHorizonEstimator(reactor, 4, options)
    assert window.horizon == 4
    assert (window.prediction.noise == ExtendedKalmanFilter(reactor, options).prediction.noise).all()


def test_predictive_control_decides_the_same_with_option_objects():
    pytest.importorskip("casadi", reason="CasADi is not installed")
    env = smpl.Env("reactor", normalize=False, max_steps=3)
    made = [
        NMPC(env, 5, {"c_A": 100}, rate_weight={"T_c": 1e-4}, bounds={"T": (None, 60)}, solver="ipopt"),
        NMPC(
            env,
            NMPCObjective(horizon=5, cost={"c_A": 100}, rate_weight={"T_c": 1e-4}),
            NMPCConstraints(bounds={"T": (None, 60)}),
            solver="ipopt",
        ),
        NMPC(env, NMPCOptions(horizon=5, cost={"c_A": 100}, rate_weight={"T_c": 1e-4}, solver="ipopt"),
             bounds={"T": (None, 60)}),
    ]  # fmt: skip
    assert len({str(identity(one)) for one in made}) == 1
    env.reset(seed=0)
    actions = []
    for one in made:
        one.reset(env)
        actions.append(one.action(env))
    assert (actions[0] == actions[1]).all()
    assert (actions[0] == actions[2]).all()


def test_optima_are_the_same_with_option_objects():
    """The largest x of x' = u (1 - u) - x is 1/4 at u = 1/2."""
    text = """model M
time t : s
state x = 0 in 0..1
action u = 0.1 in 0..1
eq d/dt x = (u*(1 - u) - x)/1[s]
observe x in 0..1
reward r default = x
episode { step = 1 [s], max_steps = 3 }
"""
    model = smpl.compile(source=text)
    for found in (
        steady(model, vary=["u"], maximize="x"),
        steady(model, ["u"], SteadyOptions(maximize="x")),
        steady(model, SteadyOptions(maximize="x"), vary=["u"]),
    ):
        assert found.inputs["u"] == pytest.approx(0.5, abs=1e-4)
        assert found.value == pytest.approx(0.25, abs=1e-8)


def test_fits_are_the_same_with_option_objects_and_warn_at_the_call():
    """A decay of rate k fitted to its closed form."""
    text = """model M
time t : h
param k : 1/h = 0.5 in 0.01..5
action u = 0 in -1..1
state x = 3 in 0..10
eq d/dt x = -k*x + u*0[1/h]
observe x in 0..10
reward r default = -x
episode { step = 0.1 [h], max_steps = 20 }
"""
    model = smpl.compile(source=text, settings={"rtol": 1e-10})
    exact = 3 * np.exp(-0.7 * 0.1 * np.arange(21))
    run = {"u": np.zeros(21), "x": np.where(np.arange(21), np.nan, 3.0), "obs.x": exact}
    options = {"initial": ["x"], "noise": {"x": 0.1}}
    found = [smpl.fit(model, run, ["k"], **options), smpl.fit(model, run, ["k"], FitOptions(**options))]
    assert found[0].parameters["k"] == pytest.approx(0.7, rel=1e-5)
    assert found[0].parameters == found[1].parameters
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        smpl.fit(model, {"u": run["u"], "obs.x": exact}, ["k"])
    assert [(str(one.message)[:30], one.filename) for one in caught] == [("run 0 does not say where x sta", __file__)]
