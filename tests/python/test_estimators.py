"""State estimators against closed forms of linear models, and on plants with rare and late samples."""

import warnings
from pathlib import Path

import numpy as np
import pytest

import smpl
from smpl.analysis.sensors import sensors
from smpl.controllers import LQG, LQR, ExtendedKalmanFilter, MovingHorizonEstimator
from smpl.evaluation import run_episode

linalg = pytest.importorskip("scipy.linalg")
PROBLEMS = Path(__file__).resolve().parent.parent / "problems"

A, B, H = 0.25, 1.0, 0.5
# Two tanks in series: x' = (u - x)/4, z' = (x - z)/4 in unit time, sampled every 0.5.
LINEAR = """model Linear "two tanks in series"
time t : h
action u = 1 in -10..10
param k : 1/h = 0.25
state x = 1 in -50..50
state z = 1 in -50..50
eq d/dt x = k*(u - x)
eq d/dt z = k*(x - z)
initial x ~ normal(1, 0.5)
initial z ~ normal(1, 0.5)
observe z noise normal(0, 0.2)
level late { observe z noise normal(0, 0.2), x every 4 delay 3 noise normal(0, 0.05) }
reward r default = -sq(x)
episode { step = 0.5 [h], max_steps = 200, error_reward = -1000 }
"""


def linear(level="default"):
    return smpl.compile(source=LINEAR, observation=level, settings={"rtol": 1e-11})


def transition():
    M = linalg.expm(np.array([[-0.25, 0, 0.25], [0.25, -0.25, 0], [0, 0, 0]]) * 0.5)
    return M[:2, :2], M[:2, 2]


def posterior(readings, actions, steps, process=0.02, spread=0.5):
    """Mean and covariance of the last state given readings (step, sensor, value): all at once, as one Gaussian."""
    F, g = transition()
    mean, big = [np.ones(2)], np.zeros((2 * (steps + 1),) * 2)
    big[:2, :2] = spread**2 * np.eye(2)
    for k in range(steps):
        mean.append(F @ mean[-1] + g * actions[k])
        a, b = slice(2 * k, 2 * k + 2), slice(2 * k + 2, 2 * k + 4)
        big[b, : b.start] = F @ big[a, : b.start]
        big[: b.start, b] = big[b, : b.start].T
        big[b, b] = F @ big[a, a] @ F.T + process**2 * np.eye(2)
    mean = np.concatenate(mean)
    # Sensor 0 reads z (state 1), sensor 1 reads x (state 0).
    places = [2 * step + (1 if sensor == 0 else 0) for step, sensor, _ in readings]
    R = np.diag([0.2**2 if sensor == 0 else 0.05**2 for _, sensor, _ in readings])
    S = big[np.ix_(places, places)] + R
    K = np.linalg.solve(S, big[places, -2:]).T
    values = np.array([value for _, _, value in readings])
    return mean[-2:] + K @ (values - mean[places]), big[-2:, -2:] - K @ big[places, -2:]


def run(env, estimator, steps, seed):
    """Estimates, readings as (step taken, sensor, value) and actions of an episode."""
    rng = np.random.default_rng(seed)
    env.reset(seed=seed)
    estimator.reset(env)
    estimates, readings, actions = [], [], []
    for k in range(steps + 1):
        for taken, places in sensors(env.model).arriving(k).items():
            readings += [(taken, sensor, env.reading[sensor]) for sensor in places]
        estimates.append(estimator.update(env))
        if k < steps:
            actions.append(rng.uniform(-2, 2))
            env.step([actions[-1]])
    return estimates, readings, actions


OPTIONS = {"deviation": {"x": 0.5, "z": 0.5}, "process_noise": {"x": 0.02, "z": 0.02}}


