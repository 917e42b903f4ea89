"""Arguments that cannot be right, controllers that have not begun, causes of failures, and a second thread."""

import pickle
import threading

import numpy as np
import pytest

import smpl
from smpl import controllers
from smpl.controllers import LQG, LQR, NMPC, PID, Cascade, ExtendedKalmanFilter, Loops, MovingHorizonEstimator
from smpl.controllers.identity import identity

TANK = """model Tank
time t : min
param A : m^2 = 1 in 0.5..2
action q : m^3/min = 0.5 in 0..1
action v : m^3/min = 0 in -1..1
state h : m = 1 in 0..5
eq d/dt h = (q - v - 0.5 [m^2/min]*h)/A
observe h, minus : m = -h in -10..10
reward r = h/1[m]
episode { step = 0.5 [min], max_steps = 50, error_reward = 0 }
"""


@pytest.fixture(scope="module")
def tank():
    return smpl.compile(source=TANK)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: PID("h", "q", 1.0, low=5, high=1), "low is 5 and high 1, expected low below high"),
        (lambda: PID("h", "q", 1.0, low=float("nan")), "low is nan"),
        (lambda: PID("h", "q", 1.0, tracking_time=0), "tracking_time is 0, expected a positive number"),
        (lambda: PID("h", "q", 1.0, tracking_time=-1), "tracking_time is -1, expected a positive number"),
        (lambda: Loops(PID("h", "q", 1.0), others={"q": 0.3}), "others holds q, which a loop chooses"),
        (lambda: Loops(PID("h", "q", 1.0), others={"v": float("nan")}), r"others\['v'\] is nan, expected a finite"),
        (lambda: Cascade(PID("h", "minus", 1.0), PID("minus", "q", 1.0), every=0), "every is 0, expected a positive"),
    ],
)
def test_loops_that_cannot_be_are_refused(make, says):
    with pytest.raises(ValueError, match=says):
        make()


def test_limits_outside_of_the_box_of_an_action_are_refused(tank):
    env = smpl.Env(tank, normalize=False)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="low is 2 and high 1 of q"):
        PID("h", "q", 1.0, low=2.0, set_point=1).reset(env)


@pytest.mark.parametrize(
    ("measurement", "action", "sign"), [("h", "q", 1), ("h", "v", -1), ("minus", "q", -1), ("minus", "v", 1)]
)
def test_a_gain_of_the_wrong_sign_warns(tank, measurement, action, sign, recwarn):
    """d h / d q = 2 min/m2 at rest: h = q/(0.5 m2/min)."""
    env = smpl.Env(tank, normalize=False)
    env.reset(seed=0)
    PID(measurement, action, 0.3 * sign, 5.0, set_point=1.0 if measurement == "h" else -1.0).reset(env)
    assert not [one for one in recwarn if "wrong sign" in str(one.message)]
    loop = PID(measurement, action, -0.3 * sign, 5.0, set_point=1.0 if measurement == "h" else -1.0)
    with pytest.warns(UserWarning, match=r"has the wrong sign: .*\(-?2 m/\("):
        loop.reset(env)
    loop.reset(env)  # once is enough
    assert len([one for one in recwarn if "wrong sign" in str(one.message)]) <= 1


def test_the_sign_of_the_gain_of_an_unstable_process_is_left_open(recwarn):
    """Proportional control of gain 3 stabilises h' = q + h/2, whose slow gain, -2, is negative."""
    source = TANK.replace("- 0.5 [m^2/min]*h", "+ 0.5 [m^2/min]*h")
    env = smpl.Env(smpl.compile(source=source), normalize=False)
    env.reset(seed=0)
    PID("h", "q", 3.0, set_point=1.0).reset(env)
    assert not [one for one in recwarn if "wrong sign" in str(one.message)]


def test_regulators_and_values_that_cannot_be_are_refused(tank):
    with pytest.raises(ValueError, match="integral has 'h' more than once"):
        LQR(tank, integral=["h", "h"])
    y, u = tank.steady_state([0.5, 0.0]), [0.5, 0.0]
    with pytest.raises(ValueError, match=r"`A` = 7 is outside its bounds 0\.5\.\.2"):
        tank.linearize(y, u, {"A": 7.0})
    reactor = smpl.compile("reactor", variants=["sticking_valve"])
    with pytest.raises(ValueError, match=r"p: `q_valve` = 9 is outside its bounds 0.05..0.2"):
        reactor.linearize([0.8, 50.0, 0.6], [26.85, 0.1], {"q_valve": 9.0})


