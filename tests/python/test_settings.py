"""Settings of a model are simulated or refused: parameters, arrays, ranges, records."""

import re
from pathlib import Path

import numpy as np
import pytest

import smpl
from smpl.controllers import OpenLoop

MODEL = """model Cooler
time t : min
set side = 1..3
param k : 1/min = 0.5 in 0..4
param fault[side] = 0 in 0..1
param gain = 1 ~ uniform(0.5, 1.5)
state T : K = 10 in 0..100
action F : K/min = 1 in 0..2
disturbance w : K/min = 0 ~ normal(0, 1)
eq d/dt T = F + w - k*gain*T*(1 - fault[1])*(1 - fault[2])*(1 - fault[3])
reward r default = -T/1 [K]
observe T
episode { step = 1 [min], max_steps = 5 }
"""
STILL = {"w": 0.0}


def make(**settings):
    return smpl.Env(smpl.compile(source=MODEL, settings={"gain": 1.0, **settings}), normalize=False)


def temperature(env, **parameters):
    """T after 5 steps with F = 1 and without disturbances."""
    env.reset(seed=0, options={"parameters": parameters, "disturbances": STILL})
    for _ in range(5):
        env.step([1.0])
    return env.state[0]


def closed_form(rate):
    """T' = 1 - rate*T from 10, after 5 minutes."""
    return 15.0 if rate == 0 else 1 / rate + (10 - 1 / rate) * np.exp(-5 * rate)


@pytest.mark.parametrize(
    ("setting", "rate"),
    [
        ({}, 0.5),
        ({"fault[2]": 0.5}, 0.25),
        ({"fault": 0.5}, 0.0625),
        ({"fault": [0, 0.5, 0.5]}, 0.125),
        ({"fault": np.array([0.0, 0.0, 1.0])}, 0.0),
        ({"fault": 0.5, "fault[1]": 0}, 0.125),
    ],
)
def test_arrays_of_parameters_are_set_as_wholes_and_by_element(setting, rate):
    assert temperature(make(**setting)) == pytest.approx(closed_form(rate), rel=1e-4)
    assert temperature(make(), **setting) == pytest.approx(closed_form(rate), rel=1e-4)
    model = smpl.compile(source=MODEL)
    given = {"gain": 1.0, **setting}
    assert model.rhs(0.0, [10.0], [1.0], given)[0] == pytest.approx(1 - 10 * rate)


@pytest.mark.parametrize(
    ("settings", "wording"),
    [
        ({"k": 5}, "is outside its bounds"),
        ({"fault[3]": 2}, "is outside its bounds"),
        ({"fault": [0, 1]}, "3 elements"),
        ({"fault[4]": 1}, r"fault\[1\], fault\[2\], fault\[3\]"),
        ({"F": 0.3}, "is an action"),
        ({"rr": 1}, "the model has k, gain, fault"),
        ({"rtol": 1e10}, "`rtol` must be between"),
        ({"rtol": 1e-20}, "`rtol` must be between"),
        ({"max_order": 99}, "from 1 to 5"),
    ],
)
def test_a_setting_that_the_model_cannot_have_is_refused(settings, wording):
    with pytest.raises(smpl.ScenarioError, match=wording):
        smpl.compile(source=MODEL, settings=settings)


@pytest.mark.parametrize(
    "parameters", [{"k": 5.0}, {"k": -1e-3}, {"fault": 2}, {"fault[2]": 1.5}, {"fault": [0, 0, 2]}]
)
def test_ranges_of_parameters_hold_at_resets_and_in_equations(parameters):
    env = make()
    with pytest.raises(ValueError, match="is outside its bounds"):
        env.reset(seed=0, options={"parameters": parameters})
    with pytest.raises(ValueError, match="is outside its bounds"):
        env.model.rhs(0.0, [10.0], [1.0], parameters)


def test_an_element_overrides_its_array_whatever_is_given_first():
    model = smpl.compile(source=MODEL, settings={"gain": 1.0})
    expected = [closed_form(0.5), closed_form(0.25)]
    for given in (
        {"fault[1]": [0.0, 0.5], "fault": [0.5, 0.0, 0.0]},
        {"fault": [0.5, 0.0, 0.0], "fault[1]": [0.0, 0.5]},
    ):
        rollout = model.rollout([[10.0]] * 2, np.ones((5, 1)), parameters=given, disturbances=STILL)
        np.testing.assert_allclose(rollout.states[:, -1, 0], expected, rtol=1e-4)
        assert model.rhs(0.0, [10.0], [1.0], {"fault[1]": 0.5, "fault": 0.0}) == pytest.approx([1 - 10 * 0.25])


