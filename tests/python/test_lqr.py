"""Linear-quadratic control against SciPy's Riccati solvers and closed forms."""

from pathlib import Path

import numpy as np
import pytest

import smpl
from smpl.controllers import LQR
from smpl.controllers.lqr import sampled, sampled_cost
from smpl.evaluation import run_episode

linalg = pytest.importorskip("scipy.linalg")
PROBLEMS = Path(__file__).resolve().parent.parent / "problems"
INTEGRATOR = """model Integrator "a double integrator"
time t : s
action u = 0 in -100..100
param push = 0
state x = 0 in -100..100
state v : 1/s = 0 in -100..100
eq d/dt x = v
eq d/dt v = (u + push) * 1 [1/s^2]
steady { u = 0, x = 0, v = 0 }
observe x
reward r default = -sq(x)
episode { step = 0.5 [s], max_steps = 100, error_reward = -1000 }
"""
STUCK = INTEGRATOR.replace("eq d/dt x = v", "state z = 0 in -9..9\neq d/dt z = 0.1 [1/s]*z\neq d/dt x = v")


@pytest.fixture(scope="module")
def integrator():
    return smpl.compile(source=INTEGRATOR)


def test_the_gain_of_the_double_integrator_in_continuous_time_is_its_closed_form(integrator):
    found = LQR(integrator, {"x": 1.0}, {"u": 1.0}, discrete=False)
    np.testing.assert_allclose(found.gain, [[1.0, np.sqrt(2)]], rtol=1e-10)


def test_sampling_is_exact(integrator):
    h = 0.5
    A, B, _, _ = integrator.linearize([0, 0], [0])
    F, G = sampled(A, B, h)
    np.testing.assert_allclose(F, [[1, h], [0, 1]])
    np.testing.assert_allclose(G, [[h**2 / 2], [h]])
    # The integral of (x + v s + u s^2/2)^2 + 3 u^2 over the interval.
    Q, R, N = sampled_cost(A, B, np.diag([1.0, 0.0]), np.array([[3.0]]), np.zeros((2, 1)), h)
    np.testing.assert_allclose(Q, [[h, h**2 / 2], [h**2 / 2, h**3 / 3]], atol=1e-14)
    np.testing.assert_allclose(R, [[3 * h + h**5 / 20]])
    np.testing.assert_allclose(N, [[h**3 / 6], [h**4 / 8]], atol=1e-14)


@pytest.mark.parametrize("name", ["reactor", "van_de_vusse", "four_tanks"])
def test_the_sampled_regulator_is_that_of_scipy(name):
    model = smpl.compile(name if name == "reactor" else PROBLEMS / f"{name}.eq")
    env = smpl.Env(model)
    env.reset(seed=0)
    rng = np.random.default_rng(1)
    q = dict(zip(model.state_names, rng.uniform(0.5, 2, len(model.state_names)), strict=True))
    r = dict(zip(model.action_names, rng.uniform(0.5, 2, len(model.action_names)), strict=True))
    A, B, C, _ = model.linearize(env.steady_state, env.steady_action)
    Q, R = np.diag(list(q.values())), np.diag(list(r.values()))
    output = {model.observation_names[0]: 3.0}
    Q = Q + 3.0 * np.outer(C[0], C[0])
    n, m = B.shape
    M = linalg.expm(np.block([[A, B], [np.zeros((m, n + m))]]) * model.step)
    F, G = M[:n, :n], M[:n, n:]
    P = linalg.solve_discrete_are(F, G, Q, R)
    found = LQR(model, q, r, output_weight=output)
    np.testing.assert_allclose(found.gain, np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F), rtol=1e-8)
    assert np.abs(found.eigenvalues).max() < 1
    P = linalg.solve_continuous_are(A, B, Q, R)
    found = LQR(model, q, r, output_weight=output, discrete=False)
    np.testing.assert_allclose(found.gain, np.linalg.solve(R, B.T @ P), rtol=1e-8)
    assert found.eigenvalues.real.max() < 0


def test_the_cost_of_an_episode_is_that_of_the_riccati_equation(integrator):
    """x' P x is what the sampled loop costs from x on, here summed over an episode of the environment itself."""
    regulator = LQR(integrator, {"x": 1.0}, {"u": 2.0})
    env = smpl.Env(integrator, normalize=False)
    episode = run_episode(env, regulator, 0, {"state": {"x": 3.0, "v": -1.0}})
    cost = (episode.states[:, 0] ** 2).sum() + 2 * (episode.actions**2).sum()
    start = np.array([3.0, -1.0])
    assert cost == pytest.approx(start @ regulator.riccati @ start, rel=1e-5)


