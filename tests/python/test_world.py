"""The plant's world: variants of the shipped models in which more than the actions changes."""

import re

import numpy as np
import pytest

import smpl
from conftest import ROOT

VARIANTS = {
    "reactor": (
        "feed_disturbances",
        "fouling",
        "sticking_valve",
        "sensor_bias",
        "setpoint_schedule",
        "setpoint_random",
    ),
    "beer": ("cooling_disturbances", "sensor_bias", "weak_yeast"),
    "pensim": ("fouling", "sensor_bias"),
    "atropine": ("feed_disturbances", "sensor_bias"),
    "mab": ("feed_disturbances", "fouling", "sticking_valve"),
    "mab_plant": ("feed_disturbances", "fouling", "sticking_valve"),
}
CASES = [(model, variant) for model, variants in VARIANTS.items() for variant in variants]


def begun(model, *variants, seed=5, **options):
    env = smpl.Env(model, variants=variants, normalize=False)
    env.reset(seed=seed, options=options or None)
    return env


def steps(env, count):
    action = env.model.native.defaults("action")
    return [env.step(action) for _ in range(count)]


@pytest.mark.parametrize(("model", "variant"), CASES)
def test_the_start_is_that_of_the_model_without_the_variant(model, variant):
    plain, other = begun(model), begun(model, variant)
    np.testing.assert_array_equal(plain.state, other.state)


@pytest.mark.parametrize("model", VARIANTS)
def test_all_variants_together_are_episodes_that_their_seed_decides(model):
    variants = [name for name in VARIANTS[model] if name != "setpoint_schedule"]
    one, two, other = begun(model, *variants), begun(model, *variants), begun(model, *variants, seed=6)
    runs = [steps(env, 3) for env in (one, two, other)]
    np.testing.assert_array_equal(runs[0][-1][0], runs[1][-1][0])
    drawn = [env._native.values("disturbance") for env in (one, other)]
    assert (drawn[0] != drawn[1]).any()


def test_each_disturbance_has_random_numbers_of_its_own():
    alone, together = begun("reactor", "feed_disturbances"), begun("reactor", "feed_disturbances", "sensor_bias")
    steps(alone, 4), steps(together, 4)
    for name in ("T_f_shift", "c_Af_shift"):
        one, two = (
            env._native.values("disturbance")[env.model.disturbance_names.index(name)] for env in (alone, together)
        )
        assert one == two != 0


def test_a_warmer_feed_is_a_parameter_of_the_plain_model():
    shifted = begun("reactor", "feed_disturbances", start="nominal", disturbances={"T_f_shift": 2.0, "c_Af_shift": 0.0})
    plain = begun("reactor", start="nominal", parameters={"T_f": 78.85}, state=shifted.state)
    steps(shifted, 5), steps(plain, 5)
    np.testing.assert_allclose(shifted.state, plain.state, rtol=1e-9)


def test_fouling_is_a_lower_heat_transfer():
    fouled = begun("reactor", "fouling", start="nominal", disturbances={"fouled": 0.02})
    plain = begun("reactor", start="nominal", parameters={"U": 0.98 * 54.94}, state=fouled.state)
    steps(fouled, 5), steps(plain, 5)
    np.testing.assert_allclose(fouled.state, plain.state, rtol=1e-9)
    grown = begun("reactor", "fouling")
    steps(grown, 50)
    # Fifty steps of 0.0015 times a draw between 0.5 and 1.5.
    assert 0.0375 < grown._native.values("disturbance")[0] < 0.1125


def test_a_sticking_valve_follows_large_changes_alone():
    env = begun("reactor", "sticking_valve", start="nominal")
    place = env.discrete_names.index("q_valve")
    for flow, position in ((0.104, 0.1), (0.107, 0.107), (0.103, 0.107), (0.15, 0.15)):
        env.step([26.85, flow])
        assert env.discrete[place] == pytest.approx(position)


def test_a_sensor_is_biased_and_the_state_is_not():
    env, plain = begun("reactor", "sensor_bias"), begun("reactor")
    gaps = []
    for _ in range(40):
        steps(env, 1), steps(plain, 1)
        np.testing.assert_array_equal(env.state, plain.state)
        gaps.append(env.reading[1:3] - env.state[1:3])
    gaps = np.array(gaps)
    assert np.ptp(gaps[:, 1]) < 1e-12 and 0 < abs(gaps[0, 1]) < 0.05
    assert np.ptp(gaps[:, 0]) > 0.01