def test_the_sensors_of_a_level_are_those_of_its_text():
    found = sensors(smpl.compile("reactor", observation="laboratory"))
    np.testing.assert_array_equal(found.noise, [0.1, 0.002, 0.005])
    assert (found.every.tolist(), found.delay.tolist()) == ([1, 1, 5], [0, 0, 3])
    assert found.arriving(0) == {0: [0, 1, 2]}
    assert found.arriving(8) == {8: [0, 1], 5: [2]}
    assert found.arriving(3) == {3: [0, 1]}
    assert sensors(smpl.compile("reactor", scenario="legacy", observation="online")).noise.tolist() == [0.1, 0.002]
    with pytest.raises(ValueError, match=r"noise: unknown 'c_A'; the level 'online' has: T \[degC\], h \[m\]"):
        sensors(smpl.compile("reactor", observation="online"), {"c_A": 1.0})


def test_the_samples_that_arrive_are_those_whose_reading_changes():
    env = smpl.Env("reactor", normalize=False, observation="laboratory")
    env.reset(seed=1)
    found, before = sensors(env.model), env.reading
    for k in range(1, 30):
        env.step([26.85, 0.1])
        changed = env.reading != before
        arrived = {sensor for places in found.arriving(k).values() for sensor in places}
        assert {0, 1} <= arrived and changed[2] == (2 in arrived)
        before = env.reading


@pytest.mark.parametrize("level", ["default", "late"])
def test_the_filter_of_a_linear_model_is_the_gaussian_posterior(level):
    env = smpl.Env(linear(level), normalize=False)
    kalman = ExtendedKalmanFilter(env, **OPTIONS)
    for steps in (0, 1, 7, 12):
        estimates, readings, actions = run(env, kalman, steps, 3)
        mean, covariance = posterior(readings, actions, steps)
        np.testing.assert_allclose(estimates[-1], mean, atol=2e-5)
        np.testing.assert_allclose(kalman.covariance, covariance, atol=2e-6)


@pytest.mark.parametrize("level", ["default", "late"])
def test_estimation_over_a_window_of_a_linear_model_is_the_gaussian_posterior(level):
    """While the window holds the whole episode, and beyond it, where the arrival cost of a linear model is exact."""
    env = smpl.Env(linear(level), normalize=False)
    estimator = MovingHorizonEstimator(env, horizon=6, **OPTIONS)
    for steps in (0, 5, 12):
        estimates, readings, actions = run(env, estimator, steps, 3)
        mean, _ = posterior(readings, actions, steps)
        np.testing.assert_allclose(estimates[-1], mean, atol=1e-4)
    assert estimator.failures == 0


def test_the_covariance_settles_where_the_riccati_equation_has_its_solution():
    env = smpl.Env(linear(), normalize=False)
    kalman = ExtendedKalmanFilter(env, **OPTIONS)
    run(env, kalman, 150, 0)
    F, _ = transition()
    C = np.array([[0.0, 1.0]])
    before = linalg.solve_discrete_are(F.T, C.T, 0.02**2 * np.eye(2), np.array([[0.2**2]]))
    after = before - before @ C.T @ np.linalg.solve(C @ before @ C.T + 0.2**2, C @ before)
    np.testing.assert_allclose(kalman.covariance, after, rtol=1e-3)


BENT = """model Bent "a growth that saturates, and what it eats"
time t : h
action u = 0 in 0..1
param k : 1/h = 0.8 in 0.1..3
state x = 0.4 in 0.01..10
state s = 2 in 0.001..10
eq d/dt x = k*x*s/(0.5 + s) - 0.1[1/h]*x
eq d/dt s = u*1[1/h] - 2*k*x*s/(0.5 + s)
observe root = x^1.5 in 0..100 noise normal(0, 0.02)
reward r default = x
episode { step = 0.5 [h], max_steps = 40, error_reward = 0 }
"""


