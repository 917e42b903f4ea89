"""What tells one controller from another: data sets are not continued with another one."""

import functools
import json
import os
import pickle
import re
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


def class_of(text):
    space = {}
    exec(text, space)
    return space["Own"]


def counting(gain):
    yield gain


def begun(gain):
    env = smpl.Env("reactor")
    env.reset(options={"parameters": {"spread": gain}})
    return env


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
    "whole number": lambda gain: Gains(1 if gain == 0.1 else 1.0),
    "order": lambda gain: Around({"a": 1, "b": 2} if gain == 0.1 else {"b": 2, "a": 1}),
    "pattern": lambda gain: Around(re.compile(str(gain))),
    "values": lambda gain: Around({"a": gain}.values()),
    "bytes": lambda gain: Around(memoryview(str(gain).encode())),
    "generator": lambda gain: Around(counting(gain)),
    "text of a class": lambda gain: Around(
        class_of(f"class Own(str):\n    def law(self):\n        return {gain}")("a")
    ),
    "set of a class": lambda gain: Around(class_of(f"class Own(set):\n    def law(self):\n        return {gain}")([1])),
    "function of arrays": lambda gain: Around(np.frompyfunc(lambda x: gain * x, 1, 1)),
    "metaclass": lambda gain: class_of(
        f"class Meta(type):\n    law = {gain}\nclass Own(metaclass=Meta):\n    def action(self, env): return [0, 0]"
    )(),
    "wrapped": lambda gain: functools.wraps(np.clip)(lambda observation: [gain, 0.1]),
    "deepest": lambda gain: functools.reduce(lambda inner, _: [inner], range(5000), gain),
    "except": lambda gain: class_of(
        "class Own:\n    def action(self, env):\n        try:\n            y = g()\n"
        + (
            "        except ValueError:\n            y = 1\n        else:\n            h()\n"
            if gain == 0.1
            else "            h()\n        except ValueError:\n            y = 1\n"
        )
        + "        return [y, 0.1]"
    )(),
    "matrix": lambda gain: Around(np.asmatrix(np.eye(3)) if gain == 0.1 else np.eye(3)),
    "masked": lambda gain: Around(np.ma.array(np.ones(9), mask=np.arange(9) < 10 * gain)),
    "environment": lambda gain: Around(begun(gain)),
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


def test_comments_docstrings_and_the_order_of_attributes_do_not_matter():
    assert describe(Gains(1.0)) == describe(Gains(np.float64(1.0)))
    texts = (
        "def act(observation):\n    def inner():\n        return 1\n    return inner()",
        '\n\ndef act(observation):\n    "one"  # says more\n    def inner():\n        "two"\n        return 1\n'
        "    return inner()",
    )
    spaces = [{}, {}]
    for text, space in zip(texts, spaces, strict=True):
        exec(text, space)
    assert describe(spaces[0]["act"]) == describe(spaces[1]["act"])
    shared = [0.1, 0.2]
    assert describe(Around((shared, shared))) == describe(Around(([0.1, 0.2], [0.1, 0.2])))


def test_names_of_attributes_are_no_globals(monkeypatch):
    class Own:
        def __init__(self):
            self.SCALE = 1.0

        def action(self, env):
            return [self.SCALE, 0.1]

    before = describe(Own())
    monkeypatch.setitem(globals(), "SCALE", 2.0)
    assert describe(Own()) == before


def test_objects_that_refer_to_one_another_are_described():
    def ring(gain):
        one, other = Gains(gain), Gains(gain)
        one.others, other.others = {other}, {one: 1, "more": other}
        return one

    assert describe(ring(0.1)) == describe(ring(0.1)) != describe(ring(0.2))


@pytest.mark.parametrize("imported", ["import own_package.gains", "from own_package import gains", "inside"])
def test_values_and_code_of_ones_own_modules_count(imported, tmp_path, monkeypatch):
    package = tmp_path / "own_package"
    package.mkdir()
    (package / "__init__.py").write_text("")
    monkeypatch.syspath_prepend(str(tmp_path))
    inside = "        from own_package.gains import K, law\n        return [law(K), 0.1]"
    read = "own_package.gains" if imported.startswith("import") else "gains"
    outside = f"        return [{read}.law({read}.K), 0.1]"
    body = inside if imported == "inside" else outside
    text = f"{'' if imported == 'inside' else imported}\nclass Own:\n    def action(self, env):\n{body}\n"
    found = []
    for k, law in ((0.1, "x + 1"), (0.2, "x + 1"), (0.1, "x - 1"), (0.1, "x + 1")):
        for name in [name for name in sys.modules if name.startswith("own_package")]:
            del sys.modules[name]
        sys.dont_write_bytecode = True
        (package / "gains.py").write_text(f"K = {k}\ndef law(x):\n    return {law}\n")
        space = {}
        exec(text, space)
        found.append(describe(space["Own"]()))
    assert found[0] == found[3] and found[0] != found[1] and found[0] != found[2]


def test_what_is_set_on_a_controller_after_it_was_made_counts():
    class Own(SamplingMPC):
        bias = 0.0

        def shift(self, by):
            self.moved = by

    def made(change):
        controller = Own(reactor(), 10)
        change(controller)
        return describe(controller)

    plain = made(lambda one: None)
    assert plain == made(lambda one: None)
    for change in (
        lambda one: setattr(one, "bias", 0.5),
        lambda one: one.shift(0.5),
        lambda one: setattr(one, "action", lambda env: [1.0, 0.1]),
        lambda one: setattr(one, "horizon", 5),
    ):
        assert made(change) != plain
    assert describe(SamplingMPC(reactor(), 10)) == describe(SamplingMPC(model=reactor().model, horizon=10))


def test_arguments_are_described_as_they_are_now():
    weights = {"T": 1.0}
    controller = SamplingMPC(reactor(), 10, deviation=weights)
    before = describe(controller)
    weights["T"] = 2.0
    assert describe(controller) != before
    assert describe(pickle.loads(pickle.dumps(controller))) == describe(controller)


@pytest.mark.parametrize("package", ["torch", "stable_baselines3"])
def test_networks_are_told_apart_by_what_they_learned_and_by_their_code(package):
    pytest.importorskip(package)
    torch = pytest.importorskip("torch")

    class Scaled(torch.nn.Module):
        def __init__(self, factor):
            super().__init__()
            self.factor = factor

        def forward(self, x):
            return self.factor * x

    def network(seed=0, factor=1.0):
        torch.manual_seed(seed)
        made = torch.nn.Sequential(torch.nn.Linear(3, 2), torch.nn.Dropout(), Scaled(factor))
        return made.eval()

    def learned(seed=0):
        from stable_baselines3 import PPO

        from smpl.sb3 import SB3VecEnv

        return PPO("MlpPolicy", SB3VecEnv(smpl.VectorEnv("reactor", 2, autoreset_mode="same_step")), seed=seed)

    if package == "torch":
        assert describe(network()) == describe(network())
        different = network(1), network(factor=2.0), network().train()
        scripted = torch.jit.script(torch.nn.Linear(3, 2))
        assert describe(scripted) == describe(scripted) != describe(torch.jit.script(torch.nn.Linear(3, 2)))
        assert all(describe(network()) != describe(one) for one in different)
        assert describe(torch.float32) != describe(torch.float64)
    else:
        policy = learned()
        fresh = describe(policy)
        policy.predict(np.zeros(3, dtype=np.float32), deterministic=True)
        assert describe(policy) == fresh == describe(learned()) != describe(learned(1))


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
