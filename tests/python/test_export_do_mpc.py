"""Models of do-mpc made from exported ones simulate as the environment does."""

import numpy as np
import pytest

import smpl

pytest.importorskip("casadi", reason="casadi is not installed")
do_mpc = pytest.importorskip("do_mpc", reason="do-mpc is not installed")


def simulator(made, step):
    made = do_mpc.simulator.Simulator(made)
    made.settings.t_step = step
    made.settings.abstol = made.settings.reltol = 1e-10
    return made


def test_a_step_of_do_mpc_is_a_step_of_the_environment():
    env = smpl.Env("reactor", normalize=False)
    env.reset(seed=1)
    made = simulator(smpl.export.do_mpc(env.model), env.model.step)
    made.setup()
    made.x0 = env.state[:, None]
    for action in (env.steady_action, env.steady_action * 1.02, env.steady_action * 0.98):
        env.step(action)
        found = made.make_step(np.asarray(action)[:, None])
        np.testing.assert_allclose(np.ravel(found), env.state, rtol=1e-6)


def test_parameters_and_expressions_have_the_names_of_the_model():
    model = smpl.compile("reactor")
    made = smpl.export.do_mpc(model, parameters=["k_0"], varying=["T_f"])
    assert set(made.x.keys()) == set(model.state_names)
    assert set(made.u.keys()) - {"default"} == set(model.action_names)
    assert "k_0" in made.p.keys()  # noqa: SIM118, a structure of CasADi
    assert "T_f" in made.tvp.keys()  # noqa: SIM118
    assert {f"obs_{name}" for name in model.observation_names} <= set(made.aux.keys())


def test_unknown_names_and_models_of_another_form_are_refused():
    with pytest.raises(ValueError, match="parameters: unknown 'k0'"):
        smpl.export.do_mpc(smpl.compile("reactor"), parameters=["k0"])
    source = """
model Implicit "two rates in one equation"
time t : s
action u : 1 = 0 in 0..1
state x : 1 = 1 in 0..10
state y : 1 = 1 in 0..10
eq d/dt x + d/dt y = -x / 1 [s]
eq d/dt x - d/dt y = u / 1 [s]
observe x
reward r default = -x
episode { step = 1 [s], max_steps = 5 }
"""
    model = smpl.compile(source=source)
    if model.explicit:
        pytest.skip("the compiler solves it for its rates")
    with pytest.raises(ValueError, match="not explicit in its rates"):
        smpl.export.do_mpc(model)
