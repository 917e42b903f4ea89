"""Invalid arguments are refused with the name of the argument and the expected value."""

import gymnasium
import numpy as np
import pytest

import smpl
from smpl import controllers, datasets
from smpl.evaluation import evaluate
from smpl.wrappers import SafetyGymnasium

NOMINAL = np.array([26.85, 0.1])
Y, U = [0.878, 324.5, 0.659], [26.85, 0.1]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"settings": [1]}, r"settings is \[1\], expected a mapping"),
        ({"settings": {1: 2}}, "settings has the key 1, expected names"),
        ({"settings": {"U": {}}}, r"settings\['U'\] is \{\}, expected a number"),
        ({"settings": {"U": [[1.0]]}}, r"settings\['U'\] is \[\[1.0\]\], expected a number"),
        ({"settings": {"U": ["a"]}}, r"settings\['U'\] is \['a'\], expected numbers"),
        ({"variants": 3}, "variants is 3, expected names"),
        ({"variants": [3]}, r"variants is \[3\], expected names"),
        ({"scenario": 3}, "scenario is 3, expected a name or a path"),
        ({"normalize": 3}, "normalize is 3, expected True or False"),
        ({"dense_reward": "yes"}, "dense_reward is 'yes', expected True or False"),
        ({"info_state": None}, "info_state is None, expected True or False"),
    ],
)
def test_a_wrong_argument_of_an_environment_is_named(arguments, says):
    for make in (smpl.Env, smpl.VectorEnv):
        with pytest.raises(ValueError, match=f"^{says}"):
            make("reactor", **arguments)


def test_a_model_that_is_no_path_is_refused():
    with pytest.raises(ValueError, match=r"^path is 3, expected a name or a path"):
        smpl.Env(3)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda m: m.rhs("a", Y, U), "t is 'a', expected a number"),
        (lambda m: m.rhs(None, Y, U), "t is None, expected a number"),
        (lambda m: m.rhs(0.0, Y, U, p=3), "p is 3, expected a mapping"),
        (lambda m: m.rhs(0.0, Y, U, p=["U"]), r"p is \['U'\], expected a mapping"),
        (lambda m: m.rhs(0.0, Y, U, p={1: 2.0}), "p has the key 1, expected names"),
        (lambda m: m.rhs(0.0, Y, U, p={"U": "50"}), r"p\['U'\] is '50', expected a number"),
        (lambda m: m.residual("a", Y, Y, U), "t is 'a', expected a number"),
        (lambda m: m.jacobian(0.0, Y, Y, U, "c"), "cj is 'c', expected a number"),
        (lambda m: m.steady_state(U, fixed=[0.7]), r"fixed is \[0.7\], expected a mapping"),
        (lambda m: m.steady_state(U, guess=[0.7]), r"guess is \[0.7\], expected a mapping"),
        (lambda m: m.steady_state(U, guess={"nope": 1.0}), "guess: unknown 'nope'; there are: c_A, T, h"),
    ],
)
def test_a_wrong_argument_of_a_model_is_named(reactor_model, call, says):
    with pytest.raises(ValueError, match=f"^{says}"):
        call(reactor_model)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -float("inf")])
@pytest.mark.parametrize(
    ("call", "names"),
    [
        (lambda m, x: m.steady_state([26.85, x]), r"u\[1\] is"),
        (lambda m, x: m.steady_state(U, {"U": x}), r"p\['U'\] is"),
        (lambda m, x: m.steady_state(U, fixed={"h": x}), r"fixed\['h'\] is"),
        (lambda m, x: m.steady_state(U, guess={"T": x}), r"guess\['T'\] is"),
        (lambda m, x: m.linearize([0.878, x, 0.659], U), r"y\[1\] is"),
        (lambda m, x: m.linearize(Y, [x, 0.1]), r"u\[0\] is"),
        (lambda m, x: m.linearize(Y, U, {"U": x}), r"p\['U'\] is"),
        (lambda m, x: m.linearize_step([0.878, x, 0.659], U), r"x\[1\] is"),
        (lambda m, x: m.linearize_step(Y, [x, 0.1]), r"u\[0\] is"),
        (lambda m, x: m.linearize_step(Y, U, {"U": x}), r"p\['U'\] has a value that is not finite"),
        (lambda m, x: m.step(Y, U, {"U": [50.0, x]}), r"p\['U'\] has a value that is not finite"),
        (lambda m, x: m.rhs(0.0, Y, [x, 0.1]), r"u\[0\] is"),
        (lambda m, x: m.rhs(x, Y, U), "t is"),
        (lambda m, x: m.residual(0.0, Y, Y, U, {"U": x}), r"p\['U'\] is"),
        (lambda m, x: m.jacobian(0.0, Y, Y, U, x), "cj is"),
    ],
)
def test_what_is_not_finite_is_named(reactor_model, call, names, bad):
    with pytest.raises(ValueError, match=f"^{names}"):
        call(reactor_model, bad)


