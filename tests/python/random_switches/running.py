"""Runs of one model on several step grids by all methods, compared with the expected values."""

from dataclasses import dataclass, field

import numpy as np

import smpl

METHODS = ("ida", "rosenbrock", "explicit", "auto")
GRIDS = (1, 3, 10, 100)  # control steps of a run


@dataclass
class Expected:
    """The result of a run, whatever its steps."""

    discrete: dict[str, tuple[float, float]] = field(default_factory=dict)  # name: value, tolerance
    states: dict[str, tuple] = field(default_factory=dict)  # name: function of time, tolerance
    failure: str = ""
    end: tuple[float, float] = (0.0, 0.0)  # time at which the run ends, tolerance


@dataclass
class Case:
    """A model without its episode, and what is expected of it."""

    kind: str
    text: str
    horizon: float
    implicit: bool
    expected: Expected
    about: str = ""  # for messages

    def source(self, count: int) -> str:
        return f"{self.text}\nepisode {{ step = {self.horizon / count!r}, max_steps = {count} }}\n"

    @property
    def methods(self) -> tuple[str, ...]:
        return tuple(m for m in METHODS if m != "explicit" or not self.implicit)


def mismatches(case: Case, grids=GRIDS, methods=None, **settings) -> list[tuple[str, int, str]]:
    """Each run that differs: its method, its number of control steps and the first difference."""
    found = []
    for count in grids:
        model = smpl.compile(source=case.source(count), settings=settings)
        for method in methods or case.methods:
            if message := _difference(case, model, method, count):
                found.append((method, count, message))
    return found


def _difference(case: Case, model: smpl.Model, method: str, count: int) -> str:
    expected = case.expected
    env = smpl.Env(model, normalize=False, method=method)
    env.reset(seed=0)
    for _ in range(count):
        _, _, terminated, truncated, info = env.step(np.zeros(len(env.action_names)))
        if terminated and info["failure"] != expected.failure:
            found = f"failure `{info['failure']}` at {info['time']:.9g}"
            return f"{found}, expected `{expected.failure}` at {expected.end[0]:.9g}"
        for name, (value, tolerance) in expected.states.items():
            state, right = env.state[env.state_names.index(name)], value(info["time"])
            if not abs(state - right) <= tolerance:
                return f"{name}({info['time']:.9g}) = {state:.9g}, expected {right:.9g} within {tolerance:.1e}"
        if terminated or truncated:
            break
    time, tolerance = expected.end
    if not abs(info["time"] - time) <= tolerance:
        return f"ended at {info['time']:.9g}, expected {time:.9g} within {tolerance:.1e}"
    for name, (value, tolerance) in expected.discrete.items():
        number = env.discrete[env.discrete_names.index(name)]
        if not abs(number - value) <= tolerance:
            return f"{name} = {number:.9g}, expected {value:.9g} within {tolerance:.1e}"
    return ""
