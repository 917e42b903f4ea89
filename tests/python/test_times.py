"""Tables whose rows have arbitrary times: replays of inputs, and fits to samples at any times."""

import subprocess
import sys

import numpy as np
import pytest

import smpl
from smpl.analysis.profiles import profile
from smpl.commands.main import main
from smpl.support.files import model_path

optimize = pytest.importorskip("scipy.optimize")

LINE = """model Line
time t : h
param k : 1/h = 1 in 0..10
state x = 0 in -100..100
eq d/dt x = k
observe x
reward r = x
episode { step = 1 [h], max_steps = 10, error_reward = 0 }
"""
# x' = k (u - x) with steps of 2: held inputs have a closed form.
LAG = """model Lag
time t : min
param k : 1/min = 0.2 in 0.01..5
action u = 0 in -100..100
disturbance d = 0 ~ 0 in -100..100
state x = 0 in -1000..1000
eq d/dt x = k*(u + d - x)
observe x
level rare { observe x every 2 delay 1 }
reward r = x
episode { step = 2 [min], max_steps = 60, error_reward = 0 }
solver { rtol = 1e-10 }
"""


def replay(tmp_path, text, source=LAG, *more):
    """States after each step of a replayed table."""
    (tmp_path / "lag.eq").write_text(source)
    (tmp_path / "a.csv").write_text(text)
    out = tmp_path / "t.csv"
    assert (
        main(
            ["simulate", str(tmp_path / "lag.eq"), *(more or ("--actions", str(tmp_path / "a.csv"))), "--out", str(out)]
        )
        == 0
    )
    return np.genfromtxt(out, delimiter=",", names=True)


def held(inputs, k=0.2, h=2.0):
    """States of x' = k (u - x) from 0 with these inputs, one a step."""
    x = [0.0]
    for u in inputs:
        x.append(u + (x[-1] - u) * np.exp(-k * h))
    return x


def test_samples_at_irregular_times_give_the_slope_of_a_line():
    model = smpl.compile(source=LINE)
    times = np.array([0.0, 1, 2, 5, 10])
    found = smpl.fit(model, {"time": times, "x": times}, ["k"], outputs=["x"])
    assert found.parameters["k"] == pytest.approx(1, rel=1e-9)
    halves = np.arange(0, 5, 0.5)
    found = smpl.fit(model, {"time": halves, "x": 0.5 * halves}, ["k"], outputs=["x"])
    assert found.parameters["k"] == pytest.approx(0.5, rel=1e-9)


@pytest.mark.parametrize("method", ["auto", "ida", "rosenbrock", "explicit"])
def test_a_fit_to_irregular_samples_is_that_of_the_closed_form(method):
    """Times that no sampling interval has; SciPy fits the closed form of a step response."""
    model = smpl.compile(source=LAG)
    rng = np.random.default_rng(1)
    times = np.sort(rng.uniform(0.3, 39, 25))
    read = 10 * (1 - np.exp(-0.31 * times)) + rng.normal(0, 0.3, 25)
    exact, covariance = optimize.curve_fit(
        lambda t, k: 10 * (1 - np.exp(-k * t)), times, read, 0.2, ftol=1e-14, xtol=1e-14
    )
    table = {"time": [0.0, *times], "u": [10.0, *np.full(25, np.nan)], "x": [0.0, *np.full(25, np.nan)]}
    found = smpl.fit(model, {**table, "obs.x": [np.nan, *read]}, ["k"], method=method)
    assert found.parameters["k"] == pytest.approx(exact[0], rel=1e-6)
    assert found.covariance[0, 0] == pytest.approx(covariance[0, 0], rel=1e-3)
    np.testing.assert_allclose(found.times[0][np.isfinite(found.residuals[0]["x"])], times)


