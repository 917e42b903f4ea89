"""Copies and pickles of environments, models and snapshots."""

import copy
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

import smpl
from smpl.wrappers import AroundNominal, SafetyGymnasium

TANK = """model Tank "a tank that drains"
time t : min
param  A : m^2       = 0.5
param  k : m^2.5/min = 0.1
action q : m^3/min   = 0.1 in 0..0.3
state  h : m         = 1 in 0..2
eq d/dt h = (q - k*sqrt(h)) / A
initial h ~ uniform(0.5, 1.5)
observe h noise normal(0, 0.1)
reward level default = -sq((h - 1 [m]) / 1 [m])
episode { step = 1 [min], max_steps = 50, error_reward = -100 }
"""
WAYS = {"pickle": lambda env: pickle.loads(pickle.dumps(env)), "deepcopy": copy.deepcopy}


def follow(env, steps=5):
    """Bits of some steps around the nominal action and of the first observation of the next episode."""
    base = env.unwrapped
    nominal = base.model.native.defaults("action")
    results = []
    for k in range(steps):
        change = 1 + 0.01 * np.sin(k + np.arange(len(nominal)))
        observation, reward, terminated, truncated, info = env.step(base.from_physical(nominal * change))
        results.append((observation.tobytes(), reward, terminated, truncated, info["time"], info["failure"]))
        if terminated or truncated:
            break
    return [*results, env.reset()[0].tobytes()]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ["Reactor", "Beer", "PenSim", "Atropine", "MAb", "MAbPlant"])
def test_a_copy_goes_on_bit_for_bit(name, way):
    env = gymnasium.make(f"smpl/{name}-v0", observation="online")
    env.reset(seed=3)
    nominal = env.unwrapped.from_physical(env.unwrapped.model.native.defaults("action"))
    for _ in range(2):
        env.step(nominal)
    other = WAYS[way](env)
    before = other.unwrapped.state
    assert follow(env) == follow(other)
    again = WAYS[way](env)
    np.testing.assert_array_equal(env.unwrapped.state, again.unwrapped.state)
    assert not np.array_equal(before, env.unwrapped.state), "the original moved"


@pytest.mark.parametrize("way", WAYS)
def test_a_copy_does_not_move_with_the_original(way):
    env = smpl.Env("reactor", render_mode="ansi")
    env.reset(seed=1)
    env.step(np.zeros(2))
    other = WAYS[way](env)
    state, text = other.state, other.render()
    env.step(np.ones(2))
    np.testing.assert_array_equal(other.state, state)
    assert other.render() == text != env.render()
    assert other.steps == 1 and env.steps == 2


@pytest.mark.parametrize("way", WAYS)
def test_options_seeds_and_spaces_are_copied(way):
    env = smpl.Env(
        "reactor", normalize=False, dense_reward=False, max_steps=7, info_state=True, reward="setpoint_change"
    )
    env.reset(seed=5)
    env.action_space.seed(2)
    other = WAYS[way](env)
    assert (other.max_steps, other.normalize, other.model.reward) == (7, False, "setpoint_change")
    for _ in range(7):
        action = env.action_space.sample()
        np.testing.assert_array_equal(other.action_space.sample(), action)
        ours, theirs = env.step(action), other.step(action)
        assert ours[1:4] == theirs[1:4]
        np.testing.assert_array_equal(ours[4]["state"], theirs[4]["state"])
    # Without a seed an environment draws one from Gymnasium's generator, which is copied too.
    fresh = smpl.Env("reactor")
    fresh.np_random  # noqa: B018 - makes the generator
    np.testing.assert_array_equal(WAYS[way](fresh).reset()[0], fresh.reset()[0])


@pytest.mark.parametrize("way", WAYS)
def test_wrapped_environments_are_copied(way):
    for wrap in (AroundNominal, SafetyGymnasium):
        env = wrap(smpl.Env("reactor"))
        env.reset(seed=4)
        other = WAYS[way](env)
        for ours, theirs in zip(env.step(np.full(2, 0.1)), other.step(np.full(2, 0.1)), strict=True):
            np.testing.assert_equal(ours, theirs)


