"""Everything that uses a model, on reduced systems: the numbers of the same system reduced manually."""

import gymnasium
import numpy as np
import pytest

import smpl
from smpl.controllers import LQR, NMPC, ExtendedKalmanFilter, MovingHorizonEstimator

VESSEL_TASK = """
action F : mol/s = 1 in -1..3
observe n1 in 0..100, n2 in 0..100, w in -10..10, p2 in 0..1e5
reward r default = -sq(n2/1[mol] - 3) - sq(w/1[mol/s])
constraint full when n2 > 20 [mol]
fail burst when p2 > 1e5 [Pa]
steady { F = 1 }
episode { step = 0.5 [s], max_steps = 20, error_reward = -100 }
solver { rtol = 1e-9 }
"""
PARAMETERS = """model Vessels
time t : s
param R : J/mol/K = 8.314462618
param T : K = 300
param V1 : m^3 = 1 in 0.1..10
param V2 : m^3 = 2 in 0.1..10
param k : 1/s = 0.3 in 0..1
"""
VESSELS = (
    PARAMETERS
    + VESSEL_TASK
    + """
state n1 : mol = 1 in 0..100
state n2 : mol = 2 in 0..100
state c : mol = 0.5 in 0..10
var p1 : Pa
var p2 : Pa
var w : mol/s
eq d/dt n1 = F - w - k*n1
eq d/dt n2 = w
eq d/dt c = w - k*c
eq p1 = n1*R*T/V1
eq p2 = n2*R*T/V2
eq p1 = p2
initial n2 = n1*V2/V1
"""
)
# n2 = n1*V2/V1, and the sum of both rates is F - k*n1.
VESSELS_BY_HAND = (
    PARAMETERS
    + VESSEL_TASK
    + """
state n1 : mol = 1 in 0..100
state c : mol = 0.5 in 0..10
let n2 : mol = n1*V2/V1
let w : mol/s = V2/(V1 + V2)*(F - k*n1)
let p2 : Pa = n2*R*T/V2
eq d/dt n1 = F - w - k*n1
eq d/dt c = w - k*c
"""
)
PENDULUM_TASK = """model Pendulum
time t : s
param g : m/s^2 = 9.81 in 1..20
param b : 1/s = 0.3 in 0..10
action M : 1/s^2 = 0 in -20..20
observe x in -2..2, y in -2..2, u in -20..20, v in -20..20
reward r default = -sq(x/1[m] - 0.3) - 0.1*sq(u/1[m/s]) - 0.01*sq(M*1[s^2])
steady { M = 0 }
episode { step = 0.1 [s], max_steps = 100, error_reward = -100 }
solver { rtol = 1e-10 }
"""
PENDULUM = (
    PENDULUM_TASK
    + """
state x : m = 0 in -2..2
state y : m = -1 in -2..2
state u : m/s = 0 in -20..20
state v : m/s = 0 in -20..20
var lam : 1/s^2
eq d/dt x = u
eq d/dt y = v
eq d/dt u = -lam*x - b*u - M*y
eq d/dt v = -lam*y - b*v + M*x - g
eq x^2 + y^2 = 1 [m^2]
"""
)
# The angle from the lowest point, x = sin(a), y = -cos(a).
PENDULUM_BY_HAND = (
    PENDULUM_TASK
    + """
state a : 1 = 0 in -100..100
state r_a : 1/s = 0 in -20..20
let x : m = sin(a)*1[m]
let y : m = -cos(a)*1[m]
let u : m/s = cos(a)*r_a*1[m]
let v : m/s = sin(a)*r_a*1[m]
eq d/dt a = r_a
eq d/dt r_a = -g/1[m]*sin(a) - b*r_a + M
"""
)
# An algebraic unknown is bound with the states: corrections project them.
PENDULUM_WITH_ANGLE = PENDULUM.replace("eq x^2 + y^2 = 1 [m^2]", "eq x = sin(a)*1[m]\neq y = -cos(a)*1[m]").replace(
    "var lam : 1/s^2", "var a : 1 = 0\nvar lam : 1/s^2"
)


def cartesian(q):
    return np.array([np.sin(q[0]), -np.cos(q[0]), np.cos(q[0]) * q[1], np.sin(q[0]) * q[1]])