def test_samples_of_several_rates_share_a_table():
    """Inputs every 10, one state at odd times, the other at others; SciPy integrates the two tanks with the steps."""
    source = LAG.replace("observe x", "state y = 0 in -1000..1000\neq d/dt y = 0.5*(x - y)*1[1/min]\nobserve x, y", 1)
    model = smpl.compile(source=source)
    times = np.arange(0, 41, 1.0)
    u = np.where(times % 10 == 0, 5 + times / 10, np.nan)

    def course(k):
        from scipy.integrate import solve_ivp

        def rates(t, s):
            return [k * (5 + min(int(t / 10 + 1e-9), 4) - s[0]), 0.5 * (s[0] - s[1])]

        parts, start = [np.zeros((2, 1))], np.zeros(2)
        for a in range(0, 40, 10):
            found = solve_ivp(
                rates, (a, a + 10 - 1e-9), start, t_eval=[*range(a + 1, a + 10), a + 10 - 1e-9], rtol=1e-10, atol=1e-12
            )
            parts.append(found.y)
            start = found.y[:, -1]
        return np.concatenate(parts, axis=1)

    truth = course(0.37) + np.random.default_rng(2).normal(0, 0.05, (2, 41))
    x, y = np.where(times % 7 == 3, truth[0], np.nan), np.where(times % 5 == 2, truth[1], np.nan)

    def residual(k):
        away = course(k[0]) - np.stack([x, y])
        return away[np.isfinite(away)] / 0.05

    exact = optimize.least_squares(residual, [0.2])
    table = {
        "time": times,
        "u": u,
        "obs.x": x,
        "obs.y": y,
        "x": np.where(times, np.nan, 0),
        "y": np.where(times, np.nan, 0),
    }
    found = smpl.fit(model, table, ["k"], noise={"x": 0.05, "y": 0.05})
    assert found.parameters["k"] == pytest.approx(exact.x[0], rel=1e-5)
    assert found.residual_norm == pytest.approx(np.linalg.norm(exact.fun), rel=1e-5)


def test_a_sample_of_a_rare_and_late_sensor_counts_at_its_time():
    model = smpl.compile(source=LAG, observation="rare")
    times = np.arange(0, 21, 2.0)
    read = 10 * (1 - np.exp(-0.31 * times))
    table = {"time": times, "u": np.full(11, 10.0), "obs.x": read, "x": np.where(times, np.nan, 0)}
    found = smpl.fit(model, table, ["k"])
    assert found.parameters["k"] == pytest.approx(0.31, rel=1e-5)
    assert np.isfinite(found.residuals[0]["x"]).sum() == 11


def test_a_sample_within_a_step_sees_what_happens_at_its_ends():
    """A counter that moves at the start of each step: within step k the rate is k + 1."""
    source = LINE.replace("eq d/dt x = k", "discrete n = 0\nat start { next n = n + 1 }\neq d/dt x = k*n")
    times = np.array([0, 0.5, 1.25, 2.5])
    table = {"time": times, "x": 0.7 * np.array([0, 0.5, 1 + 0.5, 1 + 2 + 1.5])}
    found = smpl.fit(smpl.compile(source=source), table, ["k"], outputs=["x"])
    assert found.parameters["k"] == pytest.approx(0.7, rel=1e-8)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"time": [0.0, 2, 1, 3, 4]}, r"the column time has 1 in row 2, after 2; times must increase"),
        ({"time": [0.0, 1, np.nan, 3, 4]}, r"the column time has no finite number in row 2"),
        ({"time": [-1.0, 0, 1, 2, 3]}, r"the column time has -1 in row 0; a run begins at 0"),
        ({"step": np.arange(5.0), "time": [0.0, 2, 5, 6, 8]}, r"the column time has 5 in row 2, whose step ends at 4"),
        ({"u": [1.0, np.inf, 1, 1, 1]}, r"u has no finite number in row 1"),
        ({"obs.x": [0.0, 1, np.inf, 1, 1]}, r"x has no finite number in row 2"),
        ({"u": [np.nan, np.nan, 1, 1, np.nan]}, r"u ends at 6, before the last sample at 8"),
        ({"time": [1.0, 2, 3, 4, 5], "u": np.full(5, np.nan)}, r"u: there is no value"),
    ],
)
def test_times_and_values_that_do_not_fit_are_refused_by_row(change, says):
    table = {"time": [0.0, 2, 4, 6, 8], "u": np.ones(5), "obs.x": np.arange(5.0), "x": [0.0, *[np.nan] * 4]}
    with pytest.raises(ValueError, match=says):
        smpl.fit(smpl.compile(source=LAG), {**table, **change}, ["k"])


