"""The native vector environment against single environments and Gymnasium's own vectoriser."""

import gymnasium
import numpy as np
import pytest

import smpl
from smpl.vector import AutoresetMode, parse_autoreset_mode


def make(num_envs=4, mode="next_step", **arguments):
    return gymnasium.make_vec(
        "smpl/Reactor-v0",
        num_envs=num_envs,
        vectorization_mode="vector_entry_point",
        autoreset_mode=mode,
        **arguments,
    )


def actions(generator, num_envs):
    return generator.uniform(-0.2, 0.2, (num_envs, 2))


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("num_envs", [1, 5])
def test_each_sub_environment_is_the_single_one_bit_for_bit(num_envs, threads):
    vector = make(num_envs, num_threads=threads)
    singles = [smpl.Env("reactor") for _ in range(num_envs)]
    observations, _ = vector.reset(seed=11)
    np.testing.assert_array_equal(observations, [env.reset(seed=11 + i)[0] for i, env in enumerate(singles)])
    generator = np.random.default_rng(0)
    running = np.ones(num_envs, dtype=bool)
    for _ in range(60):
        action = actions(generator, num_envs)
        observations, rewards, terminated, truncated, _ = vector.step(action)
        for i in np.flatnonzero(running):
            observation, reward, end, limit, _ = singles[i].step(action[i])
            np.testing.assert_array_equal(observations[i], observation)
            assert (rewards[i], terminated[i], truncated[i]) == (reward, end, limit)
        running &= ~(terminated | truncated)


@pytest.mark.parametrize("mode", ["next_step", "same_step"])
def test_episodes_follow_one_another_as_with_the_vectoriser_of_gymnasium(mode):
    reset_mode = pytest.importorskip("gymnasium.vector", reason="gymnasium").__dict__.get("AutoresetMode")
    if reset_mode is None:
        pytest.skip("this gymnasium has no AutoresetMode")
    native = make(3, mode, max_steps=6)
    reference = gymnasium.vector.SyncVectorEnv(
        [lambda: gymnasium.make("smpl/Reactor-v0", max_steps=6) for _ in range(3)],
        autoreset_mode=parse_autoreset_mode(mode),
    )
    for a, b in zip(native.reset(seed=4), reference.reset(seed=4), strict=True):
        assert_same(a, b)
    generator = np.random.default_rng(1)
    for _ in range(20):
        action = actions(generator, 3).astype(np.float32)
        for a, b in zip(native.step(action), reference.step(action), strict=True):
            assert_same(a, b)


def assert_same(native, reference):
    """Equal up to the values behind a mask that is not set."""
    if not isinstance(native, dict):
        np.testing.assert_array_equal(native, reference)
        return
    assert set(native) == set(reference)
    for key, value in native.items():
        if isinstance(value, dict):
            assert_same(value, reference[key])
        elif key.startswith("_"):
            np.testing.assert_array_equal(value, reference[key])
        else:
            for i in np.flatnonzero(native[f"_{key}"]):
                np.testing.assert_array_equal(value[i], reference[key][i])


def test_the_step_after_the_end_resets_and_ignores_the_action():
    env = make(2, max_steps=3)
    env.reset(seed=0)
    for _ in range(3):
        *_, truncated, _ = env.step(np.zeros((2, 2)))
    assert truncated.all()
    observations, rewards, terminated, truncated, infos = env.step(np.full((2, 2), np.nan))
    assert not rewards.any() and not terminated.any() and not truncated.any()
    assert not infos["time"].any()
    assert "final_obs" not in infos
    assert env.observation_space.contains(observations)


def test_same_step_keeps_the_final_observation_and_info():
    env = make(2, "same_step", max_steps=3, info_state=True)
    single = smpl.Env("reactor", max_steps=3)
    env.reset(seed=0)
    single.reset(seed=0)
    for _ in range(3):
        observations, _, _, truncated, infos = env.step(np.zeros((2, 2)))
        last, *_ = single.step(np.zeros(2))
    assert truncated.all() and infos["_final_obs"].all()
    np.testing.assert_array_equal(infos["final_obs"][0], last)
    np.testing.assert_allclose(infos["final_info"]["time"], [0.3, 0.3])
    np.testing.assert_array_equal(infos["time"], [0.0, 0.0])
    np.testing.assert_array_equal(observations[0], single.reset()[0])


def test_with_autoreset_disabled_the_mask_resets_some_and_returns_all():
    env = make(3, "disabled", max_steps=2)
    env.reset(seed=0)
    env.step(np.zeros((3, 2)))
    before, _, _, truncated, _ = env.step(np.zeros((3, 2)))
    assert truncated.all()
    with pytest.raises(smpl.SimulationError, match="reset"):
        env.step(np.zeros((3, 2)))
    mask = np.array([True, False, True])
    observations, infos = env.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(observations[1], before[1])
    assert not np.array_equal(observations[0], before[0])
    np.testing.assert_array_equal(infos["_time"], mask)


