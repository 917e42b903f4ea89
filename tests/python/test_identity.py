"""What tells one controller from another: data sets are not continued with another one."""

import functools
import json
import os
import subprocess
import sys
import types

import numpy as np
import pytest

import smpl
from smpl._identity import describe, differences
from smpl.controllers import LQG, LQR, PID, ExtendedKalmanFilter, Function, Loops, Noisy, OpenLoop, SamplingMPC, Uniform

OWN = types.ModuleType("not_installed")
SCALE = 1.0


def call(observation, gain):
    return [gain * observation[0], 0.0]


def reading_a_global(observation):
    return [SCALE * observation[0], 0.0]


class Gains:
    """Gains in a mapping."""

    def __init__(self, gain):
        self.gains = {"f[p]": gain}

    def action(self, env):
        return [self.gains["f[p]"], 0.1]

    def act(self, observation):
        return [self.gains["f[p]"] * observation[0], 0.1]


class Slots:
    __slots__ = ("gain",)

    def __init__(self, gain):
        self.gain = gain

    def action(self, env):
        return [self.gain, 0.1]


class Around:
    def __init__(self, inner):
        self.inner = inner
        self.again = self

    def action(self, env):
        return self.inner.action(env)


def array(gain):
    thing = Around(np.zeros(3000))
    thing.inner[1500] = gain
    return thing


def overwritten(gain):
    thing = Gains(0.0)
    thing.action = lambda env: [gain, 0.1]
    return thing


def by_a_module(gain):
    OWN.gain = gain
    return lambda observation: [OWN.gain * observation[0], 0.0]


def text_of_code(gain):
    space = {}
    exec(f"def act(observation):\n    return [{gain} * observation[0], 0.0]", space)
    return space["act"]


def class_of_code(gain):
    space = {}
    exec(f"class Own:\n    def action(self, env):\n        return [{gain}, 0.1]", space)
    return space["Own"]()


MADE = {
    "mapping": Gains,
    "slots": Slots,
    "single precision": lambda gain: Gains(np.float32(gain)),
    "array": array,
    "nested": lambda gain: Around(Around(Gains(gain))),
    "deep": lambda gain: functools.reduce(lambda inner, _: Around(inner), range(20), Gains(gain)),
    "closure": lambda gain: lambda observation: [gain * observation[0], 0.0],
    "default": lambda gain: lambda observation, g=gain: [g * observation[0], 0.0],
    "partial": lambda gain: functools.partial(call, gain=gain),
    "method": lambda gain: Gains(gain).act,
    "method that was set": overwritten,
    "module": by_a_module,
    "code": text_of_code,
    "class": class_of_code,
    "set": lambda gain: Around({gain, "one", "two", "three"}),
    "loops": lambda gain: Loops(PID("T", "T_c", gain=-gain)),
    "others": lambda gain: Loops(PID("T", "T_c", gain=-1.0), others={"q_out": gain}),
    "noisy": lambda gain: Noisy(PID("T", "T_c", gain=-gain), {"T_c": 0.001}),
    "noise": lambda gain: Noisy(PID("T", "T_c", gain=-1.0), {"T_c": gain}),
    "set-point": lambda gain: PID("T", "T_c", gain=-1.0, set_point=lambda t: 300 * gain),
    "function": lambda gain: Function(lambda state: [gain, 0.1], sees="state"),
    "recorded": lambda gain: OpenLoop([[gain, 0.1]] * 300),
    "random": lambda gain: Uniform(int(10 * gain)),
    "regulator": lambda gain: LQR(reactor(), state_weight={"T": gain}),
    "changed after it was made": lambda gain: scaled(LQR(reactor(), state_weight={"T": 1.0}), gain),
    "filter": lambda gain: LQG(LQR(reactor()), ExtendedKalmanFilter(reactor(), process_noise={"T": gain})),
    "sampling": lambda gain: SamplingMPC(reactor(), 10, deviation={"T_c": gain}),
}


@functools.lru_cache
def reactor():
    return smpl.Env("reactor")


def scaled(regulator, factor):
    regulator.gain = regulator.gain * factor
    return regulator


@pytest.mark.parametrize("kind", MADE)
def test_controllers_with_other_settings_are_told_apart_and_equal_ones_are_not(kind):
    make = MADE[kind]
    first = describe(make(0.1))
    assert describe(make(0.1)) == first
    found = differences(first, describe(make(0.2)))
    assert found and all("there, " in one for one in found)


def test_a_global_that_code_reads_is_part_of_it(monkeypatch):
    before = describe(reading_a_global)
    monkeypatch.setitem(globals(), "SCALE", 2.0)
    assert differences(before, describe(reading_a_global)) == ["SCALE: 1.0 there, 2.0 here"]


def test_whole_numbers_comments_and_the_order_of_keys_do_not_matter():
    assert describe(Gains(1)) == describe(Gains(1.0)) == describe(Gains(np.float64(1.0)))
    assert describe(Around({"a": 1, "b": 2})) == describe(Around({"b": 2, "a": 1}))
    texts = ("def act(observation):\n    return 1", '\n\ndef act(observation):\n    "one"  # says more\n    return 1')
    spaces = [{}, {}]
    for text, space in zip(texts, spaces, strict=True):
        exec(text, space)
    assert describe(spaces[0]["act"]) == describe(spaces[1]["act"])


def test_a_description_is_the_same_in_another_process_with_other_addresses_and_hashes():
    text = (
        "import json, sys; sys.path.insert(0, sys.argv[1]); from test_identity import MADE; "
        "from smpl._identity import describe; "
        "print(json.dumps({kind: describe(make(0.1)) for kind, make in MADE.items()}))"
    )
    folder = str(__file__).rpartition("/")[0]
    found = [
        subprocess.run(
            [sys.executable, "-c", text, folder], env={**os.environ, "PYTHONHASHSEED": seed}, check=True,
            capture_output=True, text=True,
        ).stdout
        for seed in ("1", "2")
    ]  # fmt: skip
    assert json.loads(found[0]) == json.loads(found[1])
    assert "0x" not in found[0]


@pytest.mark.parametrize("kind", ["loops", "noisy", "function", "random", "regulator", "filter", "sampling"])
def test_what_a_controller_has_built_in_an_episode_is_forgotten(kind):
    env, controller = smpl.Env("reactor", normalize=False), MADE[kind](0.1)

    def described():
        env.reset(seed=3)
        controller.reset(env)
        return describe(controller)

    fresh = described()
    env.reset(seed=1)
    controller.reset(env)
    env.step(controller.action(env))
    assert described() == fresh
