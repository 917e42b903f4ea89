"""Predictive control by collocation against Riccati equations, SciPy's optimisers and integrators, and do-mpc."""

import warnings
from pathlib import Path

import numpy as np
import pytest

import smpl
from smpl.controllers import NMPC, ExtendedKalmanFilter, baseline
from smpl.evaluation import run_episode

casadi = pytest.importorskip("casadi", reason="CasADi is not installed")
PROBLEMS = Path(__file__).resolve().parent.parent / "problems"
LINEAR = """model Linear "a lightly damped mass"
time t : s
action u = 0 in -100..100
param push : 1 = 0
state x = 0 in -100..100
state v : 1/s = 0 in -100..100
eq d/dt x = v
eq d/dt v = (u + push - 1*x) * 1 [1/s^2] - 0.2 [1/s] * v
steady { u = 0 }
observe x
reward r default = -sq(x)
episode { step = 0.25 [s], max_steps = 100, error_reward = -1000 }
"""
# The same motion with the force as an algebraic unknown, and with a rate inside of an equation.
ALGEBRAIC = LINEAR.replace(
    "eq d/dt v = (u + push - 1*x) * 1 [1/s^2]",
    "var F : 1 = 0\neq F + 0.1*F^3 = u + push - x\neq d/dt v = F * 1 [1/s^2]",
)
IMPLICIT = LINEAR.replace("eq d/dt v =", "eq d/dt v + 0.1 [s] * der(v) * d/dt x / 1 [1/s] * 0 [1/s] =")
WEIGHTS = {"c_A": 0.1, "T": 0.1, "h": 0.1}


def at(env, state):
    env.reset(seed=0, options={"state": state})
    return env


def decide(controller, env):
    controller.reset(env)
    return controller.action(env)


@pytest.mark.parametrize("solver", ["auto", "fatrop", "ipopt", "sqp"])
def test_a_linear_plant_gets_the_riccati_gain(solver):
    linalg = pytest.importorskip("scipy.linalg")
    A, B = np.array([[0, 1], [-1, -0.2]]), np.array([[0], [1.0]])
    M = linalg.expm(np.block([[A, B], [np.zeros((1, 3))]]) * 0.25)
    F, G = M[:2, :2], M[:2, 2:]
    Q, R = np.diag([3.0, 0.5]), np.array([[0.2]])
    P = linalg.solve_discrete_are(F, G, Q, R)
    K = np.linalg.solve(R + G.T @ P @ G, G.T @ P @ F)
    model = smpl.compile(source=LINEAR)
    env = smpl.Env(model, normalize=False)
    controller = NMPC(model, 80, {"x": 3, "v": 0.5, "u": 0.2}, degree=4, solver=solver)
    for state in ([1.0, 0.5], [-2.0, 1.0]):
        np.testing.assert_allclose(decide(controller, at(env, state)), -K @ state, rtol=1e-5)
    assert controller.fallbacks == controller.retries == 0


def shooting(rates, state, horizon, step, cost, low, high):
    """The best actions, as shares of their box, by SciPy's optimiser over SciPy's integrator."""
    integrate, optimize = pytest.importorskip("scipy.integrate"), pytest.importorskip("scipy.optimize")

    def total(flat):
        x, value = np.array(state, float), 0.0
        for share in flat.reshape(horizon, -1):
            u = low + share * (high - low)
            x = integrate.solve_ivp(lambda t, y, u=u: rates(y, u), (0, step), x, "LSODA", rtol=1e-9, atol=1e-11).y[
                :, -1
            ]
            value += cost(x, u)
        return value

    start, bounds = np.full(horizon * len(low), 0.5), [(0, 1)] * horizon * len(low)
    found = optimize.minimize(total, start, method="L-BFGS-B", jac="3-point", bounds=bounds, options={"ftol": 1e-12})
    return low + found.x.reshape(horizon, -1) * (high - low), found.fun