def by_hand(readings, actions):
    """An extended Kalman filter of `BENT` from its equations and their derivatives, by SciPy's integrator."""
    integrate = pytest.importorskip("scipy.integrate")

    def rates(_, z, u):
        x, s, k = z[:3]
        slope = 0.5 * k * x / (0.5 + s) ** 2
        monod = s / (0.5 + s)
        jacobian = np.array(
            [[k * monod - 0.1, slope, x * monod], [-2 * k * monod, -2 * slope, -2 * x * monod], [0, 0, 0]]
        )
        state = [k * x * monod - 0.1 * x, u - 2 * k * x * monod, 0.0]
        return np.concatenate([state, (jacobian @ z[3:].reshape(3, 3)).ravel()])

    mean, covariance = np.array([0.4, 2.0, 0.8]), np.diag([0.1, 0.3, 0.2]) ** 2
    found = []
    for k, reading in enumerate(readings):
        if k:
            start = np.concatenate([mean, np.eye(3).ravel()])
            end = integrate.solve_ivp(
                rates, (0, 0.5), start, args=(actions[k - 1],), method="DOP853", rtol=1e-12, atol=1e-13
            ).y[:, -1]
            mean, F = end[:3], end[3:].reshape(3, 3)
            covariance = F @ covariance @ F.T + np.diag([0.01, 0.01, 0.02]) ** 2
        h = np.array([1.5 * mean[0] ** 0.5, 0, 0])
        gain = covariance @ h / (h @ covariance @ h + 0.02**2)
        mean = mean + gain * (reading - mean[0] ** 1.5)
        covariance = covariance - np.outer(gain, h @ covariance)
        found.append((mean, covariance))
    return found


def test_the_filter_of_a_bent_model_is_one_written_by_hand():
    env = smpl.Env(smpl.compile(source=BENT, settings={"rtol": 1e-11}), normalize=False)
    kalman = ExtendedKalmanFilter(
        env, deviation={"x": 0.1, "s": 0.3, "k": 0.2}, process_noise={"x": 0.01, "s": 0.01}, parameters={"k": 0.02}
    )
    for steps in (1, 5, 15):
        rng = np.random.default_rng(1)
        env.reset(seed=2, options={"state": {"x": 0.45, "s": 1.8}, "parameters": {"k": 1.0}})
        kalman.reset(env)
        readings, actions = [], []
        for k in range(steps + 1):
            readings.append(env.reading[0])
            kalman.update(env)
            if k < steps:
                actions.append(rng.uniform(0, 1))
                env.step([actions[-1]])
        mean, covariance = by_hand(readings, actions)[-1]
        np.testing.assert_allclose(list(kalman.estimate.values()), mean, rtol=2e-7)
        np.testing.assert_allclose(kalman.covariance, covariance, rtol=1e-6, atol=1e-12)
    assert kalman.derivatives == "exact"
    assert kalman.estimate["k"] == pytest.approx(1.0, abs=0.1)


def test_a_step_across_a_jump_of_the_equations_has_its_exact_derivative():
    model = smpl.compile(source=BENT.replace("u*1[1/h]", "floor(3*x)*1[1/h]*0.1"))
    env = smpl.Env(model, normalize=False)
    for estimator in (ExtendedKalmanFilter(env), MovingHorizonEstimator(env, horizon=2)):
        env.reset(seed=0)
        estimator.reset(env)
        estimator.update(env)
        assert estimator.derivatives == "exact"
        env.step([0.0])
        assert np.isfinite(estimator.update(env)).all()
        assert estimator.derivatives == "exact"


@pytest.mark.parametrize("kind", [ExtendedKalmanFilter, MovingHorizonEstimator])
def test_a_hidden_concentration_and_a_wrong_parameter_are_found(kind):
    env = smpl.Env("reactor", normalize=False, observation="online")
    estimator = kind(env, parameters={"c_Af": 0.003}, deviation={"c_A": 0.05, "c_Af": 0.05, "T": 3.0, "h": 0.05})
    env.reset(seed=0, options={"start": "steady", "parameters": {"c_Af": 0.97}})
    estimator.reset(env)
    for _ in range(50):
        x = estimator.update(env)
        env.step([26.85, 0.1])
    assert estimator.estimate["c_Af"] == pytest.approx(0.97, abs=0.01)
    assert x[0] == pytest.approx(env.state[0], abs=0.01)


