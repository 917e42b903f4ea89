"""Estimators of processes with declared disturbances: closed forms, and errors against their covariances."""

import numpy as np
import pytest

import smpl
from smpl.controllers import NMPC, ExtendedKalmanFilter, MovingHorizonEstimator, SamplingMPC, consistency
from smpl.evaluation import run_episode

linalg = pytest.importorskip("scipy.linalg")

WANDERING = """model Wandering "a tank whose feed wanders"
time t : h
action u = 1 in -10..10
disturbance d = 0 ~ 0.9*d + 0.5*normal(0, 1)
state x = 1 in -50..50
eq d/dt x = 0.25*1[1/h]*(u + d - x)
initial x ~ normal(1, 0.5)
observe x noise normal(0, 0.2)
reward r default = -sq(x)
episode { step = 0.5 [h], max_steps = 200, error_reward = -1000 }
solver { rtol = 1e-10 }
"""
# Sampled: x+ = a x + (1 - a)(u + d+), d+ = 0.9 d + 0.5 w.
DECAY = np.exp(-0.125)
F = np.array([[DECAY, 0.9 * (1 - DECAY)], [0.0, 0.9]])
W = np.array([0.5 * (1 - DECAY), 0.5])
KNOWN = {"deviation": {"x": 0.5}, "process_noise": {"x": 0.0}}


def test_a_filter_of_a_linear_process_with_a_disturbance_is_kalmans():
    model = smpl.compile(source=WANDERING)
    env, kalman = smpl.Env(model, normalize=False), ExtendedKalmanFilter(model, **KNOWN)
    assert kalman.prediction.names == ("x", "d")
    env.reset(seed=5)
    kalman.reset(env)
    mean, P = np.array([1.0, 0.0]), np.diag([0.25, 0.0])
    rng, squares = np.random.default_rng(0), 0.0
    for _ in range(60):
        found = kalman.update(env)
        S = P[0, 0] + 0.04
        innovation = env.reading[0] - mean[0]
        squares += innovation**2 / S
        gain = P[:, 0] / S
        mean, P = mean + gain * innovation, P - np.outer(gain, P[0])
        np.testing.assert_allclose([found[0], kalman.estimate["d"]], mean, atol=1e-6)
        np.testing.assert_allclose(kalman.covariance, P, atol=1e-7)
        assert kalman.innovation["x"] == pytest.approx(innovation, abs=1e-6)
        assert kalman.innovation_covariance[0, 0] == pytest.approx(S, rel=1e-6)
        assert kalman.nis == pytest.approx(innovation**2 / S, rel=1e-4, abs=1e-9)
        u = rng.uniform(-2, 2)
        env.step([u])
        mean, P = F @ mean + [(1 - DECAY) * u, 0], F @ P @ F.T + np.outer(W, W)
    steady = linalg.solve_discrete_are(F.T, np.array([[1.0], [0.0]]), np.outer(W, W), [[0.04]])
    np.testing.assert_allclose(P, steady, rtol=1e-3)  # the prediction's covariance has settled
    assert kalman.consistency().square == pytest.approx(squares, rel=1e-4)
    assert kalman.consistency().degrees == 60


def test_estimation_over_a_window_agrees_with_the_filter_of_a_linear_process():
    model = smpl.compile(source=WANDERING)
    env, kalman = smpl.Env(model, normalize=False), ExtendedKalmanFilter(model, **KNOWN)
    window = MovingHorizonEstimator(model, horizon=8, iterations=20, **KNOWN)
    env.reset(seed=5)
    kalman.reset(env)
    window.reset(env)
    for _ in range(25):
        np.testing.assert_allclose(window.update(env), kalman.update(env), atol=5e-3)
        assert window.estimate["d"] == pytest.approx(kalman.estimate["d"], abs=2e-2)
        env.step([1.5])
    assert window.failures == 0 and window.degrees == 9


def test_a_disturbance_that_is_not_estimated_stays_at_its_mean():
    model = smpl.compile(source=WANDERING)
    assert ExtendedKalmanFilter(model, disturbances=()).prediction.names == ("x",)
    with pytest.raises(ValueError, match="disturbances: unknown 'e'"):
        ExtendedKalmanFilter(model, disturbances=("e",))