def tangent(q):
    """Derivatives of the Cartesian states by angle and rate."""
    s, c = np.sin(q[0]), np.cos(q[0])
    return np.array([[c, 0], [s, 0], [-s * q[1], c], [c * q[1], s]])


class Pair:
    """A model as it is written, the one reduced manually, and the states of one by those of the other."""

    def __init__(self, written, by_hand, states, derivative, point, parameters):
        self.written, self.by_hand = smpl.compile(source=written), smpl.compile(source=by_hand)
        self.states, self.derivative, self.point, self.parameters = states, derivative, np.array(point), parameters
        self.start = states(self.point)

    def actions(self, steps):
        return np.random.default_rng(3).uniform(0, 2, (steps, 1))


PAIRS = {
    "vessels": (VESSELS, VESSELS_BY_HAND, np.array, lambda q: np.eye(2), [1.2, 0.4], ("V1", "V2", "k")),
    "angle": (PENDULUM_WITH_ANGLE, PENDULUM_BY_HAND, cartesian, tangent, [0.7, -1.2], ("g", "b")),
    "pendulum": (PENDULUM, PENDULUM_BY_HAND, cartesian, tangent, [0.7, -1.2], ("g", "b")),
}


@pytest.fixture(scope="module", params=PAIRS)
def pair(request):
    return Pair(*PAIRS[request.param])


def test_steps_have_the_derivatives_of_the_reduced_form(pair):
    for u in ([0.0], [1.7]):
        x, dx, du, dp = pair.written.sensitivity(pair.start, u, parameters=pair.parameters)
        q, hx, hu, hp = pair.by_hand.sensitivity(pair.point, u, parameters=pair.parameters)
        along = pair.derivative(q)
        np.testing.assert_allclose(x, pair.states(q), atol=1e-7)
        np.testing.assert_allclose(dx @ pair.derivative(pair.point), along @ hx, atol=1e-7)
        np.testing.assert_allclose(du, along @ hu, atol=1e-7)
        np.testing.assert_allclose(dp, along @ hp, atol=1e-7)
        mine = pair.written.linearize_step(pair.start, u, parameters=pair.parameters)
        other = pair.by_hand.linearize_step(pair.point, u, parameters=pair.parameters)
        for of in ("r", "y"):
            here, there = (getattr(one, f"d{of}_dx") for one in (mine, other))
            np.testing.assert_allclose(here @ pair.derivative(pair.point), there, rtol=1e-6, atol=1e-6)
            for by in ("u", "p"):
                here, there = (getattr(one, f"d{of}_d{by}") for one in (mine, other))
                np.testing.assert_allclose(here, there, rtol=1e-6, atol=1e-6)


