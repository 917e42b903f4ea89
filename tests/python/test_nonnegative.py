"""States that never fall below zero: no step and no report is negative, and answers are those of closed forms.

Expected values are closed forms, derived next to each model, or SciPy's Radau method at a tolerance of 1e-10.
"""

import re
import zipfile

import numpy as np
import pytest
import scipy.integrate

import smpl

METHODS = ("ida", "rosenbrock", "explicit", "auto")
methods = pytest.mark.parametrize("method", METHODS)
counts = pytest.mark.parametrize("count", [1, 3, 10, 100])


def model(text, horizon, count, rtol=1e-8, further=""):
    episode = f"episode {{ step = {horizon / count!r}, max_steps = {count} }}\nsolver {{ rtol = {rtol} }}"
    return smpl.compile(source=f"time t : 1\n{text}\n{episode}\n{further}")


def run(text, horizon, count, method, **options):
    """States after each control step, and the last `info`."""
    env = smpl.Env(model(text, horizon, count, **options), normalize=False, method=method)
    env.reset(seed=0)
    states = [env.state]
    for _ in range(count):
        _, _, terminated, _, info = env.step([])
        states.append(env.state)
        if terminated:
            break
    return np.array(states), info


@methods
@counts
def test_a_tank_runs_dry_in_finite_time_and_stays_empty(count, method):
    # y' = -sqrt(y): y = (1 - t/2)^2 until t = 2.
    states, info = run("state y = 1 nonnegative\neq d/dt y = -sqrt(y)", 5.0, count, method)
    t = np.linspace(0, 5, count + 1)
    assert info["failure"] == ""
    assert states.min() >= 0
    assert states[:, 0] == pytest.approx(np.maximum(1 - t / 2, 0) ** 2, abs=1e-7)


@methods
@counts
def test_a_power_law_decays_without_a_failure(count, method):
    # y' = -k y^2.5: y = (1 + 1.5 k t)^(-2/3).
    states, info = run("param k = 50\nstate y = 1 nonnegative\neq d/dt y = -k*y^2.5", 1e4, count, method)
    t = np.linspace(0, 1e4, count + 1)
    assert info["failure"] == ""
    assert states[:, 0] == pytest.approx((1 + 75 * t) ** (-2 / 3), rel=1e-4, abs=1e-7)


@methods
@counts
@pytest.mark.parametrize("power", ["y^0.3", "sqrt(y)", "y^0.9", "y^1.5"])
def test_a_fed_reaction_of_any_order_settles(count, power, method):
    # The feed ends at t = 1; Radau on the rate at max(y, 0).
    text = f"param k = 20\nstate y = 0 in 0..1 nonnegative\neq d/dt y = (if t < 1 then 1 else 0) - k*{power}"
    states, info = run(text, 4.0, count, method)
    t = np.linspace(0, 4, count + 1)
    exponent = {"sqrt(y)": 0.5}.get(power) or float(power[2:])
    expected = np.zeros(count + 1)

    def rate(_, y, feed):
        return feed - 20 * np.maximum(y, 0) ** exponent

    start = [0.0]
    for begin, end, feed in ((0, 1, 1.0), (1, 4, 0.0)):
        found = scipy.integrate.solve_ivp(
            rate, (begin, end), start, "Radau", dense_output=True, args=(feed,), rtol=1e-10, atol=1e-13
        )
        inside = (t > begin) & (t <= end)
        expected[inside] = [found.sol(time)[0] for time in t[inside]]
        start = found.y[:, -1]
    assert info["failure"] == ""
    assert states.min() >= 0
    assert states[:, 0] == pytest.approx(np.maximum(expected, 0), abs=1e-6)


@methods
@counts
def test_uptake_by_monod_keeps_the_mass(count, method):
    # X + Y S is constant: S is used up, X ends at 0.1 + 0.5.
    text = """param mu = 5
param K = 1e-3
state S = 1 in 0..1 nonnegative
state X = 0.1 in 0..1 nonnegative
let r = mu*S/(K + S)*X
eq d/dt S = -2*r
eq d/dt X = r"""
    states, info = run(text, 10.0, count, method)
    assert info["failure"] == ""
    assert states.min() >= 0
    assert states @ [0.5, 1] == pytest.approx(0.6, abs=1e-6)
    assert states[-1] == pytest.approx([0, 0.6], abs=1e-6)


@pytest.mark.parametrize("method", ["ida", "rosenbrock", "auto"])
@counts
def test_robertson_is_as_without_the_word(count, method):
    # At t = 40: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II.
    text = """state a = 1 nonnegative
state b = 0 scale 1e-4 nonnegative
state c = 0 nonnegative
eq d/dt a = -0.04*a + 1e4*b*c
eq d/dt b = 0.04*a - 1e4*b*c - 3e7*b*b
eq d/dt c = 3e7*b*b"""
    states, info = run(text, 40.0, count, method)
    assert info["failure"] == ""
    assert states.min() >= 0
    assert states[-1] == pytest.approx([0.7158270688, 9.185534765e-6, 0.2841637457], rel=1e-5)