def test_the_reactor_gets_the_plan_of_an_optimiser_over_an_integrator():
    from smpl_benchmarks.peers.reactor import rates

    env = at(smpl.Env("reactor", normalize=False), [0.86, 50.0, 0.65])
    target, nominal = np.array([0.8778252, 51.34660837, 0.659]), np.array([26.85, 0.1])

    def cost(x, u):
        return np.sum(((x - target) / [0.01, 1, 0.01]) ** 2) + np.sum(((u - nominal) / [2, 0.02]) ** 2)

    best, value = shooting(rates, env.state, 3, 0.1, cost, env.action_low, env.action_high)
    weights = {"c_A": 1e4, "T": 1, "h": 1e4, "T_c": 0.25, "q_out": 2500}
    points = {"c_A": 0.8778252, "T": 51.34660837, "h": 0.659}
    controller = NMPC(env, 3, weights, set_point=points, declared=False)
    action = decide(controller, env)
    np.testing.assert_allclose(action, best[0], rtol=2e-4)
    followed = env.rollout(controller.plan)
    np.testing.assert_allclose(followed.states[0], controller.predicted, rtol=1e-6)
    reached = sum(cost(x, u) for x, u in zip(followed.states[0, 1:], controller.plan, strict=True))
    assert reached == pytest.approx(value, rel=1e-6)


def test_do_mpc_finds_the_same_actions_on_the_reactor():
    do_mpc = pytest.importorskip("do_mpc", reason="do-mpc is not installed")
    env = smpl.Env("reactor", normalize=False)
    peer = do_mpc.controller.MPC(smpl.export.do_mpc(env.model))
    peer.settings.n_horizon, peer.settings.t_step = 20, env.model.step
    peer.settings.collocation_deg, peer.settings.store_full_solution = 3, False
    peer.settings.supress_ipopt_output()
    target = dict(zip(env.state_names, env.model.steady_state([26.85, 0.1]), strict=True))
    cost = sum(0.1 * (peer.model.x[name] - target[name]) ** 2 for name in env.state_names)
    peer.set_objective(lterm=cost, mterm=cost)
    peer.set_rterm(T_c=0, q_out=0)
    for name, low, high in zip(env.action_names, env.action_low, env.action_high, strict=True):
        peer.bounds["lower", "_u", name], peer.bounds["upper", "_u", name] = low, high
    peer.setup()
    controller = NMPC(env, 20, WEIGHTS, declared=False)
    for state in ([0.9, 52.0, 0.66], [0.87, 51.0, 0.64], [0.8, 48.0, 0.7]):
        peer.x0 = np.array(state)
        peer.set_initial_guess()
        expected = np.ravel(peer.make_step(np.array(state)[:, None]))
        np.testing.assert_allclose(decide(controller, at(env, state)), expected, rtol=1e-4, atol=1e-4)


def test_a_declared_reward_is_maximised():
    env = at(smpl.Env("reactor", normalize=False), [0.9, 53.0, 0.62])
    controller = NMPC(env, 8)
    decide(controller, env)
    best = env.rollout(controller.plan)
    np.testing.assert_allclose(best.states[0], controller.predicted, rtol=1e-6)
    random = np.random.default_rng(0)
    others = controller.plan + random.normal(0, [0.5, 0.005], (200, 8, 2))
    others = np.clip(others, env.action_low, env.action_high)
    assert best.returns[0] >= env.rollout(others).returns.max()


@pytest.mark.parametrize("source", [ALGEBRAIC, LINEAR])
def test_a_function_is_a_cost_and_algebraic_unknowns_are_predicted(source):
    env = at(smpl.Env(smpl.compile(source=source), normalize=False), [1.0, 0.0])
    controller = NMPC(env, 12, lambda value: value["x"] ** 2 + 0.01 * value["u"] ** 2, hold=[1, 2, 3], degree=4)
    decide(controller, env)
    np.testing.assert_allclose(env.rollout(controller.plan).states[0], controller.predicted, atol=1e-6)
    assert (controller.plan[1] == controller.plan[2]).all() and (controller.plan[3:] == controller.plan[3]).all()
    assert controller.plan[0] != controller.plan[1]


