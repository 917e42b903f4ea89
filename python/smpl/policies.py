"""Policies: everything that chooses actions, behind one interface.

`as_policy` adapts a controller (`action(env)`, physical units), a policy of Stable-Baselines3,
d3rlpy, scikit-learn or RLlib, an object that acts on a batch, or a function of the observation. The
table `KINDS` lists the kinds of objects in the order in which they are tried;
`smpl.learning.load_policy` reads files.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box

from smpl.envs import Env, Interface
from smpl.support.arguments import FloatArray, as_vector

Array = npt.NDArray[Any]
# Values of a controller's attribute `sees`, in addition to the observation levels of the model.
VIEWS = ("environment", "observation", "state")


@dataclass
class Rows:
    """Inputs of a policy for one or more environments; arrays have one row per environment.

    Attributes:
        interface: names, bounds and scaling, the same for all: the `Env` or the `VectorEnv`.
        observations: as the environments returned them.
        states: physical units.
        steps: completed steps of each episode.
        memory: one mapping per environment that the policy may write to; a reset replaces it by
            the `seed` of the episode and its `number` since that seed was given.
        places: indices of the rows in the batch `interface`; None for all.
    """

    interface: Interface
    observations: Array
    states: FloatArray
    steps: npt.NDArray[np.int64]
    memory: list[dict[str, Any]]
    places: npt.NDArray[np.intp] | None = None


class Policy(Protocol):
    """Chooses actions for one environment or a batch.

    Attributes:
        physical: actions are in physical units; otherwise they are elements of the action space.
        batched: `act` takes any number of rows; otherwise one row, of a single environment.
        needs: source of the actions: `states` of the rows, the running `model`, or neither (empty).
    """

    physical: bool
    batched: bool
    needs: str

    def check(self, env: gymnasium.Env[Any, Any]) -> None:
        """Refuse an environment that the policy does not fit."""

    def reset(self, env: Any, seed: int | None) -> None:
        """Start an episode, after the reset of the environment.

        Args:
            env: the environment with its wrappers, or the batch in which an episode begins.
            seed: of the episode.
        """

    def act(self, rows: Rows) -> FloatArray:
        """Actions of the rows, shape (rows, actions)."""


class _Controller:
    """`action(env)` in physical units; `actions(rows)` for a batch, if one class defines both."""

    physical = True

    def __init__(self, controller: Any) -> None:
        self._controller = controller
        self.needs: str = getattr(controller, "needs", "")
        own = "action" in getattr(controller, "__dict__", ())
        where = _defining(controller, "actions")
        self.batched = not own and where is not None and where is _defining(controller, "action")

    def check(self, env: gymnasium.Env[Any, Any]) -> None:
        check_view(env.unwrapped, self._controller)

    def reset(self, env: Any, seed: int | None) -> None:
        forget = getattr(self._controller, "reset", None)
        if forget is not None and isinstance(env, gymnasium.Env):
            forget(env.unwrapped)

    def act(self, rows: Rows) -> FloatArray:
        if self.batched:
            return np.asarray(self._controller.actions(rows))
        given = self._controller.action(rows.interface)
        return as_vector("the controller's action", given, len(rows.interface.action_names))[None]


class _Shown:
    """A function of the returned observation, which returns an element of the action space."""

    physical = False
    batched = False
    needs = ""

    def __init__(self, policy: Any) -> None:
        self._policy = policy

    def check(self, env: gymnasium.Env[Any, Any]) -> None:
        check_view(env.unwrapped, self._policy)
        check_spaces(self._policy, env.observation_space, env.action_space, env.unwrapped)

    def reset(self, env: Any, seed: int | None) -> None:
        # A policy that draws uses the generator of its library; it never acts in a batch.
        torch = sys.modules.get("torch")
        if torch is not None and isinstance(env, gymnasium.Env):
            base: Any = env.unwrapped
            torch.manual_seed(int(np.random.SeedSequence(base.episode).generate_state(1)[0]))
        forget = getattr(self._policy, "reset", None)
        if forget is not None and not _parameters(forget):
            forget()

    def act(self, rows: Rows) -> FloatArray:
        return np.stack([as_action(self.answer(one)) for one in rows.observations])

    def answer(self, observation: Any) -> Any:
        """The action for one observation."""
        return self._policy(observation)


class _RLlib(_Shown):
    """`compute_single_action(observation)`, which returns the action alone or with its memory."""

    def answer(self, observation: Any) -> Any:
        found = self._policy.compute_single_action(observation, explore=False)
        return found[0] if isinstance(found, tuple) else found


class _Predicting(_Shown):
    """`predict(observations)` with a row for each, as of d3rlpy and scikit-learn."""

    def __init__(self, policy: Any) -> None:
        super().__init__(policy)
        self.batched = True

    def check(self, env: gymnasium.Env[Any, Any]) -> None:
        super().check(env)
        shown = getattr(env.unwrapped, "_returned", None)
        # Such a policy acts alone, seeded by its episode.
        self.batched = shown is None or not draws(lambda: self._policy.predict(shown[None]))

    def act(self, rows: Rows) -> FloatArray:
        return np.asarray(self._policy.predict(rows.observations), dtype=np.float64)


class _StableBaselines(_Predicting):
    """`predict(observation, state, episode_start, deterministic)` with a hidden state."""

    def __init__(self, policy: Any) -> None:
        super().__init__(policy)
        self._takes = _parameters(policy.predict)

    def check(self, env: gymnasium.Env[Any, Any]) -> None:
        _Shown.check(self, env)

    def act(self, rows: Rows) -> FloatArray:
        options: dict[str, Any] = {"deterministic": True}
        if "episode_start" in self._takes:
            options["state"] = _stacked([one.get("state") for one in rows.memory])
            options["episode_start"] = np.array([step == 0 for step in rows.steps])
        alone = isinstance(rows.interface, Env)
        given = self._policy.predict(rows.observations[0] if alone else rows.observations, **options)
        if isinstance(given, tuple):
            given, state = given
            for i, one in enumerate(rows.memory if state is not None else ()):
                one["state"] = state if alone else tuple(part[..., i : i + 1, :] for part in state)
        return as_action(given)[None] if alone else np.asarray(given, dtype=np.float64)


class _Own:
    """An object that is a `Policy` itself, of which `act(rows)` alone is required."""

    def __init__(self, policy: Any) -> None:
        self._policy = policy
        self.physical: bool = getattr(policy, "physical", False)
        self.batched: bool = getattr(policy, "batched", True)
        self.needs: str = getattr(policy, "needs", "states")

    def check(self, env: gymnasium.Env[Any, Any]) -> None:
        own = getattr(self._policy, "check", None)
        if callable(own):
            own(env)
            self.batched = getattr(self._policy, "batched", True)

    def reset(self, env: Any, seed: int | None) -> None:
        own = getattr(self._policy, "reset", None)
        if callable(own):
            own(*((env, seed) if _parameters(own) else ()))

    def act(self, rows: Rows) -> FloatArray:
        return np.asarray(self._policy.act(rows), dtype=np.float64)


@dataclass(frozen=True)
class Kind:
    """A kind of object that chooses actions.

    Attributes:
        interface: how it is called.
        found: whether an object is of this kind.
        adapter: makes a `Policy` of it.
    """

    interface: str
    found: Callable[[Any], bool]
    adapter: Callable[[Any], Policy]


def _has(name: str, *parameters: str) -> Callable[[Any], bool]:
    def found(thing: Any) -> bool:
        method = getattr(thing, name, None)
        return callable(method) and set(parameters) <= set(_parameters(method))

    return found


# The first kind that an object is of.
KINDS = (
    Kind("action(env), a controller in physical units", _has("action"), _Controller),
    Kind("predict(observation, ..., deterministic), Stable-Baselines3", _has("predict", "deterministic"),
         _StableBaselines),
    Kind("predict(observations), d3rlpy and scikit-learn", _has("predict"), _Predicting),
    Kind("act(rows), a policy of smpl", _has("act"), _Own),
    Kind("compute_single_action(observation), RLlib", _has("compute_single_action"), _RLlib),
    Kind("a function of the observation", callable, _Shown),
)  # fmt: skip


def as_policy(chooser: Any) -> Policy:
    """Adapt anything that chooses actions; `KINDS` lists what is recognised, in order.

    Raises:
        TypeError: the object is of no kind.
    """
    if not isinstance(chooser, type):
        for kind in KINDS:
            if kind.found(chooser):
                return kind.adapter(chooser)
    what = f"the class {chooser.__name__}" if isinstance(chooser, type) else f"{chooser!r}"
    raise TypeError(
        f"controller is {what}, expected an object with reset(env) and action(env), a policy with predict(observation),"
        " or a function of the observation"
    )


def acted(policy: Policy, rows: Rows, name: str) -> FloatArray:
    """Actions of the rows in the action space, of a policy by its name.

    Raises:
        ValueError: the actions have another shape.
    """
    given, expected = policy.act(rows), (len(rows.steps), len(rows.interface.action_names))
    if given.shape != expected:
        raise ValueError(f"{name} gave actions of shape {given.shape}, expected {expected}")
    return rows.interface.from_physical(given) if policy.physical else given


# Checks of an environment.


def check_view(env: Any, controller: Any) -> None:
    """Refuse an environment without the observation level that a controller declares in `sees`.

    Raises:
        ValueError: the environment shows another level; the message names the argument to give.
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