def test_a_point_that_a_solver_tries_may_be_none(reactor_model):
    assert np.isnan(reactor_model.rhs(0.0, [np.nan, 324.5, 0.659], U)).any()


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda m, n: m.rollout(Y, [U, U], first_step=n), "first_step"),
        (lambda m, n: m.rollout(Y, [U, U], threads=n), "threads"),
        (lambda m, n: m.step(Y, U, first_step=n), "first_step"),
        (lambda m, n: m.linearize_step(Y, U, first_step=n), "first_step"),
        (lambda m, n: m.linearize_step(Y, U, threads=n), "threads"),
        (lambda m, n: m.gradient(Y, [U, U], first_step=n), "first_step"),
        (lambda m, n: smpl.Env(m, max_steps=n), "max_steps"),
        (lambda m, n: smpl.VectorEnv(m, 2, max_steps=n), "max_steps"),
        (lambda m, n: smpl.VectorEnv(m, n), "num_envs"),
        (lambda m, n: smpl.VectorEnv(m, 2, num_threads=n), "num_threads"),
    ],
)
def test_integers_beyond_what_is_counted_are_named(reactor_model, call, says):
    for number in (2**32, 10**20, -1, 1.5, "7", True):
        with pytest.raises(ValueError, match=rf"^{says} is {number!r}, expected "):
            call(reactor_model, number)


def test_no_step_is_counted_beyond_32_bits(reactor_model):
    with pytest.raises(ValueError, match=r"^first_step is 4294967295, expected .* below 4294967294"):
        reactor_model.rollout(Y, [U, U], first_step=2**32 - 1)


@pytest.mark.parametrize(
    "action",
    [
        ["26.85", "0.1"],
        [26.85, "0.1"],
        np.array(["26.85", "0.1"]),
        np.array([26.85, "0.1"], dtype=object),
        [b"26.85", b"0.1"],
        np.array([1, 2], dtype="datetime64[s]"),
        np.array([26.85 + 0j, 0.1]),
        np.ma.array([26.85, 0.1], mask=[True, False]),
    ],
)
def test_texts_and_masked_values_are_no_actions(reactor, action):
    reactor.reset(seed=0)
    with pytest.raises(ValueError, match=r"(?s)^action is .*expected numbers of shape \(2,\)"):
        reactor.step(action)
    assert reactor.steps == 0
    vector = smpl.VectorEnv("reactor", 1)
    vector.reset(seed=0)
    with pytest.raises(ValueError, match=r"(?s)^actions is .*expected numbers of shape \(1, 2\)"):
        vector.step(action[None] if isinstance(action, np.ndarray) else [action])


def test_arrays_without_a_masked_value_and_of_any_number_are_actions():
    env = smpl.Env("reactor", normalize=False)
    plain = env.reset(seed=0), env.step(NOMINAL)
    masked = np.ma.array(NOMINAL), np.ma.array(NOMINAL, mask=[False, False])
    for action in (*masked, NOMINAL.astype(object), tuple(NOMINAL)):
        again = env.reset(seed=0), env.step(action)
        np.testing.assert_array_equal(plain[1][0], again[1][0])
    env.reset(seed=0)
    env.step(np.array([26, 0]))