def test_a_plant_of_one_state_gets_a_plan():
    """The level that one step reaches: a plan whose every stage is at the set-point from the first instant on."""
    source = """model Tank
time t : min
action q = 0.1 in 0..10
state h = 1 in 0..20
eq d/dt h = (q - 0.5*h)/(1 [min])
observe h
reward r default = h
episode { step = 1 [min], max_steps = 5 }
"""
    env = smpl.Env(smpl.compile(source=source), normalize=False)
    env.reset(seed=0, options={"state": {"h": 1.0}})
    controller = NMPC(env, 5, {"h": 1}, set_point={"h": 2.0})
    controller.reset(env)
    decay = np.exp(-0.5)
    # h(1) = h decay + 2 q (1 - decay)
    np.testing.assert_allclose(controller.action(env), (2.0 - decay) / (2 * (1 - decay)), rtol=1e-5)


def test_rates_of_actions_are_limited():
    env = smpl.Env("reactor", normalize=False, max_steps=30)
    controller = NMPC(env, 10, {"c_A": 100, "h": 10}, set_point={"c_A": 0.86, "h": 0.62}, rate_limit={"T_c": 0.5})
    episode = run_episode(env, controller, 0, {"start": "steady"})
    moves = np.abs(np.diff(np.concatenate([[[26.85, 0.1]], episode.actions]), axis=0)).max(axis=0)
    assert 0.49 < moves[0] < 0.5 + 1e-5 and moves[1] > 0.01
    assert episode.states[-1][0] == pytest.approx(0.86, abs=1e-3)


def test_known_set_points_and_disturbances_are_anticipated():
    env = smpl.Env("reactor", normalize=False, max_steps=12)
    step = {"c_A": lambda t: 0.8778252 if t < 0.65 else 0.89, "h": 0.659}
    actions = run_episode(env, NMPC(env, 10, {"c_A": 100, "h": 10}, set_point=step), 0, {"start": "steady"}).actions
    # The step comes at the end of the seventh interval.
    assert abs(actions[5, 0] - 26.85) > 0.5
    warmer = np.where(np.arange(12) < 6, 76.85, 80.0)
    weights = {"T": 1, "h": 10}
    known = NMPC(env, 10, weights, forecast={"T_f": warmer}, degree=4)
    decide(known, at(env, env.model.steady_state([26.85, 0.1])))
    assert known.plan[:6, 0].std() < 0.5 < known.plan[0, 0] - known.plan[6, 0]
    constant = NMPC(env, 10, weights, forecast={"T_f": 80.0}, degree=4)
    other = NMPC(env, 10, weights, p={"T_f": 80.0}, set_point={"T": 51.34660619, "h": 0.659}, degree=4)
    np.testing.assert_allclose(decide(constant, env), decide(other, env), rtol=1e-5)


def test_a_wrong_model_without_offset():
    """A set-point step, an unmeasured disturbance of the feed, and a wrong heat-transfer coefficient."""
    plant = smpl.Env("reactor", normalize=False, max_steps=120)
    options = {"state": [0.8778, 51.35, 0.659], "parameters": {"U": 56.5, "T_f": 77.4, "q_in": 0.101}}
    points = {"c_A": lambda t: 0.8778 if t < 2 else 0.89, "h": 0.68}
    nominal, weights = smpl.compile("reactor"), {"c_A": 100, "h": 10}
    for offset_free in (True, False):
        controller = NMPC(nominal, 20, weights, set_point=points, rate_weight={"T_c": 1e-4}, offset_free=offset_free)
        episode = run_episode(plant, controller, 0, options)
        errors = np.abs(episode.states[-1][[0, 2]] - [0.89, 0.68])
        assert errors.max() < 1e-5 if offset_free else errors.max() > 5e-4
        assert controller.fallbacks == 0


def test_a_hidden_concentration_without_offset():
    plant = smpl.Env("reactor", normalize=False, max_steps=150, observation="online")
    options = {"state": [0.8778, 51.35, 0.659], "parameters": {"U": 56.5, "T_f": 77.4, "q_in": 0.101}}
    kalman = ExtendedKalmanFilter(plant, parameters={"U": 0.3, "q_in": 5e-4})
    points = {"c_A": lambda t: 0.8778 if t < 2 else 0.89, "h": 0.68}
    controller = NMPC(
        smpl.compile("reactor"),
        20,
        {"c_A": 100, "h": 10},
        set_point=points,
        rate_weight={"T_c": 1e-4},
        estimator=kalman,
    )
    episode = run_episode(plant, controller, 0, options)
    assert np.abs(episode.states[-30:, [0, 2]] - [0.89, 0.68]).max() < 1e-2
    with pytest.raises(ValueError, match="sees the level 'online', the environment shows 'default'"):
        run_episode(smpl.Env("reactor"), controller, 0)