def test_set_points_change_by_the_schedule_and_by_the_options():
    env = begun("reactor", "setpoint_schedule", start="nominal")
    places = [env.observation_names.index(name) for name in ("T_sp", "h_sp")]
    seen, rewards = [], []
    for _ in range(70):
        _, reward, *_ = env.step([26.85, 0.1])
        seen.append(env.reading[places])
        rewards.append(reward)
    seen = np.array(seen)
    for first, last, expected in ((0, 30, [51.34660837, 0.659]), (30, 60, [48, 0.6]), (60, 70, [53, 0.7])):
        np.testing.assert_allclose(seen[first:last], np.tile(expected, (last - first, 1)))
    # The plant rests at 51.3466 degC and 0.659 m.
    assert rewards[40] == pytest.approx(-((3.3466 / 5) ** 2) - (0.059 / 0.05) ** 2, abs=1e-3)
    env = begun("reactor", "setpoint_schedule", start="nominal", disturbances={"T_sp": [50.0] * 5, "h_sp": 0.65})
    steps(env, 5)
    np.testing.assert_allclose(env.reading[places], [50.0, 0.65])


def test_random_set_points_differ_from_seed_to_seed_and_hold_in_between():
    def sequence(seed):
        env = begun("reactor", "setpoint_random", seed=seed)
        place = env.observation_names.index("h_sp")
        return np.array([(steps(env, 1), env.reading[place])[1] for _ in range(60)])

    one, other = sequence(1), sequence(2)
    assert set(np.flatnonzero(np.diff(one))) == {24, 49}
    assert ((one >= 0.55) & (one <= 0.75)).all()
    assert (one != other).any()


def test_disturbances_have_a_seed_apart_from_that_of_the_start():
    def run(seed, disturbance_seed=None):
        options = {} if disturbance_seed is None else {"disturbance_seed": disturbance_seed}
        env = begun("reactor", "feed_disturbances", seed=seed, **options)
        start = env.state
        drawn = [(steps(env, 1), env._native.values("disturbance"))[1] for _ in range(4)]
        return start, np.array(drawn)

    start, drawn = run(3)
    same_start, other = run(3, 8)
    other_start, same = run(4, 8)
    np.testing.assert_array_equal(start, same_start)
    assert (start != other_start).any()
    assert (drawn != other).any()
    np.testing.assert_array_equal(other, same)
    np.testing.assert_array_equal(drawn, run(3, 3)[1])
    np.testing.assert_array_equal(run(4)[1], run(3, 4)[1])


@pytest.mark.parametrize("seed", [-1, 1.5, True, 2**64, "1"])
def test_a_disturbance_seed_is_an_integer(seed):
    with pytest.raises(ValueError, match="disturbance_seed"):
        begun("reactor", disturbance_seed=seed)


def test_a_batch_has_the_disturbances_of_the_given_seed_too():
    one = begun("reactor", "feed_disturbances", seed=3, disturbance_seed=8)
    many = smpl.make_vec("reactor", 2, variants=["feed_disturbances"], normalize=False)
    many.reset(seed=3, options={"disturbance_seed": 8})
    action = one.model.native.defaults("action")
    for _ in range(3):
        single, batch = one.step(action), many.step(np.stack([action, action]))
    np.testing.assert_array_equal(single[0], batch[0][0])


def test_the_examples_of_the_page_run(monkeypatch):
    text = (ROOT / "docs" / "scenarios.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```$", text, re.S | re.M)
    scope = {}
    for block in blocks:
        exec(compile(block, "scenarios.md", "exec"), scope)
    assert len(blocks) >= 2
    env = scope["env"]
    env.reset(seed=0, options={"start": "nominal"})
    rewards = [env.step(env.from_physical([26.85, 0.1]))[1] for _ in range(60)]
    assert rewards[40] == pytest.approx(0.0, abs=1e-6)
    assert rewards[-1] == pytest.approx(-0.041, abs=1e-4)
