"""Controllers that are made of functions and of other controllers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.controllers.base import TakesWrapped
from smpl.envs import Env
from smpl.support.arguments import FloatArray, as_vector, check_names


class Function(TakesWrapped):
    """A function of what it is shown, as a controller in physical units.

    Args:
        function: called with one array, and with a `numpy.random.Generator` if `random`; returns an
            action.
        sees: `state` (differential states, physical units) or the name of an observation level of
            the model, whose readings it is given in physical units; the environment must have that
            level.
        random: the function takes a generator too, whose numbers come from the seed and number of
            the episode.

    A function without this wrapper is given what the environment returns and returns an action of
    its action space.
    """

    def __init__(self, function: Callable[..., npt.ArrayLike], sees: str = "state", *, random: bool = False) -> None:
        if not callable(function):
            raise TypeError(f"function is {type(function).__name__}, expected something that can be called")
        if sees in ("observation", "environment"):
            raise ValueError(f"sees is {sees!r}: give the function itself to evaluate, or sees='state' or a level")
        self.sees = sees
        self._function, self._random = function, bool(random)
        self._generator = np.random.default_rng(0)

    def reset(self, env: Env) -> None:
        """Begin the random numbers of the episode."""
        self._generator = np.random.default_rng(env.episode)

    def action(self, env: Env) -> FloatArray:
        """The result of the function for the state or the readings."""
        shown = env.state if self.sees == "state" else env.reading
        chosen = self._function(shown, self._generator) if self._random else self._function(shown)
        return as_vector("the function's action", chosen, len(env.action_names))


class Noisy(TakesWrapped):
    """Another controller with noise on its actions, for exploration; equal in equal episodes.

    Args:
        controller: one in physical units.
        deviation: standard deviations by names of actions, physical units; the others have no
            noise.
        seed: distinguishes controllers in the same episode.
    """

    def __init__(self, controller: Any, deviation: dict[str, float], seed: int = 0) -> None:
        self._controller, self._deviation, self._seed = controller, dict(deviation), seed
        self.sees = getattr(controller, "sees", "environment")
        self._generator = np.random.default_rng(seed)
        self._scale = np.zeros(0)

    def reset(self, env: Env) -> None:
        """Begin the episode of the controller and of the noise."""
        check_names("deviation", self._deviation, env.action_names)
        self._scale = np.array([self._deviation.get(name, 0.0) for name in env.action_names])
        self._generator = np.random.default_rng([self._seed, *env.episode])
        self._controller.reset(env)

    def action(self, env: Env) -> FloatArray:
        """The controller's action with its noise, within the box."""
        noise = self._scale * self._generator.standard_normal(len(self._scale))
        return np.clip(self._controller.action(env) + noise, env.action_low, env.action_high)