def test_estimation_over_a_window_stays_within_the_bounds():
    env = smpl.Env("reactor", normalize=False, observation="online")
    estimator = MovingHorizonEstimator(env, horizon=5, initial={"c_A": 0.995}, deviation={"c_A": 0.3})
    env.reset(seed=0, options={"state": {"c_A": 0.99, "T": 40.0, "h": 0.66}})
    estimator.reset(env)
    for _ in range(15):
        x = estimator.update(env)
        assert 1e-8 <= x[0] <= 1.0
        env.step([16.0, 0.1])
    assert x[0] == pytest.approx(env.state[0], abs=0.02)


@pytest.mark.parametrize(("kind", "options"), [(ExtendedKalmanFilter, {}), (MovingHorizonEstimator, {"horizon": 6})])
def test_feedback_of_an_estimate_brings_a_reactor_with_hidden_concentrations_to_rest(kind, options):
    model = smpl.compile(PROBLEMS / "van_de_vusse.eq", observation="laboratory")
    env = smpl.Env(model, normalize=False, max_steps=60)
    regulator = LQR(smpl.compile(PROBLEMS / "van_de_vusse.eq"))
    episode = run_episode(
        env, LQG(regulator, kind(env, **options)), 2, {"state": {"c_A": 2.3, "c_B": 1.0, "T": 116.0, "T_K": 112.0}}
    )
    assert not episode.failure
    np.testing.assert_allclose(episode.states[-1], [2.14, 1.09, 114.2, 112.9], rtol=0.01)


@pytest.mark.parametrize("kind", [ExtendedKalmanFilter, MovingHorizonEstimator])
@pytest.mark.parametrize("more", ["x + 2*u", "integral(x)/(0.5 [min])", "x - previous(x)", "der(x)*(1 [min])", "z"])
def test_what_a_state_does_not_tell_is_not_read_and_told(kind, more):
    """With the other reading alone the estimate is the one of a level that has that reading alone."""
    source = f"""model More
time t : min
action u = 0 in -10..10
state x = 1 in -50..50
var z = 0
disturbance w = 1 ~ 0.5*w
eq d/dt x = (-0.5*x + u)/(1 [min])
eq z + 0.1*z^3 = x + u
level both {{ observe x in -50..50 noise normal(0, 0.5), y = {more} in -100..100 noise normal(0, 0.05) }}
level one {{ observe x in -50..50 noise normal(0, 0.5) }}
level none {{ observe y = {more} in -100..100 noise normal(0, 0.05) }}
reward r default = -sq(x)
episode {{ step = 0.5 [min], max_steps = 30 }}
"""
    options = {"deviation": {"x": 2}, "process_noise": {"x": 0.1}}
    estimates = []
    for level in ("both", "one"):
        env = smpl.Env(smpl.compile(source=source, observation=level), normalize=False)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            estimator = kind(env, **options)
        assert [("does not read y:" in str(one.message)) for one in told] == ([True] if level == "both" else [])
        env.reset(seed=3, options={"state": {"x": 3}})
        estimator.reset(env)
        for _ in range(4):
            estimates.append(estimator.update(env)[0])
            env.step(np.array([5.0]))
    np.testing.assert_allclose(estimates[:4], estimates[4:], rtol=1e-6)
    with pytest.raises(ValueError, match=r"does not read y.*no reading is left"):
        kind(smpl.Env(smpl.compile(source=source, observation="none"), normalize=False), **options)


def test_a_reading_of_a_drawn_parameter_is_read():
    """The nominal start has the mean of the parameter, 4, not the number in the text."""
    source = """model Gain
time t : min
param g = 5 ~ uniform(3, 5)
action u = 0 in -10..10
state x = 1 in -50..50
eq d/dt x = (-0.5*x + u)/(1 [min])
observe y = g*x in -500..500 noise normal(0, 0.1)
reward r default = -sq(x)
episode { step = 0.5 [min], max_steps = 30 }
"""
    env = smpl.Env(smpl.compile(source=source), normalize=False)
    for options in ({"parameters": {"g": 0.01}}, {"p": {"g": 4.5}}, {}):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            ExtendedKalmanFilter(env, **options)