def test_bounds_in_conflict_are_reported():
    env = at(smpl.Env("reactor", normalize=False), [0.85, 60.0, 0.65])
    controller = NMPC(env, 5, WEIGHTS, bounds={"T": (None, 45.0), "h": (0.2, 0.9)}, hard=["T"])
    with pytest.warns(RuntimeWarning, match="no plan holds all bounds from here: T in -inf to 45 degC is missed by"):
        action = decide(controller, env)
    assert controller.fallbacks == 1
    assert "T_c is at its lower bound 15 degC" in controller.conflicts
    assert (action >= env.action_low).all() and (action <= env.action_high).all()
    # The same bound as a soft one does not conflict.
    soft = NMPC(env, 5, WEIGHTS, bounds={"T": (None, 45.0)})
    np.testing.assert_allclose(decide(soft, env)[0], 15.0, atol=1e-4)
    assert soft.fallbacks == 0 and not soft.conflicts


def test_an_active_bound_holds_in_the_plant():
    env = smpl.Env("reactor", normalize=False, max_steps=40)
    controller = NMPC(env, 15, {"c_A": 100, "h": 10}, set_point={"c_A": 0.84, "h": 0.659}, bounds={"T": (None, 53.0)})
    episode = run_episode(env, controller, 0, {"start": "steady"})
    assert episode.states[:, 1].max() < 53.0 + 1e-3
    assert episode.states[-1, 1] == pytest.approx(53.0, abs=1e-2)


def test_a_budget_is_kept_with_an_action_in_the_box():
    env = at(smpl.Env("reactor", normalize=False), [0.7, 45.0, 0.8])
    controller = NMPC(env, 40, WEIGHTS, solver="ipopt", budget=1e-3)
    action = decide(controller, env)
    assert controller.fallbacks == 1 and controller.decisions == 1 and "1 fallbacks" in controller.report()
    np.testing.assert_allclose(action, [26.85, 0.1])
    free = NMPC(env, 40, WEIGHTS, solver="ipopt", budget=20.0)
    decide(free, env)
    assert free.fallbacks == 0 and len(free.times) == 1


def test_real_time_iterations_hold_the_reactor():
    env = smpl.Env("reactor", normalize=False, max_steps=60)
    full, quick = (NMPC(env, 20, WEIGHTS, solver="sqp", iterations=n) for n in (None, 1))
    ends = [run_episode(env, controller, 5) for controller in (full, quick)]
    np.testing.assert_allclose(ends[0].states[-1], ends[1].states[-1], atol=1e-5)
    assert quick.fallbacks == 0 and ends[1].rewards.sum() == pytest.approx(ends[0].rewards.sum(), rel=0.1)


def test_a_part_of_a_plant_is_the_model():
    env = smpl.Env("mab", normalize=False, max_steps=4)
    env.reset(seed=2, options={"start": "nominal"})
    nominal = dict(zip(env.state_names, env.state.tolist(), strict=True))
    controller = baseline("mab", "mpc", horizon=6)
    # A start above the highest temperature, from which the published problem has no solution.
    episode = run_episode(env, controller, 2, {"state": {**nominal, "T": 38.2}})
    assert not episode.failure and controller.fallbacks == 0
    assert controller.controller.action_names == ("F_in", "F_1", "F_r", "F_2", "GLC_in", "GLN_in", "T_c")
    # What the culture does not read follows the rules of the nominal policy.
    env.reset(seed=2, options={"state": {**nominal, "T": 38.2}})
    np.testing.assert_allclose(episode.actions[0][7:], env.policy("nominal")[7:], rtol=1e-6)