def check_spaces(policy: Any, observations: Any, actions: Any, env: Any) -> None:
    """Refuse a policy whose observations or actions are not these, if it states its own.

    Raises:
        ValueError: their numbers differ, or only one has actions in [-1, 1].
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
    """Shape of a policy's space as Stable-Baselines3 or d3rlpy states it; None if it does not."""
    stated = getattr(getattr(policy, space, None), "shape", None)
    if stated is None:
        stated = getattr(policy, size, None)
    if isinstance(stated, (int, np.integer)):
        return (int(stated),)
    return tuple(stated) if isinstance(stated, (tuple, list)) else None


def _is_unit(space: Box) -> bool:
    return bool((space.low == -1).all() and (space.high == 1).all())


# Arguments and results of policies.


def as_action(given: Any) -> FloatArray:
    """An action as a vector of doubles; a leading axis of one row is dropped."""
    array = np.asarray(given, dtype=np.float64)
    return array[0] if array.ndim == 2 and len(array) == 1 else array


def draws(act: Callable[[], Any]) -> bool:
    """True if a call uses the random generator of torch; its state is restored."""
    torch = sys.modules.get("torch")
    if torch is None or not hasattr(torch, "get_rng_state"):
        return False
    before = torch.get_rng_state()
    act()
    drawn = not torch.equal(before, torch.get_rng_state())
    torch.set_rng_state(before)
    return drawn


def _stacked(states: list[Any]) -> Any:
    """Hidden states of several rows in one; zeros for rows that begin, None where all do."""
    known = next((one for one in states if one is not None), None)
    if known is None or len(states) == 1:
        return known
    whole = [known if one is None else one for one in states]
    parts = [
        [np.zeros_like(part) if one is None else part for part in parts]
        for one, parts in zip(states, whole, strict=True)
    ]
    return tuple(np.concatenate(columns, axis=-2) for columns in zip(*parts, strict=True))


def _parameters(function: Any) -> Mapping[str, Any]:
    try:
        return inspect.signature(function).parameters
    except (TypeError, ValueError):  # compiled functions may have no signature
        return {}


def _defining(thing: Any, name: str) -> type | None:
    """The class that defines a method of an object."""
    return next((one for one in type(thing).__mro__ if name in vars(one)), None)