@pytest.mark.parametrize("kind", ["PID", "Loops", "Cascade", "LQR", "LQG", "NMPC", "SamplingMPC", "Uniform", "Noisy"])
def test_an_action_before_a_reset_is_refused_by_every_controller(tank, kind):
    if kind == "NMPC":
        pytest.importorskip("casadi")
    env = smpl.Env(tank, normalize=False)
    env.reset(seed=0)
    loop = PID("h", "q", 0.3, set_point=1.0)
    made = {
        "PID": lambda: loop,
        "Loops": lambda: Loops(loop),
        "Cascade": lambda: Cascade(PID("h", "minus", -1.0, set_point=1.0), PID("minus", "q", -0.3)),
        "LQR": lambda: LQR(tank, at=(tank.steady_state([0.5, 0.0]), [0.5, 0.0])),
        "LQG": lambda: LQG(LQR(tank, at=(tank.steady_state([0.5, 0.0]), [0.5, 0.0])), ExtendedKalmanFilter(tank)),
        "NMPC": lambda: NMPC(tank, horizon=3),
        "SamplingMPC": lambda: controllers.SamplingMPC(tank, horizon=3),
        "Uniform": controllers.Uniform,
        "Noisy": lambda: controllers.Noisy(loop, {"q": 0.1}),
    }[kind]()
    with pytest.raises(smpl.SimulationError, match=f"{kind}.action comes before {kind}.reset"):
        made.action(env)


def test_a_reset_does_not_change_the_identity_of_a_controller(tank):
    env = smpl.Env(tank, normalize=False)
    env.reset(seed=0)
    fresh = controllers.Uniform(3)
    before = identity(fresh)
    fresh.reset(env)
    fresh.action(env)
    assert identity(fresh) == before
    again = pickle.loads(pickle.dumps(fresh))
    assert again.action(env).shape == (2,) and identity(again) == before


@pytest.mark.parametrize("estimator", [ExtendedKalmanFilter, MovingHorizonEstimator])
def test_an_update_before_a_reset_is_refused(tank, estimator):
    env = smpl.Env(tank, normalize=False)
    env.reset(seed=0)
    with pytest.raises(smpl.SimulationError, match=r"update comes before .*reset"):
        estimator(tank).update(env)


# ---- Causes of failures ----

CAUSES = """model Causes
time t : h
action u = 0 in -1..1
state x = 1 in -10..10
eq d/dt x = (if u > 3 then sqrt(-1 - x*x) else u)/1[h]
observe x
reward r = x
fail startup when x > 1.4
fail solver_trouble when x > 1.3
episode { step = 1 [h], max_steps = 10 }
"""


def test_a_step_whose_integration_fails_raises_whatever_else_is_violated():
    model = smpl.compile(source=CAUSES)
    with pytest.raises(smpl.SimulationError, match="solver"):
        model.step([1.0], [4.0])  # outside of the action's box too
    with pytest.raises(smpl.SimulationError, match="point 1: "):
        model.step([[1.0], [1.0]], [[0.1], [4.0]])


def test_a_step_that_ends_is_returned_whatever_its_failures_are_called():
    model = smpl.compile(source=CAUSES)
    np.testing.assert_allclose(model.step([1.0], [0.5]), [1.5], rtol=1e-6)
    np.testing.assert_allclose(model.step([1.0], [2.0]), [3.0], rtol=1e-6)  # outside of the action's box


def test_an_estimator_goes_on_where_a_failure_is_called_startup():
    source = CAUSES.replace("x = 1 in", "x = 1.2 in").replace("observe x", "observe x noise normal(0, 0.1)")
    model = smpl.compile(source=source)
    env = smpl.Env(model, normalize=False)
    for kind in (ExtendedKalmanFilter, MovingHorizonEstimator):
        estimator = kind(model, deviation={"x": 0.5})
        env.reset(seed=0)
        estimator.reset(env)
        estimator.update(env)
        env.step([0.15])
        assert np.isfinite(estimator.update(env)).all()


# ---- Threads ----


@pytest.mark.parametrize("kind", ["environment", "vector environment"])
def test_a_second_thread_in_an_environment_gets_a_clear_error(kind):
    env = smpl.Env("mab_plant", normalize=False) if kind == "environment" else smpl.VectorEnv("mab_plant", 4)
    env.reset(seed=0)
    action = env.action_space.sample()
    errors, stop = [], threading.Event()

    def step():
        while not stop.is_set():
            try:
                env.reset(seed=0)
                env.step(action)
            except RuntimeError as error:
                errors.append(error)
                stop.set()

    threads = [threading.Thread(target=step) for _ in range(3)]
    timer = threading.Timer(60, stop.set)
    for one in (*threads, timer):
        one.start()
    for one in threads:
        one.join()
    timer.cancel()
    assert errors
    assert {str(one) for one in errors} == {
        f"another thread uses this {kind} at the moment; create one for each thread"
    }
    assert all(isinstance(one, smpl.SimulationError) for one in errors)