def test_an_estimator_of_another_level_is_refused():
    kalman = ExtendedKalmanFilter(smpl.compile("reactor", observation="online"))
    regulator = LQR(smpl.compile("reactor"))
    with pytest.raises(ValueError, match="sees the level 'online', the environment shows 'default'"):
        run_episode(smpl.Env("reactor"), LQG(regulator, kalman), 0)
    with pytest.raises(ValueError, match=r"the estimator reads T, h .* the environment shows c_A, T, h"):
        kalman.reset(smpl.Env("reactor"))
    with pytest.raises(ValueError, match="horizon is 3, expected an integer above the longest delay, 3"):
        MovingHorizonEstimator(smpl.compile("reactor", observation="laboratory"), horizon=3)
    with pytest.raises(ValueError, match="parameters: unknown 'k'"):
        ExtendedKalmanFilter(smpl.compile("reactor"), parameters={"k": 1.0})


@pytest.mark.parametrize(
    "text",
    ["observation: online", '"observation": online', "observation : online", "{observation: online}",
     "max_steps: 3\nobservation: 'online'  # default"],
)  # fmt: skip
def test_a_level_that_the_scenario_chooses_has_its_sensors(text, tmp_path):
    scenario = tmp_path / "online.yaml"
    scenario.write_text(text + "\n")
    model = smpl.compile("reactor", scenario=scenario)
    assert (model.level, model.observation_names) == ("online", ("T", "h"))
    assert sensors(model).noise.tolist() == [0.1, 0.002]
    # The level of the call takes the place of the scenario's, whose file is not read again.
    laboratory = smpl.compile("reactor", scenario=scenario, observation="laboratory")
    scenario.unlink()
    assert model.level == "online" and laboratory.level == "laboratory"
    found = sensors(laboratory)
    assert (found.every.tolist(), found.delay.tolist(), found.noise.tolist()) == (
        [1, 1, 5],
        [0, 0, 3],
        [0.1, 0.002, 0.005],
    )


@pytest.mark.parametrize("name", ["beer", "pensim"])
def test_the_prediction_is_the_step_of_the_plant_to_the_bit(name):
    from smpl.controllers.estimation import Prediction, discrete_of

    # One-step methods begin with the step that fitted before, a prediction with an estimate: the text with IDA.
    text = (Path(__file__).parents[2] / "models" / f"{name}.eq").read_text().replace("method = auto, ", "")
    settings = {"disturbances": False} if name == "pensim" else {}
    env = smpl.Env(smpl.compile(source=text, settings=settings), normalize=False)
    env.reset(seed=1, options={"start": "nominal"})
    prediction = Prediction(env.model, None, None, None)
    prediction.begin(env)
    for _ in range(8):
        expected = prediction.step(env.state[None], env.policy("nominal"), env.steps, discrete_of(env))[0]
        env.step(env.policy("nominal"))
        np.testing.assert_array_equal(expected, env.state)


def test_a_regulator_of_other_states_than_the_estimator_is_refused():
    env = smpl.Env(linear(), normalize=False)
    with pytest.raises(ValueError, match="the estimator has the states x, z, the regulator c_A, T, h"):
        LQG(LQR(smpl.compile("reactor")), ExtendedKalmanFilter(env)).reset(env)


def test_a_budget_ends_the_update_of_a_moving_horizon_with_the_best_estimate_so_far():
    env = smpl.Env(linear(), normalize=False)
    env.reset(seed=1)
    whole, short = (MovingHorizonEstimator(env, horizon=6, budget=budget) for budget in (None, 1e-9))
    for estimator in (whole, short):
        estimator.reset(env)
    for _ in range(5):
        env.step(env.model.native.defaults("action"))
        found = [estimator.update(env) for estimator in (whole, short)]
    assert whole.unfinished == whole.failures == 0 and short.unfinished == 5 and short.failures == 0
    assert short.last_status == "the budget of 1e-09 s ended the optimiser" and np.isfinite(found).all()
    with pytest.raises(ValueError, match="budget is -1, expected seconds above 0"):
        MovingHorizonEstimator(env, budget=-1)
