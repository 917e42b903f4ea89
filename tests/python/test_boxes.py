"""Observed arrays and boxes of arrays: element `k` of each model is `k t`, so that every number is known."""

import numpy as np
import pytest

import smpl

TEXT = """
time t : s
action u = 0 in 0..1
{declarations}
eq d/dt x[k] = {rate} for {binder}
{statements}
reward one default = 1
episode {{ step = 1 [s], max_steps = 50, error_reward = -1 }}
"""

#: Over a set, over a range of integers that stays a loop, over the cells of a domain (whose centres are 1 m, 2 m, ...).
ARRAYS = {
    "set": (
        "set s = {a, b, c, d}\ntable number[s] = { a: 1, b: 2, c: 3, d: 4 }",
        "number[k] * 1 [Pa/s]",
        "k in s",
        list("abcd"),
    ),
    "range": ("", "k * 1 [Pa/s]", "k in 1..30", [str(k) for k in range(1, 31)]),
    "cells": ("domain k in 0.5 [m]..12.5 [m] cells 12", "k * 1 [Pa/m/s]", "k", [str(k) for k in range(1, 13)]),
}


def model(tmp_path, kind, statements, bounds="0..1000"):
    """The path of a model of that kind, and the labels of its elements."""
    declarations, rate, binder, labels = ARRAYS[kind]
    declarations += f"\nstate x[{binder}] : Pa = 0 in {bounds}"
    path = tmp_path / "model.eq"
    path.write_text(
        TEXT.format(
            declarations=declarations, rate=rate, binder=binder, statements=statements.replace("BINDER", binder)
        )
    )
    return path, labels


def first_observation(env):
    env.reset(seed=0)
    return env.step(np.zeros(1))[0]


def steps_until_failure(env):
    """Number of steps of an episode, and the reason of its end."""
    env.reset(seed=0)
    for step in range(1, 51):
        *_, terminated, truncated, info = env.step(np.zeros(1))
        if terminated or truncated:
            return step, info.get("failure", "")
    raise AssertionError("no end")


@pytest.mark.parametrize("kind", ARRAYS)
@pytest.mark.parametrize(
    ("statement", "scale"), [("observe p : kPa = x in 0..3", 1e-3), ("observe p = x in 0..3000", 1)]
)
def test_a_whole_array_is_observed_under_the_name_in_the_unit_and_with_the_bounds_that_are_said(
    tmp_path, kind, statement, scale
):
    path, labels = model(tmp_path, kind, statement)
    env = smpl.Env(path, normalize=False)
    observed = first_observation(env)
    assert list(env.observation_names) == [f"p[{label}]" for label in labels]
    np.testing.assert_allclose(observed, scale * np.arange(1, len(labels) + 1), rtol=1e-6)
    np.testing.assert_allclose(env.observation_space.high, 3000 * scale, rtol=1e-6)


@pytest.mark.parametrize("kind", ARRAYS)
def test_a_named_expression_over_an_index_is_observed(tmp_path, kind):
    path, labels = model(tmp_path, kind, "let w[BINDER] = 2*x[k]\nobserve w in 0..6000")
    env = smpl.Env(path, normalize=False)
    observed = first_observation(env)
    assert list(env.observation_names) == [f"w[{label}]" for label in labels]
    np.testing.assert_allclose(observed, 2.0 * np.arange(1, len(labels) + 1), rtol=1e-6)