# A jump now and then; a wall that fouls at a rate drawn for the episode, with a drifting sensor.
JUMPS = """model Jumps
time t : h
action u = 1 in 0..2
disturbance load = 0.5 ~ if uniform(0, 1) < 0.1 then 0.2 + 0.6*uniform(0, 1) else load in 0..1
state x = 1 in 0..20
state y = 1 in 0..20
eq d/dt x = (u - load*x)/1[h]
eq d/dt y = (x - y)/2[h]
initial x ~ normal(1, 0.05)
initial y ~ normal(1, 0.05)
observe x noise normal(0, 0.05), y noise normal(0, 0.05)
reward r default = -sq(x)
episode { step = 0.25 [h], max_steps = 200 }
"""
BENT = """model Bent
time t : h
action u = 1 in 0.5..2
random rate ~ uniform(0.5, 1.5)
disturbance lost = 0 ~ min(lost + 0.004*rate, 0.6)
disturbance feed = 1 ~ 1 + 0.8*(feed - 1) + 0.05*normal(0, 1)
disturbance drift = 0 ~ drift + 0.01*normal(0, 1)
state c = 1 in 0..20
state T = 1 in 0..20
eq d/dt c = (u*(feed - c) - 0.5*c*T)/1[h]
eq d/dt T = (0.5*c*T - (1 - lost)*(T - 0.8) + 0.3)/1[h]
initial c ~ normal(1, 0.05)
initial T ~ normal(1, 0.05)
observe c noise normal(0, 0.02), Tm : 1 = T + drift noise normal(0, 0.02) in 0..20
reward r default = -sq(c)
episode { step = 0.25 [h], max_steps = 200 }
"""


@pytest.mark.parametrize(
    ("make", "options", "names"),
    [
        (lambda: smpl.compile(source=WANDERING), KNOWN, {"d"}),
        (lambda: smpl.compile(source=JUMPS), {"deviation": {"x": 0.05, "y": 0.05}}, {"load"}),
        (lambda: smpl.compile(source=BENT), {"deviation": {"c": 0.05, "T": 0.05}}, {"rate", "lost", "feed", "drift"}),
        (
            lambda: smpl.compile("reactor", variants=["feed_disturbances"], observation="online"),
            {"deviation": {"c_A": 0.1, "T": 3, "h": 0.05}},
            {"T_f_shift", "c_Af_shift"},
        ),
        (
            lambda: smpl.compile("reactor", variants=["fouling"], observation="online"),
            {"deviation": {"c_A": 0.1, "T": 3, "h": 0.05}},
            {"foulness", "fouled"},
        ),
    ],
    ids=["wandering", "jumps", "bent", "feed", "fouling"],
)
def test_errors_match_their_covariance(make, options, names):
    """Sums of squared errors of the states over their covariances, within a wide chi-squared band over episodes."""
    model = make()
    tight = {name: 1e-6 * max(size, 1e-3) for name, size in zip(model.state_names, np.ones(9), strict=False)}
    kalman = ExtendedKalmanFilter(model, **{"process_noise": tight, **options})
    assert names <= set(kalman.prediction.names)
    env = smpl.Env(model, normalize=False)
    ends, innovations, degrees = [], 0.0, 0
    for seed in range(40):
        start = None
        if "reactor" in str(model.name).lower():
            start = perturbed(model, seed, options["deviation"])
        errors, covariances = play_from(env, kalman, 50, seed, start)
        ends.append(errors[-1] @ np.linalg.solve(covariances[-1], errors[-1]))
        innovations, degrees = innovations + kalman.consistency().square, degrees + kalman.consistency().degrees
    found = consistency(sum(ends), 40 * len(model.state_names), 0.999)
    print(found, innovations / degrees)
    assert found.square < 1.3 * found.high  # the filter is a linearisation
    assert 0.8 < innovations / degrees < 1.15


def perturbed(model, seed, deviation):
    env = smpl.Env(model, normalize=False)
    env.reset(seed=0, options={"start": "nominal"})
    rng = np.random.default_rng([seed, 9])
    return {n: float(v + deviation[n] * rng.normal()) for n, v in zip(model.state_names, env.state, strict=True)}


def play_from(env, kalman, steps, seed, start):
    rng = np.random.default_rng(seed)
    env.reset(seed=seed, options=None if start is None else {"state": start})
    kalman.reset(env)
    errors, covariances = [], []
    low, high = env.action_low, env.action_high
    base = env.model.native.defaults("action")
    for k in range(steps + 1):
        estimate = kalman.update(env)
        n = len(estimate)
        errors.append(estimate - env.state)
        covariances.append(kalman.covariance[:n, :n])
        if k < steps:
            _, _, terminated, truncated, _ = env.step(
                np.clip(base + 0.05 * (high - low) * rng.uniform(-1, 1, len(low)), low, high)
            )
            if terminated or truncated:
                break
    return np.array(errors), covariances


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_deviations_that_cannot_be_are_refused(value):
    with pytest.raises(ValueError, match=r"deviation\['x'\] is .*expected a finite"):
        MovingHorizonEstimator(smpl.compile(source=WANDERING), deviation={"x": value})
    if value != 0:
        with pytest.raises(ValueError, match=r"deviation\['x'\] is .*expected a finite"):
            ExtendedKalmanFilter(smpl.compile(source=WANDERING), deviation={"x": value})
        with pytest.raises(ValueError, match=r"process_noise: .*expected finite numbers that are not negative"):
            ExtendedKalmanFilter(smpl.compile(source=WANDERING), process_noise={"x": value})


