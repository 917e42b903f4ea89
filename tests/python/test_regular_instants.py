"""Regular instants and controllers of batches, snapshots, rollouts, derivatives and FMUs, compared with NumPy."""

import math

import numpy as np
import pytest

import smpl

LOOP = """
time t : s
action r = 1 in 0..3
state y = 0 in -10..10
discrete u = 0 in 0..2.5
discrete trend = 0
eq d/dt y = (u - y) / 5 [s]
control u from y setpoint r gain 0.8 reset 4 [s] every 3 [s]
at every 7 [s] { next trend = y }
observe y, u in 0..2.5, trend in -10..10
reward error default = -sq(y - r)
episode { step = 10 [s], max_steps = 20 }
solver { rtol = 1e-10 }
"""


@pytest.fixture(scope="module")
def loop() -> smpl.Model:
    return smpl.compile(source=LOOP)


def expected(references):
    """State, output and trend after each step: the exact step of a first-order lag between instants."""
    y, u, trend, last = 0.0, 0.0, 0.0, None
    rows = []
    instants = sorted({*range(0, 10 * len(references), 3), *range(0, 10 * len(references), 7)})
    for step, r in enumerate(references):
        end, now = 10.0 * (step + 1), 10.0 * step
        for t in [t for t in instants if 10 * step <= t < end]:
            y, now = u + (y - u) * math.exp(-(t - now) / 5), t
            if t % 7 == 0:
                trend = y
            if t % 3 == 0:
                error = r - y
                change = error - (error if last is None else last) + error * 3 / 4
                u, last = min(max(u + 0.8 * change, 0.0), 2.5), error
        y = u + (y - u) * math.exp(-(end - now) / 5)
        rows.append([y, u, trend])
    return np.array(rows)


REFERENCES = [1.0, 1.0, 2.5, 2.5, 0.5, 0.5, 0.5, 1.5]


def test_single_environments_batches_and_rollouts_have_the_values_of_numpy(loop):
    env = smpl.Env(loop, normalize=False)
    env.reset(seed=0)
    single = np.array([env.step([r])[0] for r in REFERENCES])
    np.testing.assert_allclose(single, expected(REFERENCES), rtol=1e-7, atol=1e-8)
    batch = smpl.VectorEnv(loop, num_envs=5, normalize=False, num_threads=2)
    batch.reset(seed=0)
    shifts = np.linspace(0, 0.4, 5)
    rows = np.array([batch.step((r + shifts)[:, None])[0] for r in REFERENCES])
    np.testing.assert_array_equal(rows[:, 0], single)
    for k, shift in enumerate(shifts):
        np.testing.assert_allclose(rows[:, k], expected([r + shift for r in REFERENCES]), rtol=1e-7, atol=1e-8)
    run = loop.rollout([0.0], np.array(REFERENCES)[:, None])
    np.testing.assert_allclose(run.states[0, 1:, 0], expected(REFERENCES)[:, 0], rtol=1e-7)


def test_a_snapshot_keeps_the_memory_of_controllers(loop):
    env = smpl.Env(loop, normalize=False)
    env.reset(seed=0)
    for r in REFERENCES[:3]:
        env.step([r])
    snapshot = env.snapshot()
    first = [env.step([r])[0] for r in REFERENCES[3:]]
    env.restore(snapshot)
    np.testing.assert_array_equal([env.step([r])[0] for r in REFERENCES[3:]], first)


@pytest.mark.parametrize("method", ["ida", "rosenbrock", "explicit"])
def test_derivatives_of_a_step_cross_regular_instants(method):
    """Central differences of the program in NumPy, also by gain and reset time."""
    text = LOOP.replace("rtol = 1e-10", f"rtol = 1e-10, method = {method}")
    text = text.replace("gain 0.8 reset 4 [s]", "gain K reset T_I") + "param K = 0.8, T_I : s = 4\n"
    model = smpl.compile(source=text)
    end, by_state, by_action, by_parameter = model.sensitivity([0.3], [1.2], parameters=["K", "T_I"])

    def final(y, r, gain, reset):
        u, last = 0.0, None
        for t in (0, 3, 6, 9):
            error = r - y
            change = error - (error if last is None else last) + error * 3 / reset
            u, last = min(max(u + gain * change, 0.0), 2.5), error
            y = u + (y - u) * math.exp(-min(3, 10 - t) / 5)
        return y

    at, h = np.array([0.3, 1.2, 0.8, 4]), 1e-6
    slopes = [(final(*(at + d)) - final(*(at - d))) / (2 * h) for d in h * np.eye(4)]
    np.testing.assert_allclose(end, [final(*at)], rtol=1e-7)
    np.testing.assert_allclose(np.hstack([by_state, by_action, by_parameter]), [slopes], rtol=1e-5)


def test_an_fmu_has_the_regular_instants_of_the_model(loop, tmp_path):
    fmpy = pytest.importorskip("fmpy")
    path = tmp_path / "loop.fmu"
    smpl.export.fmu(loop, path)
    for kind in ("ModelExchange", "CoSimulation"):
        start = {"r": 1.0}
        rows = fmpy.simulate_fmu(
            str(path), fmi_type=kind, stop_time=80, output_interval=10, start_values=start, output=["y", "u"]
        )
        # Rows at events have the times of events; the last row of a time is behind its event.
        last = [np.flatnonzero(np.abs(rows["time"] - 10 * (k + 1)) < 1e-6)[-1] for k in range(8)]
        np.testing.assert_allclose(rows["y"][last], expected([1.0] * 8)[:, 0], rtol=1e-4, atol=1e-5)


def test_a_sampled_measurement_is_held_over_the_step():
    """Closed form: with u = K*(r - y) held, y moves towards u by 1 - exp(-h)."""
    model = smpl.compile(
        source="""
time t : s
action r = 1 in 0..2
state y = 0
eq d/dt y = (0.5*(r - sampled(y)) - y) / 1 [s]
observe y in -1..1
reward error default = -sq(y - r)
episode { step = 2 [s], max_steps = 10 }
solver { rtol = 1e-10 }
"""
    )
    run = model.rollout([0.0], np.ones((5, 1)))
    y, rows = 0.0, []
    for _ in range(5):
        u = 0.5 * (1 - y)
        y = u + (y - u) * math.exp(-2)
        rows.append(y)
    np.testing.assert_allclose(run.states[0, 1:, 0], rows, rtol=1e-7)
    np.testing.assert_allclose(model.steady_state([1.0]), [1 / 3], rtol=1e-9)