MISFITS = [
    ({"cost": "yield"}, "cost is 'yield', no reward of Reactor; there are: setpoint"),
    ({"cost": {"c_B": 1}}, r"cost: unknown 'c_B'; Reactor has the states c_A \[kmol/m\^3\], T \[degC\]"),
    ({"cost": {"c_A": -1}}, r"cost\['c_A'\] is -1.0, expected a finite number"),
    ({"cost": {"c_A": 1}, "set_point": {"T": 50}}, "set_point: unknown 'T'"),
    ({"bounds": {"T": (60, 50)}}, r"bounds\['T'\]: the lower bound 60.0 is above the upper bound 50.0"),
    ({"bounds": {"T": 60}}, r"bounds\['T'\] is 60, expected \(low, high\)"),
    ({"bounds": {"x": (0, 1)}}, "unknown 'x'; Reactor has"),
    ({"hard": ["rate"]}, "hard: no bound of 'rate'; there are bounds of: c_A, T, h"),
    ({"actions": ["T"]}, r"actions: unknown 'T'; there are: T_c \[degC\], q_out"),
    ({"rate_limit": {"T": 1}}, r"rate_limit: unknown 'T'; there are: T_c"),
    ({"forecast": {"T_feed": 1}}, "forecast: unknown 'T_feed'"),
    ({"p": {"u": 1}}, "unknown 'u'"),
    ({"p": "plant"}, "p is 'plant', expected values by names of parameters, or 'episode'"),
    ({"part": ["x"]}, "states: unknown 'x'"),
    ({"solver": "snopt"}, "solver is 'snopt'; there are: auto, fatrop, ipopt, sqp"),
    ({"hold": []}, "hold is empty"),
    ({"budget": 0}, "budget is 0, expected seconds above 0"),
    ({"budget": 0.1, "solver": "fatrop"}, "budget is kept by IPOPT alone: give solver='ipopt', or iterations="),
    ({"budget": 0.1, "starts": 2}, "a budget has no time for further starts"),
    ({"starts": -1}, "starts is -1"),
    ({"horizon": 0}, "horizon is 0"),
]


@pytest.mark.parametrize(("arguments", "says"), MISFITS)
def test_what_does_not_fit_is_said(arguments, says):
    with pytest.raises(ValueError, match=says):
        NMPC(smpl.compile("reactor"), **arguments)


def test_other_plants_and_models_are_refused():
    controller = NMPC(smpl.compile("reactor"), 3)
    with pytest.raises(ValueError, match="needs the states c_A, T, h of Reactor, which Beer does not have"):
        run_episode(smpl.Env("beer"), controller, 0)
    with pytest.raises(TypeError, match=r"env_or_model is str, expected an smpl\.Env or an smpl\.Model"):
        NMPC("reactor")
    rewardless = smpl.compile(source=LINEAR.replace("reward r default = -sq(x)\n", ""))
    with pytest.raises(ValueError, match="Linear declares no reward: give cost as weights by names, the states x"):
        NMPC(rewardless)
    restless = smpl.compile(source=LINEAR.replace("steady { u = 0 }\n", ""))
    with pytest.raises(ValueError, match=r"Linear has no steady state: give set_point for x \[1\]"):
        NMPC(restless, 3, {"x": 1})
    with pytest.raises(ValueError, match=r"sets .* at the start of a step, which derivatives cannot predict"):
        NMPC(smpl.compile("mab"), 3, "productivity")


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "casadi", None)
    with pytest.raises(ImportError, match=r"needs CasADi: pip install casadi$"):
        NMPC(smpl.compile("reactor"))


@pytest.mark.parametrize("name", ["four_tanks.eq", "van_de_vusse.eq"])
def test_models_of_a_file_alone_reach_their_set_points(name):
    env = smpl.Env(str(PROBLEMS / name), normalize=False, max_steps=60)
    points = {"y_1": 6.4, "y_2": 6.2} if name == "four_tanks.eq" else {"c_B": 1.05, "T": 112.0}
    controller = NMPC(env, 20, dict.fromkeys(points, 1.0), set_point=points)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        episode = run_episode(env, controller, 0)
    reached = [episode.observations[-1][env.observation_names.index(name)] for name in points]
    np.testing.assert_allclose(reached, list(points.values()), rtol=2e-3)
