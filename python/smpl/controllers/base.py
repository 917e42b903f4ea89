"""What a controller is, and those that need no model."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from smpl.envs import Env
from smpl.model import FloatArray


@runtime_checkable
class Controller(Protocol):
    """Chooses actions for one environment."""

    def reset(self, env: Env) -> None:
        """Forget the last episode; called after `env.reset`."""

    def action(self, env: Env) -> FloatArray:
        """The next action in physical units, shape (actions,)."""


class Constant:
    """The same action at every step."""

    def __init__(self, action: npt.ArrayLike) -> None:
        self._action = np.asarray(action, dtype=np.float64)

    def reset(self, env: Env) -> None:
        """Nothing to forget."""

    def action(self, env: Env) -> FloatArray:
        """The constant action."""
        return self._action.copy()


class Nominal:
    """The nominal action of the model."""

    def reset(self, env: Env) -> None:
        """Nothing to forget."""

    def action(self, env: Env) -> FloatArray:
        """The declared defaults of the actions."""
        return env.model.native.defaults("action")


class Uniform:
    """Actions drawn uniformly from the action box.

    Args:
        seed: of the generator, which goes on from episode to episode.
    """

    def __init__(self, seed: int | None = None) -> None:
        self._generator = np.random.default_rng(seed)

    def reset(self, env: Env) -> None:
        """Nothing to forget."""

    def action(self, env: Env) -> FloatArray:
        """A random action."""
        return self._generator.uniform(env.action_low, env.action_high)


class OpenLoop:
    """A recorded sequence of actions.

    Args:
        actions: one action a step, physical units.
        hold: the last action is held when the sequence has ended; otherwise a step beyond it is an error.
    """

    def __init__(self, actions: Iterable[npt.ArrayLike], *, hold: bool = False) -> None:
        self._actions = [np.asarray(action, dtype=np.float64) for action in actions]
        self._hold = hold
        if not self._actions:
            raise ValueError("actions is empty, expected at least one action")

    def reset(self, env: Env) -> None:
        """Nothing to forget: the step of the environment is the position."""

    def action(self, env: Env) -> FloatArray:
        """The action of the environment's step.

        Raises:
            ValueError: the sequence has ended.
        """
        if env.steps >= len(self._actions) and not self._hold:
            raise ValueError(f"the actions end after step {len(self._actions)}: give more, or hold=True")
        return self._actions[min(env.steps, len(self._actions) - 1)].copy()
