"""Controllers are compared by what made them: class, constructor arguments, names and versions."""

import dataclasses
import enum
import functools
import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from gymnasium.utils import RecordConstructorArgs

import smpl
from smpl.controllers import (
    LQG,
    LQR,
    PID,
    Constant,
    ExtendedKalmanFilter,
    Function,
    Loops,
    Noisy,
    Nominal,
    OpenLoop,
    Proportional,
    Recorded,
    SamplingMPC,
    Uniform,
)
from smpl.controllers.identity import AnonymousError, differences, identity
from smpl.learning.formulation import Exploration, Formulation


def law(observation, gain=1.0):
    return [gain * observation[0], 0.0]


class Plain:
    """A class without constructor arguments."""

    def action(self, env):
        return [26.85, 0.1]


class Gains(Recorded):
    def __init__(self, gain, *more, scale=1.0, **others):
        self.gain = gain


class Twice(Gains):
    def __init__(self, gain):
        super().__init__(2 * gain)


@dataclasses.dataclass
class Law:
    gain: float
    built: list = dataclasses.field(default_factory=list, init=False)


class OfGymnasium(RecordConstructorArgs):
    def __init__(self, gain):
        RecordConstructorArgs.__init__(self, gain=gain)


class Kind(enum.Enum):
    FIRST = 0.1
    SECOND = 0.2


@functools.lru_cache
def reactor():
    return smpl.Env("reactor")


MADE = {
    "arguments": Gains,
    "positional arguments": lambda gain: Gains(1.0, gain),
    "keyword arguments": lambda gain: Gains(1.0, other=gain),
    "defaults": lambda gain: Gains(1.0) if gain == 0.1 else Gains(1.0, scale=2.0),
    "arguments of a subclass": Twice,
    "data class": Law,
    "gymnasium": OfGymnasium,
    "partial": lambda gain: functools.partial(law, gain=gain),
    "method": lambda gain: Gains(gain).__init__,
    "single precision": lambda gain: Gains(np.float32(gain)),
    "precision": lambda gain: Gains(np.float32(1) if gain == 0.1 else 1.0),
    "array": lambda gain: Gains(np.full(3000, gain)),
    "long text": lambda gain: Gains("x" * 300 + str(gain)),
    "path": lambda gain: Gains(Path(str(gain))),
    "enumeration": lambda gain: Gains(Kind(gain)),
    "set": lambda gain: Gains({gain, "one", "two", "three"}),
    "function": lambda gain: Gains(law if gain == 0.1 else np.tanh),
    "class": lambda gain: Gains(Law if gain == 0.1 else Plain),
    "environment": lambda gain: Gains(smpl.Env("reactor", settings={"spread": gain})),
    "model": lambda gain: Gains(smpl.compile(source=TANK.replace("GAIN", str(gain)))),
    "constant": lambda gain: Constant([gain, 0.1]),
    "recorded": lambda gain: OpenLoop([[gain, 0.1]] * 300),
    "random": lambda gain: Uniform(int(10 * gain)),
    "proportional": Proportional,
    "loops": lambda gain: Loops(PID("T", "T_c", gain=-gain)),
    "others": lambda gain: Loops(PID("T", "T_c", gain=-1.0), others={"q_out": gain}),
    "noisy": lambda gain: Noisy(PID("T", "T_c", gain=-gain), {"T_c": 0.001}),
    "noise": lambda gain: Noisy(PID("T", "T_c", gain=-1.0), {"T_c": gain}),
    "state": lambda gain: Function(functools.partial(law, gain=gain)),
    "regulator": lambda gain: LQR(reactor(), state_weight={"T": gain}),
    "filter": lambda gain: LQG(LQR(reactor()), ExtendedKalmanFilter(reactor(), process_noise={"T": gain})),
    "sampling": lambda gain: SamplingMPC(reactor(), 10, deviation={"T_c": gain}),
    "formulation": lambda gain: Exploration(Formulation(centre="nominal", reach=gain), 0.5),
}
TANK = (
    "model Tank\ntime t : h\nparam k : 1/h = GAIN in 0..1\naction q : m/h = 0 in 0..1\nstate h : m = 1 in 0..5\n"
    "eq d/dt h = q - k*h\nobserve h\nreward r default = h / 1 [m]\nepisode { step = 0.5 [h], max_steps = 3 }\n"
)


@pytest.mark.parametrize("kind", MADE)
def test_other_arguments_are_another_identity_and_equal_ones_the_same(kind):
    make = MADE[kind]
    first = identity(make(0.1))
    assert identity(make(0.1)) == first
    assert identity(pickle.loads(pickle.dumps(make(0.1)))) == first
    found = differences(first, identity(make(0.2)))
    assert found and all("there, " in one for one in found)


