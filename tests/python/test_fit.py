"""Parameters from runs, against SciPy's fits of closed forms and against what the data were made with."""

import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import smpl
from smpl.commands.main import main
from smpl.controllers import Nominal, OpenLoop, Uniform
from smpl.evaluation import run_episode

optimize = pytest.importorskip("scipy.optimize")
PROBLEMS = Path(__file__).resolve().parent.parent / "problems"
DECAY = """model Decay
time t : h
param k : 1/h = 0.3 in 0.01..5
param a = 1
param b = 1
param idle = 1
action u = 0 in -1..1
state x = 3 in 0..10
eq d/dt x = -k*a*b*x + 0*idle*1[1/h]*x
observe x in 0..10
level noisy { observe x in 0..10 noise normal(0, 0.05) }
level rare { observe x in 0..10 every 4 delay 2 noise normal(0, 0.05) }
reward r default = -x
episode { step = 0.25 [h], max_steps = 40, error_reward = 0 }
"""
TIMES = 0.25 * np.arange(41)


def decay(level="default"):
    return smpl.compile(source=DECAY, observation=level, settings={"rtol": 1e-10})


def table(readings, **more):
    return {
        "u": np.zeros(len(readings)),
        "x": np.where(np.arange(len(readings)), np.nan, 3.0),
        "obs.x": readings,
        **more,
    }


@pytest.fixture(scope="module")
def readings():
    return 3 * np.exp(-0.7 * TIMES) + np.random.default_rng(4).normal(0, 0.05, 41)


def test_a_model_that_does_not_follow_the_runs_is_told(readings):
    model = decay("noisy")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        smpl.fit(model, table(readings), ["k"])
    # Readings of a process of second order, 0.3 of the start off at most.
    other = readings + 0.3 * np.sin(TIMES)
    found = optimize.curve_fit(lambda t, k: 3 * np.exp(-k * t), TIMES[1:], other[1:], 0.3)[0]
    times = np.sqrt(np.mean((other[1:] - 3 * np.exp(-found * TIMES[1:])) ** 2)) / 0.05
    with pytest.warns(UserWarning, match=r"the residuals of x are [\d.]+ times the given noise") as told:
        smpl.fit(model, table(other), ["k"])
    assert float(str(told[0].message).split()[5]) == pytest.approx(times, rel=0.02)


def test_a_rate_and_its_interval_are_those_of_the_closed_form(readings):
    exact, covariance = optimize.curve_fit(lambda t, k: 3 * np.exp(-k * t), TIMES, readings, 0.3)
    found = smpl.fit(decay(), table(readings), ["k"])
    assert found.parameters["k"] == pytest.approx(exact[0], rel=1e-6)
    # The same sum of squares over its degrees of freedom.
    assert found.covariance[0, 0] == pytest.approx(covariance[0, 0], rel=1e-3)
    low, high = found.interval["k"]
    assert (high - low) / 2 == pytest.approx(2.0211 * np.sqrt(covariance[0, 0]), rel=1e-3)  # Student's t of 40 values


def test_a_declared_noise_weighs_as_it_is(readings):
    _, covariance = optimize.curve_fit(
        lambda t, k: 3 * np.exp(-k * t), TIMES, readings, 0.3, sigma=np.full(41, 0.05), absolute_sigma=True
    )
    found = smpl.fit(decay("noisy"), table(readings), ["k"])
    assert found.covariance[0, 0] == pytest.approx(covariance[0, 0], rel=1e-4)
    assert found.noise == {"x": 0.05}
    low, high = found.interval["k"]
    assert high - low == pytest.approx(2 * 1.959964 * np.sqrt(covariance[0, 0]), rel=1e-4)


def test_an_unknown_start_is_fitted_with_the_rate(readings):
    exact, covariance = optimize.curve_fit(lambda t, k, x: x * np.exp(-k * t), TIMES, readings, [0.3, 3.0])
    found = smpl.fit(decay(), [table(readings)], {"k": 0.5}, initial=["x"])
    assert (found.parameters["k"], found.initial[0]["x"]) == pytest.approx(tuple(exact), rel=1e-5)
    np.testing.assert_allclose(found.covariance, covariance, rtol=2e-3)
    assert found.names == ("k", "run 0: x")