@pytest.mark.parametrize("kind", ARRAYS)
@pytest.mark.parametrize(
    "observed",
    [
        "observe x",
        "observe x in 0..61",
        "observe p : kPa = x in 0..0.061",
        "let w[BINDER] = 2*x[k]\nobserve w in 0..122",
        "observe states",
    ],
)
def test_the_box_of_the_observations_has_the_elements_of_arrays(tmp_path, kind, observed):
    path, labels = model(tmp_path, kind, observed + "\nfail out when outside bounds(observations)", "0..61")
    step, failure = steps_until_failure(smpl.Env(path))
    assert step == 61 // len(labels) + 1
    outside = labels[61 // step :]
    assert all(f"[{label}] = " in failure for label in outside[:8])
    assert failure.count("is above") == min(len(outside), 8)


@pytest.mark.parametrize("kind", ARRAYS)
@pytest.mark.parametrize(
    "condition",
    [
        "outside bounds(x)",
        "outside bounds(states)",
        "not inside bounds(x)",
        "any(outside bounds(x[k]) for BINDER)",
        "not all(inside bounds(x[k]) for BINDER)",
    ],
)
def test_any_element_of_an_array_leaves_the_box(tmp_path, kind, condition):
    path, labels = model(tmp_path, kind, f"observe x\nfail out when {condition}", "0..61")
    step, _ = steps_until_failure(smpl.Env(path))
    assert step == 61 // len(labels) + 1


@pytest.mark.parametrize(
    "condition", ["outside bounds(x)", "any(outside bounds(x[k]) for BINDER)", "any(x[k] > high(x[k]) for BINDER)"]
)
def test_bounds_that_differ_from_element_to_element(tmp_path, condition):
    # Element k leaves 0..7 k (31 - k) after 7 (31 - k): the last one first, after 7.
    path, _ = model(tmp_path, "range", f"observe x\nfail out when {condition}", "0..7*k*(31 - k)")
    step, failure = steps_until_failure(smpl.Env(path))
    assert step == 8
    assert condition.startswith("any") or "x[30] = 240 Pa is above 210" in failure


def test_bounds_are_the_wrong_way_round_in_one_element(tmp_path):
    path, _ = model(tmp_path, "range", "observe x", "0..29.5 - k")
    with pytest.raises(smpl.CompileError, match="the bounds of `x` are the wrong way round"):
        smpl.Env(path)


def test_violations_are_relative_to_the_range_of_each_element(tmp_path):
    path, _ = model(tmp_path, "range", "observe x\nconstraint c when outside bounds(x)", "0..7*k*(31 - k)")
    env = smpl.Env(path)
    env.reset(seed=0)
    for step in range(1, 21):
        *_, info = env.step(np.zeros(1))
        excess = max(step / (7 * (31 - k)) - 1 for k in range(1, 31))
        assert info["constraints"]["c"] == pytest.approx(max(excess, 0), abs=1e-6)


def test_a_message_names_the_first_of_many(tmp_path):
    path, _ = model(tmp_path, "range", "observe x\nfail out when outside bounds(x)", "0..0.5")
    _, failure = steps_until_failure(smpl.Env(path))
    assert failure.count("is above") == 8
    assert failure.endswith("and 22 more")


def test_draws_are_clipped_to_the_bounds_of_each_element(tmp_path):
    text = "observe x\ninitial x[k] ~ uniform(-1000 [Pa], 1000 [Pa]) clip bounds for BINDER"
    path, labels = model(tmp_path, "range", text, "0..10*k")
    env = smpl.Env(path, normalize=False)
    starts = np.array([env.reset(seed=seed)[0] for seed in range(20)])
    high = 10.0 * np.arange(1, len(labels) + 1)
    assert (starts >= 0).all()
    assert (starts <= high).all()
    assert ((starts == 0) | (starts == high)).mean() > 0.7
    assert (starts[:, -1] == 300).any()


def test_a_condition_on_each_cell_of_a_large_domain_names_none_of_them():
    conditions = [
        "any(outside bounds(x[z]) for z)",
        "not all(inside bounds(x[z]) for z)",
        "any(x[z] > high(x[z]) for z)",
    ]
    lines = [f"constraint c{i} when {condition}" for i, condition in enumerate(conditions)]
    text = "time t : s\ndomain z in 0 [m]..1 [m] cells 600000\nstate x[z] = 0 in 0..10\neq d/dt x[z] = 1 [1/s] for z\n"
    model = smpl.compile(
        source=text + "observe y = x[z.first] in 0..10\n" + "\n".join(lines) + "\nepisode { step = 1 [s] }\n"
    )
    assert len(model.state_names) == 600_000


@pytest.mark.parametrize(("unit", "start", "factor"), [("K", 300, 1), ("degC", 20, 1), ("degF", 68, 1.8)])
@pytest.mark.parametrize(("noise", "own"), [("0.5", 1), ("0.5 [K]", None), ("sd", None)])
def test_noise_of_a_temperature_is_a_difference(unit, start, factor, noise, own):
    text = f"""
time t : s
param sd : K = 0.5
state T : {unit} = {start} in 0..1000
eq d/dt T = 0
observe T noise normal(0, {noise})
episode {{ step = 1 [s], max_steps = 5000 }}
"""
    env = smpl.Env(smpl.compile(source=text), normalize=False)
    env.reset(seed=0)
    observed = np.array([env.step([])[0][0] for _ in range(4000)])
    np.testing.assert_allclose(observed.std(), 0.5 * (own or factor), rtol=0.04)
    np.testing.assert_allclose(observed.mean(), start, atol=0.05)