@pytest.mark.parametrize("mode", ["next_step", "same_step"])
@pytest.mark.parametrize("way", WAYS)
def test_vector_environments_go_on_across_the_ends_of_episodes(way, mode):
    env = smpl.VectorEnv(smpl.compile(source=TANK), num_envs=3, max_steps=4, autoreset_mode=mode, num_threads=2)
    env.reset(seed=7)
    generator = np.random.default_rng(1)
    other = WAYS[way](env)
    for step in range(12):
        if step in (3, 4, 7):
            other = WAYS[way](env)
        actions = generator.uniform(-1.0, 1.0, (3, 1)).astype(np.float32)
        np.testing.assert_equal(other.step(actions), env.step(actions))


def test_a_vector_environment_that_has_not_begun_is_copied():
    env = smpl.VectorEnv("reactor", num_envs=2)
    np.testing.assert_array_equal(copy.deepcopy(env).reset(seed=3)[0], env.reset(seed=3)[0])


def test_an_environment_that_has_not_begun_or_is_over_is_copied():
    env = smpl.Env("reactor", max_steps=1)
    other = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(env.reset(seed=1)[0], other.reset(seed=1)[0])
    env.step(np.zeros(2))
    with pytest.raises(smpl.SimulationError, match="reset"):
        copy.deepcopy(env).step(np.zeros(2))


def test_a_copy_shares_the_compiled_model():
    env = smpl.Env(smpl.compile(source=TANK))
    assert copy.deepcopy(env).model is env.model
    assert copy.deepcopy(env.model) is env.model is copy.copy(env.model)


def test_another_process_goes_on_with_the_same_bits(tmp_path):
    env = smpl.Env(smpl.compile(source=TANK))
    env.reset(seed=2)
    env.step([0.5])
    (tmp_path / "env.pickle").write_bytes(pickle.dumps(env))
    code = (
        "import pickle, sys; env = pickle.loads(open(sys.argv[1], 'rb').read())\n"
        "print([(o.tobytes().hex(), r) for o, r, *_ in (env.step([x]) for x in (0.1, -0.3, 0.7))])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "env.pickle"], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == str(
        [(o.tobytes().hex(), r) for o, r, *_ in (env.step([x]) for x in (0.1, -0.3, 0.7))]
    )


def test_a_pickle_of_an_edited_model_is_refused(tmp_path):
    path = tmp_path / "tank.eq"
    path.write_text(TANK)
    env = smpl.Env(path)
    env.reset(seed=0)
    data, snapshot = pickle.dumps(env), pickle.dumps(env.snapshot())
    path.write_text(TANK.replace("= 0.5", "= 0.25"))
    with pytest.raises(ValueError, match=r"the snapshot is of Tank \[[0-9a-f]{8}\], the environment of Tank"):
        pickle.loads(data)
    with pytest.raises(ValueError, match="the snapshot is of Tank"):
        smpl.Env(path).restore(pickle.loads(snapshot))


def test_snapshots_travel_as_bytes():
    env = smpl.Env("reactor")
    env.reset(seed=9)
    env.step(np.zeros(2))
    snapshot = env.snapshot()
    data = pickle.dumps(snapshot)
    assert copy.deepcopy(snapshot) is snapshot
    first = follow(env)
    other = smpl.Env("reactor", max_steps=30)
    other.restore(pickle.loads(data))
    assert follow(other)[:-1] == first[:-1]


def test_damaged_snapshots_are_refused():
    env = smpl.Env("reactor")
    env.reset(seed=9)
    kind, data = type(env.snapshot()), env.snapshot().to_bytes()
    for damaged in (b"", b"x" * 100, data[:20], data[: len(data) // 2]):
        with pytest.raises(ValueError, match="not a snapshot"):
            kind(damaged)


def test_a_snapshot_with_any_bit_changed_is_refused():
    env = smpl.Env("reactor", max_steps=5)
    env.reset(seed=9)
    env.step(np.zeros(2))
    kind, data = type(env.snapshot()), env.snapshot().to_bytes()
    for bit in range(8 * len(data)):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        with pytest.raises(ValueError, match="not a snapshot"):
            kind(bytes(damaged))
