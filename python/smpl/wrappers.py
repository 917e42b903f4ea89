"""Wrappers for Gymnasium environments of this package."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box
from gymnasium.wrappers import ClipAction, RescaleAction

from smpl.envs import Env
from smpl.support.scaling import from_share, to_share

Observation = npt.NDArray[np.float32]
Action = npt.NDArray[Any]


class SafetyGymnasium:
    """Interface of Safety-Gymnasium: `step` also returns a cost after the reward.

    It is not a `gymnasium.Wrapper`, since it returns six results instead of five; other attributes
    are those of the environment. The cost is `info["cost"]`, the sum of the violations of all
    constraints, 0 where they are kept.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        self.env = env

    def __getattr__(self, name: str) -> Any:
        if name == "env":  # not there yet in an object that is being copied or unpickled
            raise AttributeError(name)
        return getattr(self.env, name)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; as of the environment."""
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, float, float, bool, bool, dict[str, Any]]:
        """Apply an action."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, float(reward), float(info["cost"]), terminated, truncated, info


class AroundNominal(gymnasium.ActionWrapper[Observation, Action, Action]):
    """Actions in [-1, 1] around the nominal ones: 0 is nominal, -1 and 1 are the bounds.

    A policy that starts at zero then starts at the nominal operating point, which is seldom the
    middle of the box. `normalize="nominal"` of `smpl.Env` and `smpl.VectorEnv` does the same
    without a wrapper, also in batches.

    Example:
        >>> env = AroundNominal(gymnasium.make("smpl/Reactor-v0"))  # doctest: +SKIP
    """

    def __init__(self, env: gymnasium.Env[Observation, Action]) -> None:
        super().__init__(env)
        base = env.unwrapped
        if not isinstance(base, Env):
            raise TypeError(f"AroundNominal wraps environments of smpl, got {type(base).__name__}")
        self._base = base
        self._nominal = base.model.action_nominal
        self.action_space = Box(-1.0, 1.0, shape=self._nominal.shape, dtype=np.float32)

    def action(self, action: Action) -> Action:
        """The action of the environment beneath."""
        shares = np.asarray(action, dtype=np.float64)
        low, high = self._base.action_low, self._base.action_high
        return self._base.from_physical(from_share(shares, low, self._nominal, high))

    def reverse_action(self, action: Action) -> Action:
        """The action in [-1, 1] that becomes the given one of the environment beneath."""
        low, high = self._base.action_low, self._base.action_high
        return to_share(self._base.to_physical(action), low, self._nominal, high)


def outer_action(env: gymnasium.Env[Any, Any], action: Action) -> Action:
    """Argument of `env.step` for which `action` arrives at the environment beneath all wrappers.

    Wrappers that change actions must be known: `AroundNominal`, Gymnasium's `RescaleAction` and
    `ClipAction`, or one with a method `reverse_action`.

    Raises:
        TypeError: a wrapper changes actions irreversibly.
    """
    wrappers: list[Any] = []
    while isinstance(env, gymnasium.Wrapper):
        wrappers.append(env)
        env = env.env
    for wrapper in reversed(wrappers):
        action = _undo(wrapper, action)
    return action


def _undo(wrapper: gymnasium.Wrapper[Any, Any, Any, Any], action: Action) -> Action:
    reverse: Any = getattr(wrapper, "reverse_action", None)
    if reverse is not None:
        return np.asarray(reverse(action))
    inside: Any = wrapper.env.action_space
    if isinstance(wrapper, ClipAction):
        return np.clip(action, inside.low, inside.high)
    if isinstance(wrapper, RescaleAction):
        outside: Any = wrapper.action_space
        low, high = (np.asarray(bound, dtype=np.float64) for bound in (inside.low, inside.high))
        # Where the bounds inside are one number, every action outside becomes it.
        share = np.divide(action - low, high - low, out=np.zeros_like(low), where=high > low)
        return outside.low + share * (np.float64(outside.high) - outside.low)
    if isinstance(wrapper, gymnasium.ActionWrapper):
        raise TypeError(
            f"{type(wrapper).__name__} changes actions, and a controller's would arrive as others: "
            "give the wrapper a method reverse_action(action), or run without it"
        )
    return action
