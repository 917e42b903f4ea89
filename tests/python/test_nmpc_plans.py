"""Plans of the predictive controller between sampling instants, at kinks, and compared with SciPy."""

import warnings

import numpy as np
import pytest

import smpl
from smpl.controllers import NMPC
from smpl.evaluation import run_episode

casadi = pytest.importorskip("casadi", reason="CasADi is not installed")
# A step is about one period, so that the ends of steps tell nothing of what is between.
SPRING = """model Spring "a mass on a spring"
time t : s
action u = 0 in -2..2
state x = 1 in -10..10
state v : 1/s = 0 in -10..10
eq d/dt x = v
eq d/dt v = (u - x) * 1 [1/s^2]
observe x
episode { step = 6 [s], max_steps = 100, error_reward = -1000 }
"""
FED_BATCH = """model FedBatch "fed-batch with inhibition by the substrate"
time t : h
param mu_max : 1/h = 1
param K      : g/L = 0.5
param K_I    : g/L = 5
param S_f    : g/L = 100
action F : L/h = 0.1 in 0..0.5
state X : g/L = 1 in 0..100
state P : g/L = 0 in 0..100
state S : g/L = 2 in 0..100
state V : L = 1 in 0.1..5
let s  : g/L = max(S, 0 [g/L])
let mu : 1/h = mu_max*s/(K + s + s^2/K_I)
eq d/dt X = mu*X - F/V*X
eq d/dt P = (0.5*mu + 0.02 [1/h])*X - F/V*P
eq d/dt S = -mu/0.5*X + F/V*(S_f - S)
eq d/dt V = F
observe X, P, S, V
reward amount default = (P*V - previous(P*V)) / 1 [g]
episode { step = 2.5 [h], max_steps = 20, error_reward = -100 }
"""
UNGUARDED = FED_BATCH.replace("max(S, 0 [g/L])", "S")


def begun(source, **options):
    env = smpl.Env(smpl.compile(source=source), normalize=False)
    env.reset(seed=0, options=options)
    return env


def planned(env, *arguments, **options):
    controller = NMPC(env, *arguments, **options)
    controller.reset(env)
    controller.action(env)
    return controller


def positions(start, plan, shares, step):
    """Of the mass at shares of every step, by its closed solution: a turn about the point that the force holds."""
    x, v, found = *start, []
    for u in plan[:, 0]:
        found.append([u + (x - u) * np.cos(step * s) + v * np.sin(step * s) for s in shares])
        x, v = u + (x - u) * np.cos(step) + v * np.sin(step), (u - x) * np.sin(step) + v * np.cos(step)
    return np.array(found)


def test_bounds_hold_between_the_ends_of_steps():
    env = begun(SPRING)
    nodes = np.array(casadi.collocation_points(7, "radau"))
    least = {}
    for path in (True, False):
        controller = planned(env, 4, {"u": 1}, set_point={"u": 0}, bounds={"x": (0, None)}, path=path, degree=7)
        assert controller.fallbacks == 0
        inside = positions((1, 0), controller.plan, nodes, 6)
        assert inside[:, -1].min() > -1e-3
        least[path] = inside.min()
    assert least[False] < -0.3
    assert least[True] > -5e-3


def test_a_start_out_of_hard_bounds_comes_back_in_time():
    env = begun(SPRING.replace("step = 6", "step = 3"), state=[-0.2, 0.0])
    controller = planned(env, 4, {"u": 1}, set_point={"u": 0}, bounds={"x": (0, None)}, hard=["x"], degree=7)
    assert controller.fallbacks == 0
    inside = positions((-0.2, 0), controller.plan, casadi.collocation_points(7, "radau"), 3)
    assert inside[0].min() > -0.2 - 1e-3
    assert inside[1:].min() > -1e-3 and inside[0, -1] > -1e-3


def test_a_pole_outside_of_the_bounds_is_not_passed():
    env = begun(UNGUARDED)
    controller = planned(env, 8, "amount", elements=2)
    assert controller.error < 0.05
    followed = env.rollout(controller.plan[None])
    amounts = controller.predicted[:, 1] * controller.predicted[:, 3]
    assert followed.returns[0] == pytest.approx(amounts[-1], rel=5e-3)


def test_no_plan_of_an_evolution_is_better():
    optimize = pytest.importorskip("scipy.optimize")
    env = begun(FED_BATCH)

    def cost(shares):
        found = env.rollout(0.5 * shares.T[:, :, None])
        return np.where(found.states[:, -1, 3] <= 5, -found.returns, 0.0)

    search = {"vectorized": True, "updating": "deferred", "polish": False, "rng": 0, "popsize": 10, "maxiter": 60}
    best = -optimize.differential_evolution(cost, [(0, 1)] * 8, **search).fun
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        reached = {n: env.rollout(planned(env, 8, "amount", starts=n).plan[None]).returns[0] for n in (0, None)}
    assert reached[None] > 0.995 * best
    # From the state at rest alone the solver ends at another, worse optimum.
    assert reached[0] < 0.8 * best


@pytest.mark.filterwarnings("ignore:the first plan is predicted")
def test_the_horizon_of_a_batch_ends_with_it():
    slower = FED_BATCH.replace("mu_max : 1/h = 1", "mu_max : 1/h = 0.4").replace("step = 2.5", "step = 1")
    env = begun(slower)
    promised = env.rollout(planned(env, 20, "amount").plan[None]).returns[0]
    batch = run_episode(env, NMPC(env, 20, "amount", shrinking=True), 0)
    assert batch.steps == 20 and batch.total == pytest.approx(promised, rel=1e-3)
    # What is sown for later is not reaped.
    assert run_episode(env, NMPC(env, 20, "amount"), 0).total < 0.8 * promised


@pytest.mark.filterwarnings("ignore:the first plan is predicted")
def test_a_kink_does_not_lose_the_plan():
    slower = FED_BATCH.replace("mu_max : 1/h = 1", "mu_max : 1/h = 0.4").replace("step = 2.5", "step = 3")
    envs = [begun(source) for source in (slower, slower.replace("max(S, 0 [g/L])", "S"))]
    kinked, smooth = (planned(env, 20, "amount") for env in envs)
    # The substrate stays positive by itself, so that both are the same process.
    reached = [envs[1].rollout(one.plan[None]).returns[0] for one in (kinked, smooth)]
    assert reached[0] > 0.98 * reached[1]
    assert kinked.fallbacks == 0 and kinked.unfinished == 1 and "1 unfinished" in kinked.report()
    assert smooth.unfinished == 0


def test_a_wrong_prediction_is_told():
    env = begun(FED_BATCH.replace("mu_max : 1/h = 1", "mu_max : 1/h = 0.4").replace("step = 2.5", "step = 3"))
    with pytest.warns(RuntimeWarning, match=r"predicted with an error of 0\.\d+ of the range of \w: give more nodes"):
        controller = planned(env, 8, "amount")
    right = env.rollout(controller.plan[None]).states[0]
    off = np.abs(controller.predicted - right).max(axis=0)
    width = np.ptp(np.concatenate([controller.predicted, right]), axis=0)
    assert controller.error == pytest.approx((off / width).max(), rel=0.2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert planned(smpl_reactor(), 20).error < 1e-3


def smpl_reactor():
    env = smpl.Env("reactor", normalize=False)
    env.reset(seed=0)
    return env
