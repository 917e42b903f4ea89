"""Representations of objects, and answers to wrong uses."""

import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

import smpl
from smpl.controllers import LQR, NMPC, PID, Constant, ExtendedKalmanFilter, Loops, Nominal, Uniform
from smpl.learning.formulation import Formulation


@pytest.fixture(scope="module")
def reactor():
    return smpl.compile("reactor", scenario="legacy")


def test_controllers_show_the_arguments_that_they_were_made_with(reactor):
    loop = PID("T", "T_c", 1.0, derivative_time=0.1, set_point=52.0)
    assert repr(loop) == "PID('T', 'T_c', 1.0, derivative_time=0.1, set_point=52.0)"
    assert (
        repr(Loops(PID("T", "T_c", 1.0), others={"q_out": 0.1})) == "Loops(PID('T', 'T_c', 1.0), others={'q_out': 0.1})"
    )
    assert repr(Constant([26.0, 0.1])) == "Constant([26.0, 0.1])"
    assert repr(Uniform(seed=3)) == "Uniform(seed=3)"
    assert repr(LQR(reactor)) == f"LQR({reactor!r})"


def test_long_arguments_are_cut_off():
    assert len(repr(Constant(list(range(1000))))) < 80


def test_what_is_shown_does_not_change_what_a_controller_is(reactor):
    from smpl.controllers.identity import identity

    assert identity(PID("T", "T_c", 1.0)) == identity(PID(measurement="T", action="T_c", gain=1.0))
    assert repr(pickle.loads(pickle.dumps(Constant([1.0])))) == "Constant([1.0])"


def test_models_and_environments_show_what_they_were_made_with(reactor):
    assert repr(reactor) == "<smpl.Model Reactor: 3 states, 2 actions, scenario='legacy'>"
    assert repr(smpl.compile("reactor")) == "<smpl.Model Reactor: 3 states, 2 actions>"
    assert repr(smpl.compile("reactor", settings={"U": 55.0})).endswith(", settings={'U': '55.0'}>")
    env = smpl.Env(reactor, normalize=False)
    assert repr(env) == f"<smpl.Env Reactor: level 'default', reward {reactor.reward!r}, normalize=False>"


def test_a_step_without_an_episode_needs_a_reset(reactor):
    env = smpl.Env(reactor, max_steps=1)
    for _ in range(2):
        with pytest.raises(gymnasium.error.ResetNeeded, match="call reset first") as found:
            env.step(np.zeros(2))
        assert isinstance(found.value, smpl.SimulationError)
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step([0.0, 0.0])
        env.reset(seed=0)
        env.step(np.zeros(2))
    batch = smpl.VectorEnv(reactor, 2, autoreset_mode="disabled", max_steps=1)
    batch.reset(seed=0)
    batch.step(np.zeros((2, 2)))
    with pytest.raises(gymnasium.error.ResetNeeded):
        batch.step(np.zeros((2, 2)))


def test_unknown_keywords_are_answered_by_a_list():
    with pytest.raises(
        TypeError, match="PID has no argument 'Kp'; give gain; there are: measurement, action, gain, integral_time"
    ):
        PID("T", "T_c", Kp=1.0)


@pytest.mark.parametrize(
    "call, message",
    [
        (lambda env: env.dt, r"'Env' object has no attribute 'dt'; use model.sampling_interval$"),
        (
            lambda env: env.model.actions_low,
            r"no attribute 'actions_low'; did you mean 'action_low'\?$",
        ),
        (lambda env: env.model.zzz, r"'Model' object has no attribute 'zzz'$"),
        (lambda env: smpl.RandomPolicy, r"no attribute 'RandomPolicy'; use controllers.Uniform$"),
        (lambda env: smpl.controllers.RandomPolicy, r"no attribute 'RandomPolicy'; use Uniform$"),
        (lambda env: ExtendedKalmanFilter(env).P, r"no attribute 'P'; use covariance$"),
        (
            lambda env: ExtendedKalmanFilter(env, P_w=1),
            r"no argument 'P_w'; give process_noise",
        ),
        (
            lambda env: smpl.Env(env.model, max_episode_steps=5),
            r"Env has no argument .*; give max_steps; there",
        ),
        (lambda env: smpl.evaluation.evaluate(env, Nominal(), n_eval_episodes=5), r"evaluate has no .*; give episodes"),
        (lambda env: env.model.rollout([0, 0, 0], [[0, 0]], params={}), r"rollout has no argument 'params'; give"),
        (lambda env: Formulation.of({"residual_of": "pid"}), r"formulation: unknown 'residual_of'; give centre; there"),
    ],
)
def test_names_of_other_packages_are_answered_by_the_right_ones(reactor, call, message):
    env = smpl.Env(reactor)
    with pytest.raises((AttributeError, TypeError, ValueError), match=message):
        call(env)


def test_parts_of_the_package_are_loaded_at_their_first_use():
    code = "import smpl; smpl.policies.as_policy, smpl.learning.save_policy, smpl.wrappers.AroundNominal, smpl.analysis"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_an_error_inside_a_property_is_reported_itself():
    class Broken(smpl.Env):
        @property
        def half(self):
            return self.model.nothing_like_this

    with pytest.raises(AttributeError, match="nothing_like_this"):
        Broken("reactor").half  # noqa: B018


def test_the_names_of_do_mpc_are_answered_by_the_right_ones(reactor):
    pytest.importorskip("casadi", reason="CasADi is not installed")
    with pytest.raises(TypeError, match="NMPC has no argument 'n_horizon'; do-mpc's n_horizon is horizon; there"):
        NMPC(reactor, n_horizon=20)
    controller = NMPC(reactor, 5)
    with pytest.raises(AttributeError, match=r"do-mpc's make_step is action\(env\)"):
        controller.make_step(np.zeros(3))
    with pytest.raises(AttributeError, match="do-mpc's set_rterm is the argument rate_weight"):
        controller.set_rterm(T_c=1.0)
    with pytest.raises(AttributeError, match=r"'NMPC' object has no attribute 'other'$"):
        controller.other  # noqa: B018