def test_several_runs_count_together(readings):
    other = 2 * np.exp(-0.7 * TIMES) + np.random.default_rng(5).normal(0, 0.05, 41)
    start = np.where(np.arange(41), np.nan, 2.0)
    exact, _ = optimize.curve_fit(
        lambda t, k: np.concatenate([3 * np.exp(-k * TIMES), 2 * np.exp(-k * TIMES)]),
        np.tile(TIMES, 2), np.concatenate([readings, other]), 0.3,
    )  # fmt: skip
    found = smpl.fit(decay(), [table(readings), table(other, x=start)], "k")
    assert found.parameters["k"] == pytest.approx(exact[0], rel=1e-6)


def test_a_reading_that_is_held_counts_once():
    """Samples of every fourth step, read two steps later: ten of them, and the one at the start."""
    model = decay("rare")
    env = smpl.Env(model, normalize=False)
    episode = run_episode(env, OpenLoop([[0.0]], hold=True), 3, {"parameters": {"k": 0.7}})
    samples = [episode.readings[0, 0], *episode.readings[6::4, 0]]
    times = 0.25 * np.array([0, *range(4, 39, 4)])
    exact, covariance = optimize.curve_fit(
        lambda t, k: 3 * np.exp(-k * t), times, samples, 0.3, sigma=np.full(len(times), 0.05), absolute_sigma=True
    )
    found = smpl.fit(model, episode, ["k"])
    assert found.parameters["k"] == pytest.approx(exact[0], rel=1e-5)
    assert found.covariance[0, 0] == pytest.approx(covariance[0, 0], rel=1e-3)


def test_a_record_may_be_longer_than_an_episode(readings):
    model = smpl.compile(source=DECAY, settings={"max_steps": 5, "rtol": 1e-10})
    assert smpl.fit(model, table(readings), "k").parameters == smpl.fit(decay(), table(readings), "k").parameters


def test_parameters_that_cannot_be_told_apart_are_named(readings):
    with pytest.warns(UserWarning, match="determine only a combination of a, b"):
        found = smpl.fit(decay(), table(readings), ["a", "b"])
    assert found.indistinct == (("a", "b"),)
    assert found.interval["a"] == (-np.inf, np.inf)
    assert 0.3 * found.parameters["a"] * found.parameters["b"] == pytest.approx(0.7, abs=0.05)


def test_a_parameter_without_an_effect_is_named(readings):
    with pytest.raises(
        ValueError, match="the runs say nothing about idle: in them x would be the same with another value"
    ):
        smpl.fit(decay(), table(readings), ["k", "idle"])


def test_a_bound_of_the_file_is_kept(readings):
    text = DECAY.replace("in 0.01..5", "in 0.01..0.5")
    found = smpl.fit(smpl.compile(source=text), table(readings), ["k"])
    assert found.parameters["k"] == pytest.approx(0.5, abs=1e-6) and found.parameters["k"] <= 0.5


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"parameters": ["kk"]}, "parameters: unknown 'kk'; there are: k, a, b, idle"),
        ({"parameters": []}, "parameters is empty"),
        ({"runs": {"obs.x": [1.0, 2.0]}}, "run 0 has no column for the actions u"),
        ({"runs": []}, "runs is empty"),
        ({"runs": {"u": [0.0, 0.0]}}, r"the runs have no column obs.NAME of the level 'default', which shows x"),
        ({"outputs": ["y"]}, "outputs: unknown 'y'"),
        ({"initial": ["y"]}, "initial: unknown 'y'"),
        ({"runs": {"u": [0.0, np.nan], "obs.x": [1.0, 2.0]}}, "an action is missing in row 1"),
        ({"noise": {"x": 0}}, r"noise\['x'\] is 0, expected a deviation above 0"),
        ({"runs": 3}, "run 0 is int, expected a path, an episode or a mapping"),
    ],
)
@pytest.mark.filterwarnings("ignore:run 0 does not say where x started")
def test_what_does_not_fit_is_refused(readings, change, says):
    given = {"runs": table(readings), "parameters": ["k"], **change}
    with pytest.raises(ValueError, match=says):
        smpl.fit(decay(), **given)


def test_the_intervals_of_four_tanks_hold_what_the_data_were_made_with():
    """95 % intervals of two valves and an outlet from noisy levels: the share that holds the truth is binomial."""
    model = smpl.compile(PROBLEMS / "four_tanks.eq", observation="noisy", settings={"max_steps": 60})
    env = smpl.Env(model, normalize=False)
    truth = {"gamma_1": 0.66, "gamma_2": 0.63, "a_1": 0.073}
    inside = 0
    for seed in range(12):
        episode = run_episode(env, Uniform(), seed, {"parameters": truth})
        found = smpl.fit(model, episode, truth)
        inside += sum(low <= truth[name] <= high for name, (low, high) in found.interval.items())
        assert found.success
    # 36 draws at 95 %: 34.2 +- 1.3.
    assert 30 <= inside <= 36