def test_a_text_in_a_column_that_is_read_is_refused_by_row(tmp_path):
    (tmp_path / "run.csv").write_text("time,u,x,obs.x,remark\n0,1,0,0,good\n2,1,,bad,good\n4,1,,0.3,good\n")
    with pytest.raises(ValueError, match="x has no finite number in row 1"):
        smpl.fit(smpl.compile(source=LAG), tmp_path / "run.csv", ["k"])


def test_names_given_twice_are_refused():
    table = {"time": [0.0, 1, 2], "x": [0.0, 1, 2]}
    for options in ({"parameters": ["k", "k"]}, {"parameters": ["k"], "outputs": ["x", "x"]}):
        with pytest.raises(ValueError, match="more than once"):
            smpl.fit(smpl.compile(source=LINE), table, **options)


# ---- Replays on the command line ----


def test_a_slow_log_is_held_over_the_steps_between(tmp_path):
    rows = replay(tmp_path, "time,u\n0,5\n10,1\n20,3\n")
    np.testing.assert_allclose(rows["x"], held([5] * 5 + [1] * 5 + [3] * 5), atol=1e-7)
    rows = replay(tmp_path, "time,u\n0,\n10,5\n20,1\n")  # as in written tables, a value belongs to what ends there
    np.testing.assert_allclose(rows["x"], held([5] * 5 + [1] * 5), atol=1e-7)


def test_a_log_is_a_line_between_its_times_where_that_is_asked_for(tmp_path):
    rows = replay(tmp_path, "time,u\n0,0\n10,10\n", LAG, "--resample", "linear", "--actions", str(tmp_path / "a.csv"))
    np.testing.assert_allclose(rows["x"], held([1, 3, 5, 7, 9]), atol=1e-7)  # means over the steps


def test_disturbances_have_times_too(tmp_path):
    rows = replay(
        tmp_path, "time,d\n0,5\n10,1\n20,3\n", LAG, "--disturbances", str(tmp_path / "a.csv"), "--steps", "15"
    )
    np.testing.assert_allclose(rows["x"], held([5] * 5 + [1] * 5 + [3] * 5), atol=1e-7)


def test_a_change_within_a_step_is_reported(tmp_path, capfd):
    rows = replay(tmp_path, "time,u\n0,4\n3,8\n6,8\n")
    np.testing.assert_allclose(rows["x"][:4], held([4, 6, 8]), atol=1e-7)
    assert (
        "`u` changes within step 2; a step has one value of an input, the mean over the step" in capfd.readouterr().err
    )


@pytest.mark.parametrize(
    ("text", "says", "line"),
    [
        ("time,u\n0,1\n4,1\n2,1\n", "the column `time` has 2 after 4; times must increase", 4),
        ("time,u\n0,1\nsoon,1\n", "column `time`: `soon` is not a finite number", 3),
        ("time,u\n-2,1\n0,1\n", "the column `time` has -2; a run begins at 0", 2),
        ("step,time,u\n1,10,1\n2,20,1\n", "the column `time` has 10 at step 1, which ends at 2", 2),
        ("time,u\n0,\n1,1\n", "column `u`: the record ends before the end of the first step, 2", 3),
    ],
)
def test_tables_that_do_not_fit_a_run_are_refused(tmp_path, capfd, text, says, line):
    (tmp_path / "lag.eq").write_text(LAG)
    (tmp_path / "a.csv").write_text(text)
    assert main(["simulate", str(tmp_path / "lag.eq"), "--actions", str(tmp_path / "a.csv")]) == 1
    shown = " ".join(capfd.readouterr().err.split())
    assert says in shown and f"a.csv:{line}:" in shown


@pytest.mark.parametrize("name", ["reactor", "pensim"])
def test_a_written_table_is_replayed_to_the_bit(tmp_path, name):
    first, again = tmp_path / "first.csv", tmp_path / "again.csv"
    name, has_disturbances = str(model_path(name)), name == "pensim"
    assert main(["simulate", name, "--policy", "random", "--steps", "20", "--out", str(first), "--seed", "3"]) == 0
    more = ["--disturbances", str(first)] if has_disturbances else []
    assert (
        main(["simulate", name, "--actions", str(first), "--steps", "20", *more, "--out", str(again), "--seed", "3"])
        == 0
    )
    assert first.read_text() == again.read_text()