def test_a_band_is_that_of_the_chi_squared_distribution():
    from scipy.stats import chi2

    found = consistency(12.0, 10, 0.9)
    assert (found.low, found.high) == pytest.approx(tuple(chi2.ppf([0.05, 0.95], 10)))
    assert found.holds and str(found).startswith("consistent: 12 of 10 degrees of freedom")
    assert not consistency(50, 10).holds
    for degrees, level in ((0, 0.95), (3, 1.5)):
        with pytest.raises(ValueError, match="expected"):
            consistency(1.0, degrees, level)


# A heated kettle with a constant, unknown loss of heat; its temperature alone is measured.
KETTLE = """model Kettle "heated kettle with an unknown loss"
time t : min
param UA : kJ/(min K) = 12
action Q : kJ/min = 600 in 0..2000
disturbance leak : kJ/min = 0 ~ leak in -500..500
state T : degC = 60 in 0..120
state S : degC = 60 in 0..120 "wall"
eq d/dt T = (Q + leak - UA*(T - 20 [degC])) / (100 [kJ/K]) - (T - S) / (2 [min])
eq d/dt S = (T - S) / (4 [min])
observe T noise normal(0, 0.1)
reward r default = -sq((T - 65 [degC]) / 1 [K])
episode { step = 1 [min], max_steps = 100, error_reward = -500 }
"""
LOST = {"disturbances": {"leak": [-150.0]}, "hold_disturbances": True}


def test_a_constant_unknown_disturbance_needs_a_deviation_and_is_found():
    model = smpl.compile(source=KETTLE)
    assert ExtendedKalmanFilter(model).prediction.names == ("T", "S")
    with pytest.raises(ValueError, match=r"leak keeps the declared value, .*deviation=\{'leak': \.\.\.\}"):
        ExtendedKalmanFilter(model, disturbances=["leak"])
    env = smpl.Env(model, normalize=False)
    for estimator in (
        ExtendedKalmanFilter(model, deviation={"leak": 200.0}),
        ExtendedKalmanFilter(model, process_noise={"leak": 5.0}),
        MovingHorizonEstimator(model, horizon=4, deviation={"leak": 200.0}),
    ):
        assert estimator.prediction.names == ("T", "S", "leak")
        env.reset(seed=1, options=LOST)
        estimator.reset(env)
        found = []
        for _ in range(60):
            estimator.update(env)
            found.append(estimator.estimate["leak"])
            env.step([700.0])
        assert np.mean(found[-20:]) == pytest.approx(-150.0, abs=5.0)


def test_predictive_control_uses_the_estimated_disturbance_and_no_other():
    """With the estimate there is no offset; the loss of the plant is not known without it."""
    pytest.importorskip("casadi")
    model = smpl.compile(source=KETTLE)
    env = smpl.Env(model, normalize=False)
    known = {"deviation": {"T": 1.0, "S": 1.0}, "process_noise": {"T": 0.0, "S": 0.0}}
    last = {}
    for name, kalman in (
        ("blind", ExtendedKalmanFilter(model, **known)),
        ("estimated", ExtendedKalmanFilter(model, **{**known, "deviation": {"leak": 200.0}})),
    ):
        controller = NMPC(model, 8, {"T": 1}, set_point={"T": 65.0}, estimator=kalman)
        episode = run_episode(env, controller, 1, LOST)
        last[name] = episode.states[-30:, 0].mean()
    assert last["estimated"] == pytest.approx(65.0, abs=0.1)
    # A filter that believes its model leaves almost all of 150/12 = 12.5 K.
    assert last["blind"] < 65 - 10


def test_sampling_control_uses_the_estimated_disturbance():
    model = smpl.compile(source=KETTLE)
    env = smpl.Env(model, normalize=False, max_steps=60)
    kalman = ExtendedKalmanFilter(model, deviation={"leak": 200.0}, process_noise={"T": 0.0, "S": 0.0})
    controller = SamplingMPC(horizon=5, samples=64, iterations=3, method="cem", hold=5, estimator=kalman)
    episode = run_episode(env, controller, 1, LOST)
    assert episode.states[-20:, 0].mean() == pytest.approx(65.0, abs=0.5)