def test_the_table_of_the_command_and_its_fit(tmp_path):
    model, out = tmp_path / "decay.eq", tmp_path / "run.csv"
    model.write_text(DECAY)
    command = ["simulate", str(model), "--set", "k=0.7", "--out", str(out)]
    assert main(command) == 0
    scenario = tmp_path / "found.yaml"
    result = subprocess.run(
        [sys.executable, "-m", "smpl.fit", str(model), "--data", str(out), "--parameters", "k", "--out", str(scenario)],
        capture_output=True, text=True,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("k = 0.7 ") and not result.stderr
    assert smpl.compile(model, scenario=scenario).native.defaults("parameter")[0] == pytest.approx(0.7, abs=1e-4)
    result = subprocess.run(
        [sys.executable, "-m", "smpl.fit", str(model), "--data", str(out), "--parameters", "kk"],
        capture_output=True, text=True,
    )  # fmt: skip
    assert result.returncode == 1 and "unknown 'kk'; there are: k, a, b, idle" in result.stderr
    bare = tmp_path / "bare.csv"
    rows = "\n".join(f"{t},0,{3 * np.exp(-0.7 * t)}" for t in TIMES)
    bare.write_text(f"time,u,obs.x\n{rows}\n")
    result = subprocess.run(
        [sys.executable, "-m", "smpl.fit", str(model), "--data", str(bare), "--parameters", "k"],
        capture_output=True, text=True,
    )  # fmt: skip
    assert result.returncode == 0 and result.stdout.startswith("k = 0.7 ")
    assert result.stderr.startswith("warning: ") and "bare.csv does not say where x started" in result.stderr


def test_the_profile_of_a_rate_is_the_sum_of_squares_of_the_closed_form(readings):
    from smpl.analysis.profiles import profile

    values = np.linspace(0.55, 0.9, 8)
    found = profile(decay("noisy"), table(readings), ["k"], "k", values, initial=["x"])
    # For each rate the start that fits best is a linear least-squares problem.
    squares = []
    for k in values:
        shape = np.exp(-k * TIMES)
        start = shape @ readings / (shape @ shape)
        squares.append((((readings - start * shape) / 0.05) ** 2).sum())
    best, _ = optimize.curve_fit(lambda t, k, x: x * np.exp(-k * t), TIMES, readings, [0.3, 3.0])
    least = (((readings - best[1] * np.exp(-best[0] * TIMES)) / 0.05) ** 2).sum()
    np.testing.assert_allclose(found.excess, np.array(squares) - least, rtol=1e-4, atol=1e-4)
    low, high = found.interval
    assert 0.55 < low < best[0] < high < 0.9


# ---- Derivatives ----

MASSES = """model Relay "a tank that is heated until it is warm, by a switch"
time t : h
param k : 1/h = 0.3 in 0.01..5
param level = 1 in 0.1..3
param dose = 0.4 in 0..2
param amplitude : 1/h = 0 in -2..2
discrete kept = 0
action u = 0 in -1..1
state x = 3 in 0..10
eq d/dt x = -k*x + amplitude*sin(t * 1[1/h])
{}
observe x in 0..10
level noisy {{ observe x in 0..10 noise normal(0, 0.05) }}
level late {{ observe x in 0..10 every 3 delay 2 noise normal(0, 0.05) }}
reward r default = -x
episode {{ step = 0.25 [h], max_steps = 40, error_reward = 0 }}
solver {{ rtol = 1e-10 }}
"""


def slopes(model, record, parameters, initial=(), **options):
    """Jacobian of the weighted residuals by what is fitted, in units, and how it was computed."""
    from smpl.analysis.least_squares import Problem

    problem = Problem(model, record, parameters, smpl.FitOptions(initial=initial, method=options.get("method", "auto")))
    problem.choose(options.get("derivatives", "auto"))
    return problem.slopes(problem.guess / problem.scale) / problem.scale, problem.kind_of_derivatives()


@pytest.mark.parametrize("method", ["auto", None])
def test_derivatives_are_those_of_the_closed_form(method):
    """x = x_0 exp(-k t) + amplitude * (k sin t - cos t + exp(-k t))/(1 + k^2), about an amplitude of 0."""
    model = smpl.compile(source=MASSES.format(""), observation="noisy")
    record = table(np.ones(41))
    found, wording = slopes(model, record, ["k", "amplitude"], ["x"], method=method)
    k = 0.3
    by_amplitude = (k * np.sin(TIMES) - np.cos(TIMES) + np.exp(-k * TIMES)) / (1 + k**2)
    expected = np.stack([-3 * TIMES * np.exp(-k * TIMES), by_amplitude, np.exp(-k * TIMES)], axis=1) / 0.05
    assert wording == "exact"
    np.testing.assert_allclose(found, expected, atol=2e-5 * np.abs(expected).max())


def test_a_late_reading_has_the_derivative_of_its_sample():
    model = smpl.compile(source=MASSES.format(""), observation="late")
    found, wording = slopes(model, table(np.ones(41)), {"k": 0.7})
    samples = 0.25 * np.array([0, *range(3, 39, 3)])
    assert wording == "exact" and len(found) == len(samples)
    np.testing.assert_allclose(found[:, 0], -3 * samples * np.exp(-0.7 * samples) / 0.05, atol=1e-3)


def test_derivatives_pass_an_event():
    """The tank is filled by a dose when it falls to the level: x = (level + dose) exp(-k (t - tau)) after that."""
    text = MASSES.format("event low when x < level\nat low { reset x = x + dose }")
    model = smpl.compile(source=text, observation="noisy", settings={"level": 1.3})
    found, wording = slopes(model, table(np.ones(41)), ["k", "level", "dose"])
    k, level, dose = 0.3, 1.3, 0.4
    first = np.log(3 / level) / k
    second = first + np.log((level + dose) / level) / k
    between = (first < TIMES) & (second > TIMES)
    assert wording == "exact" and between.sum() == 3
    # x = (level + dose)/level * 3 exp(-k t).
    factor, x = (level + dose) / level, 3 * np.exp(-k * TIMES[between])
    expected = np.stack([-factor * TIMES[between] * x, -dose / level**2 * x, x / level], axis=1) / 0.05
    np.testing.assert_allclose(found[between], expected, rtol=1e-5, atol=1e-3)


def test_what_a_step_does_not_show_is_found_and_differences_are_taken():
    """A discrete variable that keeps the state of before acts on the next step: the chain of steps misses it."""
    text = MASSES.format("at end { next kept = x }").replace("-k*x", "-k*x + 0.2[1/h]*kept")
    model = smpl.compile(source=text, observation="noisy")
    exact = slopes(model, table(np.ones(41)), ["k"], derivatives="differences")
    found, wording = slopes(model, table(np.ones(41)), ["k"])
    assert wording.startswith("differences: run 0, step 1: how Relay goes on depends on more than its states")
    np.testing.assert_array_equal(found, exact[0])
    with pytest.raises(smpl.SimulationError, match="depends on more than its states"):
        smpl.fit(model, table(np.ones(41)), ["k"], derivatives="exact")


def test_a_memory_that_moves_nothing_yet_is_found_too():
    """The kept state acts through a parameter of which the first guess is 0."""
    text = MASSES.format("at end { next kept = x }").replace("amplitude*sin(t * 1[1/h])", "amplitude*kept")
    model = smpl.compile(source=text, observation="noisy")
    found, wording = slopes(model, table(np.ones(41)), ["amplitude"])
    assert wording == "differences: Relay remembers more than its states, which steps do not show"
    assert np.abs(found[-1]) > 10


def test_equations_that_round_a_state_are_fitted_with_exact_derivatives(readings):
    text = MASSES.format("").replace("-k*x", "-k*x + 0.001[1/h]*floor(x)")
    model = smpl.compile(source=text, observation="noisy", settings={"rtol": 1e-8})
    found = smpl.fit(model, table(readings), ["k"])
    assert found.derivatives == "exact"
    # The rate of the data is 0.7.
    assert abs(found.parameters["k"] - 0.7) < 0.05


def test_many_states_for_few_parameters_are_differences():
    rows = np.tile(smpl.compile("atropine").native.defaults("action"), (3, 1))
    model = smpl.compile("atropine")
    record = dict(zip(model.action_names, rows.T, strict=True)) | {f"obs.{model.observation_names[0]}": np.ones(3)}
    from smpl.analysis.least_squares import Problem

    with pytest.warns(UserWarning, match="does not say where .* more started: the nominal start is taken"):
        problem = Problem(model, record, [model.parameter_names[0]], smpl.FitOptions())
    problem.choose("auto")
    assert problem.kind_of_derivatives() == f"differences: exact ones would be by {len(model.state_names) + 1} numbers"


def test_an_unstable_run_needs_exact_derivatives():
    """x grows by e^20, and half a per cent of the rate is a tenth of what is measured at the end."""
    text = DECAY.replace("= 0.3 in 0.01..5", "= -2 in -5..5").replace("in 0..10", "in 0..1e12")
    # It begins at a part in 1e15 of its range: so small has the absolute tolerance to be.
    text += "solver { atol_factor = 1e-15 }\n"
    model = smpl.compile(source=text, observation="noisy", settings={"rtol": 1e-10})
    truth, start = -2.003, 1e-3
    data = start * np.exp(-truth * TIMES)
    record = table(data, x=np.where(np.arange(41), np.nan, start))
    found = smpl.fit(model, record, ["k"])
    assert found.derivatives == "exact" and found.success
    assert found.parameters["k"] == pytest.approx(truth, rel=1e-8)


# ---- What a fit says ----


def test_a_value_at_a_bound_is_named(readings):
    text = DECAY.replace("in 0.01..5", "in 0.01..0.5")
    found = smpl.fit(smpl.compile(source=text), table(readings), ["k"])
    assert found.at_bounds == ("k",) and "at a bound of the file: k" in str(found)


def test_a_start_that_is_not_recorded_is_said(readings):
    record = {name: values for name, values in table(readings).items() if name != "x"}
    with pytest.warns(UserWarning, match="run 0 does not say where x started: the nominal start is taken, or name it"):
        smpl.fit(decay("noisy"), record, ["k"])


def test_the_picture_has_a_row_for_each_output_and_residuals_beside(readings):
    pytest.importorskip("matplotlib")
    found = smpl.fit(decay("noisy"), [table(readings), table(readings)], ["k"])
    axes = found.figure().axes
    assert [axis.get_title(loc="left") for axis in axes] == ["x", "residual / deviation"]
    assert all(len(axis.get_xticks()) > 1 and len(axis.get_yticks()) > 1 for axis in axes)
    assert len(axes[0].lines) == 4  # points and a line of each run
    points, line = axes[0].lines[:2]
    np.testing.assert_allclose(points.get_ydata(), readings)
    np.testing.assert_allclose(line.get_ydata(), 3 * np.exp(-found.parameters["k"] * TIMES), rtol=1e-4)
    np.testing.assert_allclose(axes[1].lines[0].get_ydata(), (readings - line.get_ydata()) / 0.05, rtol=1e-6, atol=1e-9)


def test_what_has_not_converged_says_so(readings):
    found = smpl.fit(decay("noisy"), table(readings), ["k"], iterations=1)
    assert not found.success and "not converged" in str(found)
    assert "not converged" not in str(smpl.fit(decay("noisy"), table(readings), ["k"]))


def test_a_word_that_is_no_kind_of_derivatives_is_refused(readings):
    with pytest.raises(ValueError, match="derivatives is 'precise', expected one of auto, exact, differences"):
        smpl.fit(decay(), table(readings), ["k"], derivatives="precise")


# ---- The study of `python -m smpl.bench fit`, small ----


@pytest.mark.parametrize("number", range(3))
def test_intervals_hold_the_truth_and_scipy_says_the_same(number):
    from smpl_benchmarks.peers.fit import study
    from smpl_benchmarks.peers.fit_cases import CASES, Peer

    case = CASES[number]
    found = study(case, 8)
    assert found.derivatives == {"exact"}
    # Of 8 draws at 95 % fewer than 6 are inside in one of 170 studies.
    assert all(count >= 5 for count in found.inside.values())
    model = case.model()
    peer = Peer(case, model, case.record(model, 0)).solve()
    defaults = dict(zip(model.parameter_names, model.native.defaults("parameter").tolist(), strict=True))
    theirs = peer.x[: len(case.truth)] * [defaults[name] for name in case.truth]
    assert (np.abs(found.estimates[0] - theirs) < 1e-2 * found.widths[0]).all()


@pytest.mark.parametrize("normalize", [True, False])
def test_a_data_set_is_many_runs(tmp_path, normalize):
    """The same as the episodes that it was made of; its observations are in single precision."""
    pytest.importorskip("pyarrow")
    from smpl.datasets import collect, load

    model = smpl.compile("reactor", observation="online")
    options = {"observation": "online", "max_steps": 20, "normalize": normalize}
    data = collect("reactor", "pid", 3, tmp_path / "pid", states=True, seed=5, **options)
    env = smpl.Env("reactor", **options)
    from smpl.controllers import baseline

    episodes = [run_episode(env, baseline("reactor", "pid"), seed) for seed in (5, 6, 7)]
    expected = smpl.fit(model, episodes, ["U"])
    for runs in (data, load(tmp_path / "pid"), tmp_path / "pid"):
        found = smpl.fit(model, runs, ["U"])
        assert found.parameters["U"] == pytest.approx(expected.parameters["U"], rel=1e-5)
        assert found.interval["U"] == pytest.approx(expected.interval["U"], rel=1e-4)
    with pytest.raises(ValueError, match="the data set has the observations T, h, Reactor has c_A, T, h"):
        smpl.fit(smpl.compile("reactor"), data, ["U"])


DRAWN = """model Drawn
time t : h
param k : 1/h = 0.3 in 0.01..5
param half : 1/h = k/2
param c = 1 ~ normal(1, 0.2)
param d = 1 ~ k/0.3[1/h] + uniform(0, 0.2)
action u = 0 in -1..1
discrete n = 0
at end { next n = n + 1 }
disturbance w ~ normal(0, 0.1)
state x = 3 in 0..10
eq d/dt x = -2*half*c*x*(1 + w)
state y = 1 in 0..10
eq d/dt y = -k*d*y
observe x in 0..10
observe y in 0..10
reward r default = -x
episode { step = 0.25 [h], max_steps = 10, error_reward = 0 }
"""


def test_what_was_drawn_for_an_episode_is_known_of_it():
    """A rate that is drawn, multiplied with disturbances, in the closed form; another one that is set, and halved."""
    model = smpl.compile(source=DRAWN, settings={"rtol": 1e-10})
    env = smpl.Env(model, normalize=False)
    episodes = [run_episode(env, OpenLoop([[0.0]] * 10), seed, {"parameters": {"k": 0.7}}) for seed in (1, 2)]
    for episode in episodes:
        rates = 0.7 * episode.details.parameters["c"] * (1 + episode.details.disturbances["w"])
        np.testing.assert_allclose(episode.states[1:, 0], 3 * np.exp(-0.25 * np.cumsum(rates)), rtol=1e-7)
    assert episodes[0].details.parameters["c"] != episodes[1].details.parameters["c"]
    # `half` follows the rate that is fitted, and `d`, of which a part was drawn, stays what it was.
    for kind in ("exact", "differences"):
        found = smpl.fit(model, episodes, {"k": 0.3}, derivatives=kind)
        assert found.parameters["k"] == pytest.approx(0.7, rel=1e-5)
        assert max(np.nanmax(np.abs(one[name])) for one in found.residuals for name in ("x", "y")) < 1e-5
    with pytest.warns(UserWarning, match="c is fitted as one number, and was"):
        smpl.fit(model, episodes, ["c"])


@pytest.mark.parametrize("name", ["reactor", "beer", "pensim", "atropine", "mab", "mab_plant"])
def test_a_recorded_episode_is_simulated_again_to_the_bit(name):
    from smpl.analysis.records import read_runs

    env = smpl.Env(name, normalize=False, max_steps=4)
    episode = run_episode(env, Nominal(), 5)
    (run,) = read_runs(env.model, [episode])
    found = env.model.rollout(
        run.states, run.actions, parameters=run.parameters, discrete=run.discrete, disturbances=run.disturbances
    )
    np.testing.assert_array_equal(found.states[0], episode.states)


def test_a_batch_of_pensim_with_its_draws_gives_the_yields_that_it_was_made_with():
    env = smpl.Env("pensim", normalize=False, max_steps=60)
    batches = [run_episode(env, Nominal(), seed, {"parameters": {"Y_sX": 1.7}}) for seed in (5, 6)]
    assert {"mux_max", "mu_p", "alpha_kla", "c_0"} < set(batches[0].details.parameters)
    found = smpl.fit(env.model, batches, {"Y_sX": 1.8}, outputs=["S", "DO2"])
    assert found.parameters["Y_sX"] == pytest.approx(1.7, rel=1e-4)


def test_an_episode_that_does_not_say_what_was_drawn_is_refused():
    model = decay()
    episode = run_episode(smpl.Env(model, normalize=False), OpenLoop([[0.0]] * 40), 1)
    with pytest.raises(ValueError, match=r"run 0 has no readings in physical units \(`details.readings`\): make it by"):
        smpl.fit(model, [replace(episode, details=None)], ["k"])
    with pytest.raises(ValueError, match="run 0 has no readings in physical units"):
        smpl.fit(model, [replace(episode, details=replace(episode.details, readings=None))], ["k"])
    with pytest.raises(ValueError, match="run 0 has the parameters c, which Decay has not"):
        smpl.fit(model, [replace(episode, details=replace(episode.details, parameters={"c": 1.0}))], ["k"])


PLAIN = """model Plain
time t : h
param k : 1/h = 0.2 in 0.01..10
param g = 1 in 0..10
disturbance w = 0 ~ normal(0, 1)
state x = 2 in -10..10
eq d/dt x = -k*x + w/1 [h]
observe y = g*x in -100..100 noise normal(0, 0.01)
episode { step = 0.5, max_steps = 10, error_reward = -1 }
"""


def test_a_model_without_actions_is_fitted():
    """SciPy's fit of the closed form."""
    from scipy.optimize import curve_fit

    times = 0.5 * np.arange(11)
    read = 3 * np.exp(-0.7 * times) + np.random.default_rng(0).normal(0, 0.01, 11)
    expected, covariance = curve_fit(
        lambda t, k, g: 2 * g * np.exp(-k * t), times, read, [0.2, 1], np.full(11, 0.01), absolute_sigma=True
    )
    model = smpl.compile(source=PLAIN, settings={"rtol": 1e-10})
    for kind in ("exact", "differences"):
        found = smpl.fit(
            model, {"time": times, "x": [2.0, *[np.nan] * 10], "obs.y": read}, ["k", "g"], derivatives=kind
        )
        np.testing.assert_allclose([found.parameters["k"], found.parameters["g"]], expected, rtol=1e-6)
        np.testing.assert_allclose(found.covariance, covariance, rtol=1e-4)


def test_every_run_of_a_table_of_many_is_one(tmp_path):
    """x follows `x e^(-k h) + w (1 - e^(-k h))/k` with the disturbance of the step that a row ends."""
    (tmp_path / "plain.eq").write_text(PLAIN)
    k, g, count = 0.7, 1.5, 6
    rows = ["run,step,time,x,w,obs.y"]
    for run in range(2):
        # A value at the start is not a disturbance of a step.
        x, w = 2.0 + run, [9.0, *np.random.default_rng(run).normal(0, 1, count)]
        for step in range(count + 1):
            if step:
                x = x * np.exp(-k / 2) + w[step] * (1 - np.exp(-k / 2)) / k
            rows.append(",".join(map(repr, (run, step, step / 2, float(x), float(w[step]), float(g * x)))))
    table = tmp_path / "all.csv"
    table.write_text("\n".join(rows) + "\n")
    model = smpl.compile(tmp_path / "plain.eq", settings={"rtol": 1e-10})
    found = smpl.fit(model, table, ["k", "g"])
    assert (found.parameters["k"], found.parameters["g"]) == pytest.approx((k, g), rel=1e-6)
    assert len(found.residuals) == 2


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ("step,x,w,obs.y\n1,2,0,2\n2,2,0,2\n", "the column step begins with 1, expected 0"),
        ("step,x,w,obs.y\n0,2,0,2\n2,2,0,2\n", "the column step says 2 in row 1, expected 1"),
        ("step,x,w,obs.y\n0,2,0,2\n1,2,0,2\n0,2,0,2\n", "run 1 has no steps behind its start"),
        ("step,x,w,obs.y\n0,2,0,2\n1,2,,2\n", "the disturbance w is missing in row 1"),
        ("step,x,w,w,obs.y\n0,2,0,0,2\n1,2,0,0,2\n", "two columns named 'w'"),
    ],
)
def test_tables_that_are_no_runs_are_refused(tmp_path, table, says):
    file = tmp_path / "t.csv"
    file.write_text(table)
    with pytest.raises(ValueError, match=says) as error:
        smpl.fit(smpl.compile(source=PLAIN), file, ["k"])
    assert "t.csv" in str(error.value)