def test_an_episode_has_the_gradient_of_the_reduced_form(pair):
    actions = pair.actions(6)
    mine = pair.written.gradient(pair.start, actions, parameters=pair.parameters)
    other = pair.by_hand.gradient(pair.point, actions, parameters=pair.parameters)
    np.testing.assert_allclose(mine.value, other.value, rtol=1e-7)
    np.testing.assert_allclose(mine.by_action, other.by_action, atol=1e-6)
    np.testing.assert_allclose(mine.by_parameter, other.by_parameter, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(mine.by_state @ pair.derivative(pair.point), other.by_state, rtol=1e-6, atol=1e-6)


def poles_and_gains(linear, points):
    """Sorted eigenvalues, and the transfer function at some points."""
    A, B, C, D = linear
    return np.sort_complex(np.linalg.eigvals(A)), [C @ np.linalg.solve(s * np.eye(len(A)) - A, B) + D for s in points]


def test_the_linearisation_has_no_further_modes(pair):
    u = [1.0]
    rest = pair.written.steady_state(u)
    found, other = pair.written.linearize(rest, u), pair.by_hand.linearize(pair.by_hand.steady_state(u), u)
    assert len(found.state_names) == len(found[0]) == len(other[0])
    (poles, gains), (expected, others) = (poles_and_gains(one, (0.3, 2j, 1 + 5j)) for one in (found, other))
    np.testing.assert_allclose(poles, expected, rtol=1e-8)
    np.testing.assert_allclose(gains, others, rtol=1e-7, atol=1e-9)
    names = [pair.written.state_names.index(name) for name in found.state_names]
    np.testing.assert_array_equal(found.states[names], np.eye(len(names)))
    whole = pair.written.linearize(rest, u, minimal=False)
    assert whole[0].shape == (len(pair.written.state_names),) * 2


def test_the_linearisation_of_a_moving_point_is_that_of_the_reduced_form(pair):
    """With x = T q in deviations: A T = T A_q + dT/dt, where T moves with the point."""
    u = [1.0]
    y = np.r_[pair.start, np.zeros(len(pair.written.unknown_names) - len(pair.start))]
    if pair.written.name == "Pendulum":
        # The force of a rod: q.q - g y at the point; damping and torque do not act along it.
        rate = pair.by_hand.rhs(0.0, pair.point, u)
        known = {"lam": pair.point[1] ** 2 - 9.81 * pair.start[1]}
        known |= {"a": pair.point[0], "der(a)": pair.point[1], "der(der(a))": rate[1]}
        for name in known.keys() & set(pair.written.unknown_names):
            y[pair.written.unknown_names.index(name)] = known[name]
    found, other = pair.written.linearize(y, u), pair.by_hand.linearize(pair.point, u)
    free = [pair.written.state_names.index(name) for name in found.state_names]
    rate = pair.by_hand.rhs(0.0, pair.point, u)
    ahead, behind = (pair.derivative(pair.point + h * rate)[free] for h in (1e-5, -1e-5))
    T = pair.derivative(pair.point)[free]
    np.testing.assert_allclose(found[0] @ T, T @ other[0] + (ahead - behind) / 2e-5, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found[1], T @ other[1], atol=1e-9)


def test_steady_states_and_trims_are_those_of_the_reduced_form(pair):
    for u in ([0.5], [1.5]):
        found, other = pair.written.steady_state(u), pair.by_hand.steady_state(u)
        np.testing.assert_allclose(found[: len(pair.start)], pair.states(other), atol=1e-9)
    if pair.written.name == "Vessels":
        y, u = pair.written.trim({"n2": 4.0}, ["F"])
        # At rest F = k n1, and n1 is half of n2.
        np.testing.assert_allclose([y[0], u[0]], [2.0, 0.6], rtol=1e-9)
    else:
        y, u = pair.written.trim({"x": 0.5}, ["M"])
        np.testing.assert_allclose([y[1], u[0]], [-np.sqrt(0.75), 9.81 * 0.5], rtol=1e-9)


def test_snapshots_batches_and_rollouts_repeat_an_episode(pair):
    actions = pair.actions(12)
    env = smpl.Env(pair.written, normalize=False)
    env.reset(seed=0, options={"state": pair.start})
    seen, rewards = [], []
    for k, action in enumerate(actions):
        observation, reward, *_ = env.step(action)
        seen.append(observation)
        rewards.append(reward)
        if k == 4:
            snapshot = env.snapshot()
    last = env.state.copy()
    env.restore(snapshot)
    for k in range(5, 12):
        observation, reward, *_ = env.step(actions[k])
        np.testing.assert_array_equal(observation, seen[k])
        assert reward == rewards[k]
    np.testing.assert_array_equal(env.state, last)
    found = pair.written.rollout(np.tile(pair.start, (3, 1)), actions, threads=2)
    np.testing.assert_array_equal(found.states[:, -1], np.tile(last, (3, 1)))
    np.testing.assert_array_equal(found.rewards[1], rewards)
    other = pair.by_hand.rollout(pair.point, actions)
    np.testing.assert_allclose(found.rewards[0], other.rewards[0], rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(found.observations[0], other.observations[0], rtol=1e-6, atol=1e-6)


def test_vector_environments_are_single_ones(pair):
    batch = smpl.VectorEnv(pair.written, num_envs=3, normalize=False, num_threads=2)
    single = smpl.Env(pair.written, normalize=False)
    batch.reset(seed=1)
    single.reset(seed=2)
    assert isinstance(batch, gymnasium.vector.VectorEnv)
    for action in pair.actions(5):
        observations, rewards, *_ = batch.step(np.tile(action, (3, 1)))
        observation, reward, *_ = single.step(action)
        np.testing.assert_array_equal(observations[1], observation)
        assert rewards[1] == reward


def test_a_regulator_is_that_of_the_reduced_form(pair):
    pytest.importorskip("scipy.linalg")
    weights = {pair.written.observation_names[0]: 3.0, pair.written.observation_names[1]: 0.5}
    gains = []
    for model, start in ((pair.written, pair.start), (pair.by_hand, pair.point)):
        found = LQR(model, output_weight=weights, action_weight={model.action_names[0]: 1.0})
        gains.append((found, start))
    (mine, _), (other, _) = gains
    expected = other.gain @ np.linalg.pinv(pair.derivative(other.state))
    np.testing.assert_allclose(
        mine.gain @ pair.derivative(other.state), expected @ pair.derivative(other.state), rtol=1e-6, atol=1e-9
    )
    np.testing.assert_allclose(np.sort_complex(mine.eigenvalues), np.sort_complex(other.eigenvalues), rtol=1e-6)


def test_predictive_control_chooses_the_actions_of_the_reduced_form(pair):
    pytest.importorskip("casadi", reason="CasADi is not installed")
    chosen = []
    for model, start in ((pair.written, pair.start), (pair.by_hand, pair.point)):
        env = smpl.Env(model, normalize=False)
        env.reset(seed=0, options={"state": start})
        controller = NMPC(model, 10, degree=4)
        controller.reset(env)
        decisions = []
        for _ in range(4):
            decisions.append(controller.action(env))
            env.step(decisions[-1])
        assert controller.fallbacks == 0
        chosen.append(np.array(decisions))
    np.testing.assert_allclose(chosen[0], chosen[1], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("kind", [ExtendedKalmanFilter, MovingHorizonEstimator])
def test_estimates_follow_the_plant(pair, kind):
    """From exact readings and a wrong start the estimate comes to the states, on the constraint."""
    model = pair.written
    env = smpl.Env(model, normalize=False)
    env.reset(seed=0, options={"state": pair.start})
    wrong = pair.states(pair.point + np.array([0.2, 0.1]))
    estimator = kind(
        model,
        initial=wrong,
        deviation=dict.fromkeys(model.state_names, 0.3),
        process_noise=dict.fromkeys(model.state_names, 1e-3),
        noise=dict.fromkeys(model.observation_names, 1e-3),
    )
    estimator.reset(env)
    estimator.update(env)
    for action in pair.actions(10):
        env.step(action)
        found = estimator.update(env)
    seen = slice(0, len(found) if model.name == "Pendulum" else 1)
    np.testing.assert_allclose(found[seen], env.state[seen], atol=2e-3)


def test_parameters_are_found_from_runs(pair, tmp_path):
    pytest.importorskip("scipy.optimize")
    truth = {"Vessels": {"k": 0.4}, "Pendulum": {"b": 0.8, "g": 9.0}}[pair.written.name]
    model = pair.by_hand
    actions = pair.actions(15)
    found = model.rollout(pair.point, actions, parameters=truth)
    path = tmp_path / "run.csv"
    names = [f"obs.{name}" for name in model.observation_names]
    states = [pair.states(q) for q in found.states[0]]
    rows = [",".join(["step", "time", *pair.written.state_names, model.action_names[0], *names])]
    for k in range(16):
        action = "" if k == 0 else repr(float(actions[k - 1][0]))
        values = [*states[k], *found.observations[0][k]]
        cells = [repr(float(one)) for one in values]
        n = len(pair.written.state_names)
        rows.append(",".join([str(k), repr(k * model.step), *cells[:n], action, *cells[n:]]))
    path.write_text("\n".join(rows) + "\n")
    fit = smpl.fit(pair.written, [path], list(truth))
    for name, value in truth.items():
        assert abs(fit.parameters[name] - value) < 1e-4 * value, fit.parameters


def test_a_model_read_from_json_steps_alike(pair, tmp_path):
    import json

    path = tmp_path / "model.json"
    path.write_text(json.dumps(smpl.export.json(pair.written)))
    again = smpl.compile(path)
    np.testing.assert_array_equal(again.step(pair.start, [1.0]), pair.written.step(pair.start, [1.0]))
    assert again.native.projected == pair.written.native.projected