def test_a_wrong_argument_of_an_evaluation_is_named():
    env, controller = smpl.Env("reactor", max_steps=2), controllers.Nominal()
    for seed in ("a", None, -1, 1.5):
        with pytest.raises(ValueError, match=rf"^seed is {seed!r}, expected an integer"):
            evaluate(env, controller, 1, seed=seed)
    with pytest.raises(ValueError, match=r"^starts is 3, expected states"):
        evaluate(env, controller, starts=3)
    with pytest.raises(TypeError, match=r"^env is SafetyGymnasium, .*env.env"):
        evaluate(SafetyGymnasium(env), controller, 1)
    with pytest.raises(TypeError, match=r"^env is CartPoleEnv, expected an environment of smpl"):
        evaluate(gymnasium.make("CartPole-v1"), controller, 1)


@pytest.mark.parametrize("layout", [datasets.transitions, datasets.legacy_rows, datasets.d3rlpy_arrays])
def test_no_episodes_are_no_data_set(layout):
    with pytest.raises(ValueError, match=r"^episodes is empty, expected one at least"):
        layout([])


UNUSED = (
    "model M\ntime t : s\nparam k = 1\nparam idle = 2\nstate x = 5 in 0..1\neq d/dt x = -k*x/1 [s]\nobserve x in 0..1\n"
)


def test_what_a_scenario_is_refused_for_is_said_without_warnings_of_the_model():
    with pytest.raises(smpl.ScenarioError) as caught:
        smpl.compile(source=UNUSED, settings={"nope": 1})
    assert "nope" in str(caught.value) and len(str(caught.value).splitlines()) == 1, caught.value


def test_observations_are_clipped_and_states_are_not():
    env = smpl.Env(smpl.compile(source=UNUSED), normalize=False)
    observation, _ = env.reset(seed=0)
    assert observation[0] == 1.0 and env.unwrapped.state[0] == 5.0


def test_in_the_first_step_no_steps_are_completed():
    text = (
        "model M\ntime t : s\nstate x = 0\neq d/dt x = 1 [1/s]\nobserve x\nreward r default = n\n"
        "episode { step = 1 [s], max_steps = 3 }"
    )
    env = smpl.Env(smpl.compile(source=text))
    env.reset(seed=0)
    assert [env.step([])[1] for _ in range(3)] == [0.0, 1.0, 2.0]


# x' = x - x^3 rests at -1, 0 and 1, and z + z^3 = x.
THREE = """model M
time t : s
state x = 0.9 in -3..3
var z = 0
eq z + z^3 = x
eq d/dt x = (x - x^3)/1 [s]
observe x
"""


@pytest.mark.parametrize(("guess", "rest"), [(None, 1.0), ({}, 1.0), ({"x": -2.0}, -1.0), ({"x": 0.01, "z": 0.0}, 0.0)])
def test_a_guess_tells_which_steady_state(guess, rest):
    x, z = smpl.compile(source=THREE).steady_state([], guess=guess)
    assert abs(x - rest) < 1e-9 and abs(z + z**3 - x) < 1e-9


def test_a_guess_of_an_algebraic_variable_tells_which_of_its_values():
    # z^3 = z has the roots -1, 0 and 1 whatever x is.
    text = "model M\ntime t : s\nstate x = 1\nvar z = 0.9\neq z^3 = z\neq d/dt x = (2 - x)/1 [s]\nobserve x\n"
    model = smpl.compile(source=text)
    for guess, root in [(0.9, 1.0), (-0.9, -1.0), (0.1, 0.0)]:
        np.testing.assert_allclose(model.steady_state([], guess={"z": guess}), [2.0, root], atol=1e-9)


def test_after_a_failed_step_time_is_that_of_the_state():
    # The pole of x' = u x^2 is at 1/u.
    text = (
        "model M\ntime t : 1\naction u = 0.1 in 0..10\nstate x = 1\neq d/dt x = u*x^2\nobserve x\n"
        "episode { step = 1, max_steps = 9 }"
    )
    env = smpl.Env(smpl.compile(source=text), normalize=False)
    for action in (5.0, np.inf):
        env.reset(seed=0)
        env.step([0.1])
        info = env.step([action])[-1]
        assert info["failure"] and info["time"] == env.time == 1.0
        assert abs(env.state[0] - 1 / 0.9) < 1e-5
    vector = smpl.VectorEnv(env.model, 1, normalize=False, autoreset_mode="disabled")
    vector.reset(seed=0)
    vector.step([[0.1]])
    assert vector.step([[5.0]])[-1]["time"][0] == 1.0