@pytest.mark.parametrize("given", [{"k": 5.0}, {"fault[2]": 2.0}, {"fault": [0.0, 0.0, -1.0]}])
def test_one_wording_refuses_values_outside_bounds(given):
    messages = []
    for call in (
        lambda: smpl.compile(source=MODEL, settings=given),
        lambda: make().reset(options={"parameters": given}),
        lambda: make().model.rhs(0.0, [10.0], [1.0], given),
        lambda: make().model.rollout([10.0], np.ones((1, 1)), parameters=given),
    ):
        with pytest.raises(ValueError) as failed:
            call()
        messages.append(re.search(r"`.*` = .* is outside its bounds \S+( 1/min)?", str(failed.value)).group())
    assert len(set(messages)) == 1, messages


@pytest.mark.parametrize("parameters", [{"fault": [0, 1]}, {"fault[4]": 1.0}, {"faults": 1.0}, {"fault": "x"}])
def test_parameters_that_there_are_not_are_refused(parameters):
    with pytest.raises(ValueError):
        make().reset(options={"parameters": parameters})


def test_a_record_that_ends_is_an_error_unless_it_is_to_hold():
    env = make()
    record = {"disturbances": {"w": [0.0, 1.0]}}
    env.reset(seed=0, options=record)
    env.step([1.0])
    env.step([1.0])
    before = env.state
    with pytest.raises(ValueError, match="`w` ends after step 2"):
        env.step([1.0])
    np.testing.assert_array_equal(env.state, before)
    env.reset(seed=0, options={**record, "hold_disturbances": True})
    for _ in range(5):
        env.step([1.0])
    full = make()
    full.reset(seed=0, options={"disturbances": {"w": [0.0, 1.0, 1.0, 1.0, 1.0]}})
    for _ in range(5):
        full.step([1.0])
    np.testing.assert_array_equal(env.state, full.state)
    with pytest.raises(ValueError, match="hold_disturbances"):
        env.reset(options={**record, "hold_disturbances": "yes"})


def test_a_snapshot_keeps_where_a_record_ends():
    env, other = make(), make()
    env.reset(seed=0, options={"disturbances": {"w": [0.0, 1.0]}})
    env.step([1.0])
    other.reset(seed=1)
    other.restore(type(env.snapshot())(env.snapshot().to_bytes()))
    other.step([1.0])
    with pytest.raises(ValueError, match="ends after step 2"):
        other.step([1.0])


def test_recorded_actions_that_end_are_an_error_unless_they_are_to_hold():
    env = make()
    env.reset(seed=0)
    short, held = OpenLoop([[1.0], [2.0]]), OpenLoop([[1.0], [2.0]], hold=True)
    for expected in (1.0, 2.0):
        assert short.action(env) == held.action(env) == expected
        env.step([1.0])
    assert held.action(env) == 2.0
    with pytest.raises(ValueError, match="end after step 2"):
        short.action(env)


def test_a_record_of_a_scenario_says_whether_it_holds(tmp_path):
    model = tmp_path / "cooler.eq"
    model.write_text(MODEL)
    for name, record, ends in (
        ("ends", "[0, 1]", True),
        ("holds", "{values: [0, 1], hold: true}", False),
        ("constant", "1", False),
    ):
        (tmp_path / f"cooler.{name}.yaml").write_text(f"disturbances: {{w: {record}}}\n")
        env = smpl.Env(smpl.compile(model, scenario=name), normalize=False)
        env.reset(seed=0)
        env.step([1.0])
        env.step([1.0])
        if ends:
            with pytest.raises(ValueError, match="ends after step 2"):
                env.step([1.0])
        else:
            env.step([1.0])


def test_an_edited_import_of_any_name_is_compiled_anew(tmp_path):
    model, part = tmp_path / "cooler.eq", tmp_path / "part.txt"
    model.write_text('use "part.txt"\n' + MODEL.replace("= 10 in", "= start in"))
    for start in (20.0, 30.0):
        part.write_text(f"param start : K = {start}\n")
        env = smpl.Env(smpl.compile(model), normalize=False)
        env.reset(seed=0)
        assert env.state[0] == start


def declared(model):
    """Variants and options of choices that the text of a shipped model declares."""
    text = "".join(Path(source).read_text(encoding="utf-8") for source in smpl.compile(model).native.sources)
    switches = re.findall(r"^variant (\w+)", text, re.M)
    choices = re.findall(r"^choice (\w+) *= *([\w| ]+)", text, re.M)
    return [*switches, *(f"{name}={option.strip()}" for name, options in choices for option in options.split("|"))]


@pytest.mark.parametrize("model", ["reactor", "beer", "pensim", "atropine", "mab", "mab_plant"])
def test_every_alternative_that_a_model_declares_has_an_episode(model):
    found = declared(model)
    assert found
    for variant in found:
        env = smpl.Env(model, variants=[variant], normalize=False)
        env.reset(seed=1)
        action = env.policy("nominal") if "nominal" in env.model.policies else env.model.native.defaults("action")
        _, reward, terminated, _, info = env.step(action)
        assert not terminated and np.isfinite(reward), (variant, info["failure"])