# ---- Profiles ----


def michaelis(points, noise=0.02):
    """Rates of a reaction at concentrations far below its constant, and a model whose states are the products."""
    source = """model Enzyme
time t : min
param Vm : mol/(L min) = 10 in 0.001..1000
param Km : mol/L = 100 in 0.01..10000
action S : mol/L = 1 in 0..1000
state P : mol/L = 0 in 0..1e6
eq d/dt P = Vm*S/(Km + S)
observe P
reward r = P/1[mol/L]
episode { step = 1 [min], max_steps = 1, error_reward = 0 }
"""
    rng = np.random.default_rng(7)
    S = np.linspace(0.5, 3, points)
    rates = 1.0 * S / (30 + S) * (1 + rng.normal(0, noise, points))
    runs = [{"S": [np.nan, s], "P": [0, np.nan], "obs.P": [np.nan, v]} for s, v in zip(S, rates, strict=True)]
    return smpl.compile(source=source), runs, S, rates


def squares(S, rates, Km=None, Vm=None, deviation=2e-3, bounds=(0.01, 10000)):
    """Least sum of squares with one parameter held: over a fine grid of the other one, and its best scale."""
    if Km is not None:
        shape = S / (Km + S)
        return (((rates - shape * (shape @ rates) / (shape @ shape)) / deviation) ** 2).sum()
    grid = np.geomspace(*bounds, 20001)[:, None]
    return (((rates - Vm * S / (grid + S)) / deviation) ** 2).sum(axis=1).min()


def test_a_profile_is_followed_to_its_crossing_and_open_at_a_bound():
    model, runs, S, rates = michaelis(8)
    options = {"outputs": ["P"], "noise": {"P": 2e-3}}
    found = profile(model, runs, ["Vm", "Km"], "Km", **options)
    best = min(squares(S, rates, Km=K) for K in np.geomspace(0.01, 10000, 4001))
    low = optimize.brentq(lambda K: squares(S, rates, Km=K) - best - 3.841459, 5, 25)
    assert squares(S, rates, Km=10000) - best < 3.84
    assert found.interval[0] == pytest.approx(low, rel=2e-2) and found.interval[1] == np.inf
    found = profile(model, runs, ["Vm", "Km"], "Vm", **options)
    low = optimize.brentq(lambda V: squares(S, rates, Vm=V) - best - 3.841459, 0.1, 0.9)
    assert found.interval[0] == pytest.approx(low, rel=2e-2) and found.interval[1] > 1


def test_the_interval_of_a_fit_at_a_bound_is_infinite():
    model, runs, S, rates = michaelis(8)
    rates = rates[0] * S / S[0]  # a straight line: no constant is large enough
    for run, rate in zip(runs, rates, strict=True):
        run["obs.P"] = [np.nan, rate]
    with pytest.warns(UserWarning, match="the fit ends at a bound of .*: intervals are infinite"):
        found = smpl.fit(model, runs, ["Vm", "Km"], outputs=["P"], noise={"P": 2e-3})
    assert found.at_bounds and all(np.isinf(one).all() for one in found.interval.values())


def test_the_fit_command_takes_the_course_of_inputs(tmp_path):
    (tmp_path / "lag.eq").write_text(LAG)
    x = held([1, 3, 5, 7, 9], k=0.3)
    rows = [f"{t},{t},{'0' if t == 0 else ''},{x[t // 2] if t in (4, 10) else ''}" for t in (0, 4, 10)]
    (tmp_path / "run.csv").write_text("\n".join(["time,u,x,obs.x", *rows]) + "\n")
    command = [sys.executable, "-m", "smpl.fit", str(tmp_path / "lag.eq"), "--data", str(tmp_path / "run.csv")]
    done = subprocess.run([*command, "--parameters", "k", "--resample", "linear"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[2]) == pytest.approx(0.3, rel=1e-4)