@methods
@counts
@pytest.mark.parametrize("start", [0.5, 0.0])
def test_equations_that_lead_below_zero_fail_by_name(start, count, method):
    # y' = -1: zero at t = start.
    text = f"state x = 1\nstate y = {start} nonnegative\neq d/dt x = -x\neq d/dt y = -1"
    _, info = run(text, 2.0, count, method)
    assert info["failure"].startswith("solver")
    assert "d/dt y" in info["failure"]
    assert "would become negative" in info["failure"]
    failed = float(info["failure"].split(" at t = ")[1].split(",")[0])
    assert failed == pytest.approx(start, abs=1e-5)


@methods
def test_a_state_may_touch_zero_and_rise_again(method):
    # y' = 2 (t - 1), y(0) = 1: y = (t - 1)^2 touches zero at t = 1.
    for count in (1, 3, 10):
        states, info = run("state y = 1 nonnegative\neq d/dt y = 2*(t - 1)", 3.0, count, method)
        assert info["failure"] == ""
        assert states[:, 0] == pytest.approx((np.linspace(0, 3, count + 1) - 1) ** 2, abs=1e-6)


@methods
def test_arrays_and_fields_are_nonnegative_element_by_element(method):
    # y_i = (sqrt(i) - t/2)^2 until t = 2 sqrt(i).
    text = "state y[i in 1..3] = i nonnegative\nstate z = 0\neq d/dt y[i] = -sqrt(y[i]) for i in 1..3\neq d/dt z = -1"
    states, info = run(text, 4.0, 4, method)
    t = np.linspace(0, 4, 5)[:, None]
    assert info["failure"] == ""
    assert states[:, :3] == pytest.approx(np.maximum(np.sqrt([1, 2, 3]) - t / 2, 0) ** 2, abs=1e-6)
    assert states[-1, 3] == pytest.approx(-4)


@methods
def test_derivatives_through_an_empty_tank_are_zero(method):
    # y = (sqrt(y0) - k t/2)^2: dy/dy0 = 1 - k t/(2 sqrt(y0)), dy/dk = -t (sqrt(y0) - k t/2); both 0 once it is empty.
    text = "param k = 1\nstate y = 1 nonnegative\neq d/dt y = -k*sqrt(y)"
    for time, y0 in ((1.0, 1.0), (1.9, 1.0), (3.0, 1.0), (3.0, 0.0)):
        _, by_y, _, by_k = model(text, time, 1).sensitivity([y0], [], parameters=("k",), method=method)
        left = max(np.sqrt(y0) - time / 2, 0)
        assert by_y[0, 0] == pytest.approx(left / max(np.sqrt(y0), 1e-30), abs=1e-3)
        assert by_k[0, 0] == pytest.approx(-time * left, abs=1e-3)


@methods
def test_batches_and_rollouts_keep_states_nonnegative(method):
    # Tanks of depth y0 run dry at 2 sqrt(y0): y = (sqrt(y0) - t/2)^2.
    one = model("state y = 1 nonnegative\ninitial y ~ uniform(0.5, 2)\neq d/dt y = -sqrt(y)\nobserve y", 4.0, 8)
    starts = np.array([0.0, 0.01, 1.0, 2.0])
    t = np.linspace(0, 4, 9)
    expected = np.maximum(np.sqrt(starts)[:, None] - t / 2, 0) ** 2
    found = one.rollout(starts[:, None], np.zeros((4, 8, 0)), method=method)
    assert list(found.failure) == [""] * 4
    assert found.states[:, :, 0] == pytest.approx(expected, abs=1e-7)
    venv = smpl.VectorEnv(one, num_envs=8, normalize=False, method=method)
    venv.reset(seed=1)
    first = venv.state[:, 0].copy()
    for k in range(1, 8):
        venv.step(np.zeros((8, 0)))
        assert venv.state[:, 0] == pytest.approx(np.maximum(np.sqrt(first) - t[k] / 2, 0) ** 2, abs=1e-7)


def test_a_batch_names_the_state_that_would_become_negative():
    one = model("state y = 1 nonnegative\neq d/dt y = -1", 3.0, 3)
    found = one.rollout(np.array([[5.0], [1.5]]), np.zeros((2, 3, 0)))
    assert found.failure[0] == ""
    assert found.steps[1] == 2
    assert "would become negative" in found.failure[1]


def test_a_start_below_zero_is_refused_by_name():
    one = model("state y = 1 nonnegative\neq d/dt y = -y", 3.0, 3)
    with pytest.raises(smpl.SimulationError, match=r"d/dt y, would become negative"):
        one.step([-0.5], [])


def test_exports_have_zero_as_the_least_value(tmp_path):
    text = "state y : mol = 1 in -1..5 nonnegative\nstate z : mol = 1\neq d/dt y = -y/1\neq d/dt z = -z/1"
    one = model(text, 3.0, 3)
    path = smpl.export.write(one, "json", tmp_path / "m.json")[0]
    y, z = smpl.export.json(one)["quantities"]["states"]
    assert y["nonnegative"] is True
    assert "nonnegative" not in z
    with pytest.raises(smpl.SimulationError, match="would become negative"):
        smpl.compile(str(path)).step([-0.5, 1], [])
    assert '"y", "mol", 0.0, 5.0' in smpl.export.text(one, "c")["c"]
    smpl.export.fmu(one, tmp_path / "m.fmu", binary=False)
    with zipfile.ZipFile(tmp_path / "m.fmu") as fmu:
        described = fmu.read("modelDescription.xml").decode()
    assert re.search(r'name="y"[^>]* min="0\.0" max="5\.0"', described)