def test_an_argument_may_be_given_by_place_or_by_name():
    assert identity(SamplingMPC(reactor(), 10)) == identity(SamplingMPC(model=reactor().model, horizon=10))
    assert identity(Gains(1.0)) == identity(Gains(np.float64(1.0), scale=1.0))
    assert identity(Gains({"a": 1, "b": 2})) == identity(Gains({"b": 2, "a": 1}))


def test_the_arguments_are_those_of_the_class_that_was_called():
    assert identity(Twice(0.5)) == {"": "class test_identity.Twice", ".gain": "0.5"}


def test_differences_name_the_argument():
    one, other = identity(Loops(PID("T", "T_c", gain=-1.0))), identity(Loops(PID("T", "T_c", gain=-2.0)))
    assert differences(one, other) == ["loops[0].gain: -1.0 there, -2.0 here"]


def test_a_function_is_its_qualified_name_and_version(monkeypatch):
    assert identity(law) == {"": "function test_identity.law"}
    monkeypatch.setattr(law, "version", 2, raising=False)
    assert identity(law) == {"": "function test_identity.law version 2"}
    assert identity(Plain()) == {"": "class test_identity.Plain"}
    monkeypatch.setattr(Plain, "version", "b", raising=False)
    assert identity(Plain()) == {"": "class test_identity.Plain version b"}


def closure(gain):
    def inner(observation):
        return [gain, 0.0]

    return inner


class Opaque:
    def __init__(self, gain):
        self.gain = gain


def ring():
    one = []
    one.append(one)
    return Gains(one)


@pytest.mark.parametrize(
    ("thing", "says"),
    [
        (lambda observation: [0.0, 0.0], "the controller is the anonymous function <lambda>: define it at the top"),
        (closure(0.1), "the controller is the anonymous function closure.<locals>.inner"),
        (functools.partial(lambda o, gain: [gain, 0.0], gain=1.0), "the controller is the anonymous function <lambda>"),
        (Function(lambda state: [0.0, 0.0]), "function is the anonymous function <lambda>"),
        (PID("T", "T_c", gain=-1.0, set_point=lambda t: 300.0), "set_point is the anonymous function <lambda>"),
        (Noisy(Opaque(1.0), {}), r"the constructor arguments of controller \(test_identity.Opaque\) are unknown"),
        (Opaque(1.0), r"the constructor arguments of Opaque .* or give smpl.learning.Agent\(name, controller, version"),
        (ring(), "arguments that are nested too deeply"),
    ],
)
def test_what_cannot_be_compared_is_refused_with_the_way_out(thing, says):
    with pytest.raises(AnonymousError, match=says):
        identity(thing)


def test_arguments_that_cannot_be_compared_do_not_keep_a_controller_from_other_processes():
    again = pickle.loads(pickle.dumps(Gains(Opaque(1.0))))
    assert again.gain.gain == 1.0
    for one in (again, pickle.loads(pickle.dumps(again))):
        with pytest.raises(AnonymousError, match="constructor arguments of gain"):
            identity(one)


def test_an_identity_is_the_same_in_another_process():
    text = (
        "import json, sys; sys.path.insert(0, sys.argv[1]); from test_identity import MADE; "
        "from smpl.controllers.identity import identity; "
        "print(json.dumps({kind: identity(make(0.1)) for kind, make in MADE.items()}))"
    )
    folder = str(Path(__file__).parent)
    found = [
        subprocess.run(
            [sys.executable, "-c", text, folder], env={**os.environ, "PYTHONHASHSEED": seed}, check=True,
            capture_output=True, text=True,
        ).stdout
        for seed in ("1", "2")
    ]  # fmt: skip
    assert json.loads(found[0]) == json.loads(found[1])
    assert " at 0x" not in found[0]


@pytest.mark.parametrize("kind", ["loops", "noisy", "random", "regulator", "filter", "sampling"])
def test_what_a_controller_does_in_an_episode_does_not_change_its_identity(kind):
    env, controller = smpl.Env("reactor", normalize=False), MADE[kind](0.1)
    before = identity(controller)
    env.reset(seed=1)
    controller.reset(env)
    env.step(controller.action(env))
    assert identity(controller) == before == identity(MADE[kind](0.1))


def test_the_nominal_policy_needs_no_arguments():
    assert identity(Nominal()) == {"": "class smpl.controllers.base.Nominal"}
