"""Whatever chooses actions, as something that plays an episode.

A *player* is given what it may see and returns an action of the outermost environment. `as_player` makes one of a
controller (`action(env)`, physical units), of a learned policy (`predict`, `compute_single_action`) and of a function.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from typing import Any, Protocol

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box

from smpl._arguments import FloatArray, as_vector, check_names
from smpl.controllers.base import TakesWrapped, plain
from smpl.envs import Env
from smpl.wrappers import outer_action

Action = npt.NDArray[Any]
# What a controller may say that it sees, besides a level of the model.
VIEWS = ("environment", "observation", "state")


class Player(Protocol):
    """Chooses actions of the outermost environment."""

    def check(self, env: gymnasium.Env[Any, Any]) -> None:
        """Refuse an environment that does not show what is looked at; before its reset."""

    def reset(self, env: gymnasium.Env[Any, Any]) -> None:
        """Forget the last episode; after the environment's reset."""

    def choose(self, env: gymnasium.Env[Any, Any], observation: Any) -> tuple[Action, FloatArray | None]:
        """The action to give to `env.step`, and the physical one that must arrive, where it was chosen as such."""


class Function(TakesWrapped):
    """A function of what it is shown, as a controller in physical units.

    Args:
        function: called with one array, and with a `numpy.random.Generator` if `random`; returns an action.
        sees: `state` (differential states, physical units) or the name of an observation level of the model, whose
            readings it is given in physical units; the environment must have that level.
        random: the function takes a generator too, whose numbers come from the seed and number of the episode.

    A function without this wrapper is given what the environment returns and returns an action of its action space.
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
        """What the function returns for the state or the readings."""
        shown = env.state if self.sees == "state" else env.reading
        chosen = self._function(shown, self._generator) if self._random else self._function(shown)
        return as_vector("the function's action", chosen, len(env.action_names))


class Noisy(TakesWrapped):
    """Another controller with noise on its actions, for exploration; equal in equal episodes.

    Args:
        controller: one in physical units.
        deviation: standard deviations by names of actions, physical units; the others have no noise.
        seed: tells controllers apart that meet the same episode.
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


class _Physical:
    """A controller in physical units: it sees the environment beneath all wrappers, which are undone."""

    def __init__(self, controller: Any) -> None:
        self._controller = controller

    def check(self, env: gymnasium.Env[Any, Any]) -> None:
        check_view(plain(env), self._controller)

    def reset(self, env: gymnasium.Env[Any, Any]) -> None:
        forget = getattr(self._controller, "reset", None)
        if forget is not None:
            forget(plain(env))

    def choose(self, env: gymnasium.Env[Any, Any], observation: Any) -> tuple[Action, FloatArray | None]:
        base = plain(env)
        physical = as_vector("the controller's action", self._controller.action(base), len(base.action_names))
        # As data sets store it: the same actions give the same episode.
        return np.asarray(outer_action(env, base.from_physical(physical)), dtype=env.action_space.dtype), physical


class _Shown:
    """A policy that is given what the environment returns, and answers with an action of its space."""

    def __init__(self, policy: Any) -> None:
        self._policy = policy

    def check(self, env: gymnasium.Env[Any, Any]) -> None:
        check_view(plain(env), self._policy)
        check_spaces(self._policy, env.observation_space, env.action_space, plain(env))

    def reset(self, env: gymnasium.Env[Any, Any]) -> None:
        # A policy that draws does so with the generators of its library.
        torch = sys.modules.get("torch")
        if torch is not None:
            seed = int(np.random.SeedSequence(plain(env).episode).generate_state(1)[0])
            torch.manual_seed(seed)
        forget = getattr(self._policy, "reset", None)
        if forget is not None and not inspect.signature(forget).parameters:
            forget()

    def choose(self, env: gymnasium.Env[Any, Any], observation: Any) -> tuple[Action, FloatArray | None]:
        space: Any = env.action_space
        action = np.asarray(self.answer(observation), dtype=np.float64)
        if action.shape != space.shape:
            raise ValueError(f"the policy's action has shape {action.shape}, expected {space.shape}")
        return action.astype(space.dtype), None

    def answer(self, observation: Any) -> Any:
        """What the policy says; here it is called."""
        return self._policy(observation)


class _StableBaselines(_Shown):
    """`predict(observation, state, episode_start, deterministic)`, which returns the action and its memory."""

    _memory: Any = None
    _first = True

    def reset(self, env: gymnasium.Env[Any, Any]) -> None:
        super().reset(env)
        self._memory, self._first = None, True

    def answer(self, observation: Any) -> Any:
        action, self._memory = self._policy.predict(
            observation, state=self._memory, episode_start=np.array([self._first]), deterministic=True
        )
        self._first = False
        return action