@pytest.mark.parametrize(
    "mask", [np.array([True]), np.array([1, 0, 1]), np.array([False, False, False]), [True, False]]
)
def test_a_wrong_mask_is_refused(mask):
    env = make(3, "disabled")
    env.reset(seed=0)
    with pytest.raises(ValueError, match="reset_mask"):
        env.reset(options={"reset_mask": mask})


def test_options_hold_for_the_episodes_they_were_given_to_and_no_others():
    env = make(2, max_steps=1)
    env.reset(seed=0, options={"state": {"T": 44.0}})
    np.testing.assert_array_equal(env.state[:, 1], [44.0, 44.0])
    env.step(np.zeros((2, 2)))
    env.step(np.zeros((2, 2)))
    assert not np.any(env.state[:, 1] == 44.0)


def test_a_list_of_seeds_gives_each_its_own():
    env = make(2)
    observations, _ = env.reset(seed=[8, 3])
    single = smpl.Env("reactor")
    np.testing.assert_array_equal(observations[1], single.reset(seed=3)[0])
    env.reset(seed=[None, 3])
    np.testing.assert_array_equal(env.state[1], single.state)
    with pytest.raises(ValueError, match="seed"):
        env.reset(seed=[1, 2, 3])


def test_unknown_options_are_listed_with_the_mask():
    with pytest.raises(ValueError, match="reset_mask"):
        make(2).reset(options={"reset_masks": None})


def test_wrong_actions_are_refused_and_nothing_is_stepped():
    env = make(2)
    env.reset(seed=0)
    before = env.state
    with pytest.raises(ValueError, match=r"actions has shape \(2,\), expected \(2, 2\)"):
        env.step(np.zeros(2))
    with pytest.raises(ValueError, match="NaN"):
        env.step(np.array([[0.0, 0.0], [np.nan, 0.0]]))
    np.testing.assert_array_equal(env.state, before)


def test_results_are_fresh_memory():
    env = make(2)
    first = env.reset(seed=0)
    second = env.step(np.zeros((2, 2)))
    third = env.step(np.zeros((2, 2)))
    assert not np.shares_memory(first[0], second[0])
    for a, b in zip(second[:4], third[:4], strict=True):
        assert not np.shares_memory(a, b)
    assert not np.shares_memory(second[4]["cost"], third[4]["cost"])


def test_types_and_shapes_are_those_of_gymnasium():
    env = make(3, info_state=True)
    env.reset(seed=0)
    observations, rewards, terminated, truncated, infos = env.step(env.action_space.sample())
    assert observations.shape == (3, 3) and observations.dtype == np.float32
    assert rewards.dtype == np.float64 and terminated.dtype == truncated.dtype == np.bool_
    assert infos["failure"].dtype == object and infos["failure"].tolist() == [""] * 3
    assert infos["state"].shape == (3, 3)
    assert infos["constraints"]["_state_box"].all()


@pytest.mark.parametrize("mode", ["SAME_STEP", "same_step", "SameStep", "samestep", AutoresetMode.SAME_STEP])
def test_the_autoreset_mode_is_known_in_any_spelling(mode):
    assert make(1, mode).metadata["autoreset_mode"] == AutoresetMode.SAME_STEP


def test_an_unknown_autoreset_mode_is_refused():
    with pytest.raises(ValueError, match="next_step, same_step, disabled"):
        make(1, "never")


def test_the_number_of_steps_can_be_given_under_both_names():
    assert make(1, max_episode_steps=2).reset(seed=0) is not None
    vector = smpl.make_vec("reactor", 2, max_steps=1)
    vector.reset(seed=0)
    assert vector.step(np.zeros((2, 2)))[3].all()


@pytest.mark.parametrize("threads", [1, 2])
def test_a_model_that_observes_nothing_is_reset_and_stepped(threads):
    # x' = u - x from 1 with u = 0: the sum of x over three steps of 0.5 is e^-0.5 + e^-1 + e^-1.5.
    source = """
    time t : 1
    action u = 0 in 0..1
    state x = 1 in 0..2
    eq d/dt x = u - x
    reward r = x
    episode { step = 0.5, max_steps = 3 }
    """
    envs = smpl.VectorEnv(smpl.compile(source=source), 5, num_threads=threads, normalize=False)
    observations, _ = envs.reset(seed=1)
    assert observations.shape == (5, 0)
    total = 0
    for _ in range(3):
        _, rewards, _, truncated, _ = envs.step(np.zeros((5, 1), dtype=np.float32))
        total = total + rewards
    assert truncated.all()
    np.testing.assert_allclose(total, np.exp(-0.5) + np.exp(-1) + np.exp(-1.5), rtol=1e-6)