THROUGH = """model Through
time t : s
action u = 0 in -10..10
state x = 0 in -10..10
state v = 0 in -10..10
eq d/dt x = (-0.5*x + u)/(1 [s])
eq d/dt v = (x - v)/(1 [s])
observe x in -10..10, y = x + 2*u in -50..50
reward r default = -sq(x)
episode { step = 0.5 [s], max_steps = 10 }
"""


@pytest.mark.parametrize("kind", ["sum", "integral", "continuous"])
def test_an_output_that_an_action_moves_at_once_is_weighed_as_it_is(kind):
    linalg = pytest.importorskip("scipy.linalg")
    options = {"discrete": False} if kind == "continuous" else {"cost": kind}
    found = LQR(smpl.compile(source=THROUGH), {"v": 0.5}, {"u": 0.1}, output_weight={"y": 3.0}, **options).gain
    A, B = np.array([[-0.5, 0], [1, -1]]), np.array([[1.0], [0]])
    # 3 (x + 2 u)^2 + 0.5 v^2 + 0.1 u^2
    weight = np.array([[3.0, 0, 6], [0, 0.5, 0], [6, 0, 12.1]])
    if kind == "continuous":
        Q, R, N = weight[:2, :2], weight[2:, 2:], weight[:2, 2:]
        P = linalg.solve_continuous_are(A, B, Q, R, s=N)
        np.testing.assert_allclose(found, np.linalg.solve(R, B.T @ P + N.T), rtol=1e-8)
        return
    whole = np.zeros((3, 3))
    whole[:2] = np.hstack([A, B])
    F = linalg.expm(whole * 0.5)
    if kind == "integral":
        # By Gauss's quadrature of exp(Ws)' weight exp(Ws).
        nodes, parts = np.polynomial.legendre.leggauss(12)
        moments = [linalg.expm(whole * (1 + node) / 4) for node in nodes]
        weight = sum(part / 4 * moment.T @ weight @ moment for part, moment in zip(parts, moments, strict=True))
    Q, R, N, G = weight[:2, :2], weight[2:, 2:], weight[:2, 2:], F[:2, 2:]
    P = linalg.solve_discrete_are(F[:2, :2], G, Q, R, s=N)
    np.testing.assert_allclose(found, np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F[:2, :2] + N.T), rtol=1e-8)


def test_integral_action_removes_the_offset_of_a_constant_disturbance(integrator):
    env = smpl.Env(integrator, normalize=False)
    options = {"state": {"x": 1.0, "v": 0.0}, "parameters": {"push": 0.4}}
    plain = run_episode(env, LQR(integrator, {"x": 1.0}, {"u": 1.0}), 0, options)
    held = run_episode(env, LQR(integrator, {"x": 1.0}, {"u": 1.0}, integral=["x"]), 0, options)
    # At rest u = -push: without an integral x = push/K_x.
    gain = LQR(integrator, {"x": 1.0}, {"u": 1.0}).gain[0, 0]
    assert plain.states[-1, 0] == pytest.approx(0.4 / gain, rel=1e-3)
    assert held.states[-1, 0] == pytest.approx(0.0, abs=1e-3)


def test_a_regulator_brings_the_reactor_to_its_set_point_with_a_wrong_heat_transfer():
    env = smpl.Env("reactor", normalize=False)
    regulator = LQR(env, integral=["c_A", "h"])
    episode = run_episode(env, regulator, 3, {"start": "steady", "parameters": {"U": 50.0}})
    np.testing.assert_allclose(episode.states[-1, [0, 2]], [0.8778252, 0.659], atol=1e-3)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"state_weight": {"c": 1.0}}, r"state_weight: unknown 'c'; there are: c_A \[kmol/m\^3\], T \[degC\], h \[m\]"),
        ({"state_weight": {"h": -1.0}}, "not negative"),
        ({"action_weight": {"T_c": 1.0}}, "action_weight: q_out weigh nothing"),
        ({"integral": ["c_A", "T", "h"]}, "3 outputs, but Reactor has 2 actions"),
        ({"integral": ["pH"]}, r"integral: unknown 'pH'; there are: c_A"),
        ({"cost": "mean"}, "cost is 'mean'"),
    ],
)
def test_what_does_not_fit_the_model_is_refused(changes, says):
    with pytest.raises(ValueError, match=says):
        LQR(smpl.compile("reactor"), **changes)


def test_what_no_action_moves_is_named():
    with pytest.raises(ValueError, match=r"no action moves the mode .* of z, which does not decay"):
        LQR(smpl.compile(source=STUCK))


def test_a_regulator_of_another_model_is_refused(integrator):
    with pytest.raises(ValueError, match="this regulator is for Integrator, the environment is Reactor"):
        run_episode(smpl.Env("reactor"), LQR(integrator), 0)
