"""Parameters from runs, against SciPy's fits of closed forms and against what the data were made with."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import smpl
from smpl._cli import main
from smpl.controllers import OpenLoop, Uniform
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
    with pytest.raises(ValueError, match="the runs say nothing about idle: x do not depend on it"):
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
        ({"runs": 3}, "run 0 is int, expected a path, an episode or a mapping"),
    ],
)
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


def test_the_profile_of_a_rate_is_the_sum_of_squares_of_the_closed_form(readings):
    from smpl.profiles import profile

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