class _Batch(_Shown):
    """`predict(observations)` with a row for each, as of d3rlpy and scikit-learn."""

    def answer(self, observation: Any) -> Any:
        return np.asarray(self._policy.predict(np.asarray(observation)[None]))[0]


class _RLlib(_Shown):
    """`compute_single_action(observation)`, which may return the action alone or with its memory."""

    def answer(self, observation: Any) -> Any:
        found = self._policy.compute_single_action(observation, explore=False)
        return found[0] if isinstance(found, tuple) else found


def as_player(controller: Any) -> Player:
    """Something that plays episodes, of anything that chooses actions.

    What it is, is found in this order: `action(env)`, a controller in physical units; `predict` with `deterministic`
    (Stable-Baselines3); `predict` of a batch (d3rlpy, scikit-learn); `compute_single_action` (RLlib); something that is
    called with an observation.

    Raises:
        TypeError: it is none of these.
    """
    if not isinstance(controller, type):
        if callable(getattr(controller, "action", None)):
            return _Physical(controller)
        predict = getattr(controller, "predict", None)
        if callable(predict):
            return (_StableBaselines if "deterministic" in _arguments(predict) else _Batch)(controller)
        if callable(getattr(controller, "compute_single_action", None)):
            return _RLlib(controller)
        if callable(controller):
            return _Shown(controller)
    what = f"the class {controller.__name__}" if isinstance(controller, type) else f"{controller!r}"
    raise TypeError(
        f"controller is {what}, expected an object with reset(env) and action(env), a policy with predict(observation),"
        " or a function of the observation"
    )


def check_view(env: Env, controller: Any) -> None:
    """Refuse an environment that does not show what a controller says that it sees.

    Raises:
        ValueError: it looks at another observation level; the message says which, and how to have it.
    """
    sees = getattr(controller, "sees", "environment")
    # A policy of another package may have an attribute of that name for itself.
    if not isinstance(sees, str) or sees in VIEWS:
        return
    level = env.model.level
    if sees == level:
        return
    who = type(controller).__name__
    if sees in env.model.levels:
        raise ValueError(
            f"{who} sees the level {sees!r}, the environment shows {level!r}: give it observation={sees!r}"
        )
    known = ", ".join((*VIEWS[1:], *env.model.levels))
    raise ValueError(f"{who} sees {sees!r}, which {env.model.name} does not have; there are: {known}")


def check_spaces(policy: Any, observations: Any, actions: Any, env: Env) -> None:
    """Refuse a policy whose observations or actions are not these, if it states its own.

    Raises:
        ValueError: their numbers differ, or one has actions in [-1, 1] and the other in physical units.
    """
    seen, given = (
        _shape(policy, "observation_space", "observation_shape"),
        _shape(policy, "action_space", "action_size"),
    )
    where = f"{env.model.name} (level {env.model.level!r})"
    advice = (
        "evaluate a policy in the formulation and on the observation level that it was trained in; "
        "smpl.learning.save_policy(policy, path, env) keeps them with the file"
    )
    if seen not in (None, observations.shape) or given not in (None, actions.shape):
        raise ValueError(
            f"the policy takes observations of shape {seen} and gives actions of shape {given}; {where} has "
            f"{observations.shape} and {actions.shape}: {advice}"
        )
    own = getattr(policy, "action_space", None)
    trained = getattr(own, "formulation", None)  # see `smpl.learning.formulation.LearnedBox`
    if trained is not None and trained != getattr(actions, "formulation", None):
        raise ValueError(
            f"the policy was trained in the formulation {trained}; {where} has another or none: use "
            "smpl.learning.formulation.FormulatedPolicy(policy, formulation), or the file that save_policy writes"
        )
    if isinstance(own, Box) and isinstance(actions, Box) and _is_unit(own) != _is_unit(actions):
        kinds = ["in [-1, 1]" if _is_unit(one) else "in physical units" for one in (own, actions)]
        raise ValueError(f"the policy gives actions {kinds[0]}; {where} takes them {kinds[1]}: {advice}")


def _shape(policy: Any, space: str, size: str) -> tuple[int, ...] | None:
    """Shape of a policy's space as Stable-Baselines3 or d3rlpy states it; none if it does not."""
    stated = getattr(getattr(policy, space, None), "shape", None)
    if stated is None:
        stated = getattr(policy, size, None)
    if isinstance(stated, (int, np.integer)):
        return (int(stated),)
    return tuple(stated) if isinstance(stated, (tuple, list)) else None


def _is_unit(space: Box) -> bool:
    return bool((space.low == -1).all() and (space.high == 1).all())


def _arguments(function: Any) -> tuple[str, ...]:
    try:
        return tuple(inspect.signature(function).parameters)
    except (TypeError, ValueError):  # compiled functions may have no signature
        return ()
