"""The base of controllers, and controllers that need no model."""

from __future__ import annotations

import contextlib
import functools
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Protocol, runtime_checkable

import gymnasium
import numpy as np
import numpy.typing as npt

from smpl._native import SimulationError
from smpl.controllers.identity import Recorded
from smpl.envs import Env
from smpl.policies import Rows
from smpl.support.arguments import FloatArray, as_count, as_vector, check_names, shorten
from smpl.support.options import check_keywords, expanded
from smpl.support.seeds import native_seed

# Attribute of a controller that was reset.
BEGUN = "_begun"
# Attribute with the texts of a controller's arguments, for its `repr`.
SHOWN = "_shown"


@runtime_checkable
class Controller(Protocol):
    """Chooses actions for one environment."""

    def reset(self, env: Env) -> None:
        """Forget the last episode; called after `env.reset`."""

    def action(self, env: Env) -> FloatArray:
        """The next action in physical units, shape (actions,)."""


class TakesWrapped(Recorded):
    """A controller. Its environment may be the one that `gymnasium.make` returns, with wrappers.

    Methods `reset` and `action`, and the making of a subclass, see the environment of smpl beneath.

    `action` before `reset` is refused, unless a subclass with `needs_reset=False` needs no
    preparation by a reset.
    """

    _needs_reset = True

    def __init_subclass__(cls, needs_reset: bool | None = None, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if needs_reset is not None:
            cls._needs_reset = needs_reset
        wrappers = {"__init__": _made, "reset": _beginning, "action": _begun}
        for name in wrappers.keys() & vars(cls).keys():
            setattr(cls, name, wrappers[name](vars(cls)[name]))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(getattr(self, SHOWN, ()))})"


def _made(method: Callable[..., Any]) -> Callable[..., Any]:
    """An `__init__` that unwraps environments and keeps the texts of its arguments for `repr`."""
    inner, signature = _beneath(method), inspect.signature(method)

    @functools.wraps(method)
    def making(self: Any, *given: Any, **named: Any) -> Any:
        given, named = expanded(method, given, named)
        check_keywords(type(self).__name__, signature, named)
        if not hasattr(self, SHOWN):  # a subclass has its own arguments
            with contextlib.suppress(TypeError):  # the call reports what is wrong with them
                bound = signature.bind(self, *given, **named)
                setattr(self, SHOWN, tuple(_texts(signature, bound.arguments)))
        return inner(self, *given, **named)

    return making


def _texts(signature: inspect.Signature, arguments: Mapping[str, Any]) -> Iterator[str]:
    """Arguments without the first, in the order of the call, as a call would have them."""
    for name, value in list(arguments.items())[1:]:
        parameter = signature.parameters[name]
        if parameter.kind is parameter.VAR_POSITIONAL:
            yield from (shorten(one) for one in value)
        elif parameter.kind is parameter.VAR_KEYWORD:
            yield from (f"{key}={shorten(one)}" for key, one in value.items())
        elif parameter.kind is parameter.KEYWORD_ONLY or parameter.default is not parameter.empty:
            yield f"{name}={shorten(value)}"
        else:
            yield shorten(value)


def _beneath(method: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(method)
    def unwrapped(self: Any, *given: Any, **named: Any) -> Any:
        return method(self, *map(plain, given), **{name: plain(one) for name, one in named.items()})

    return unwrapped


def _beginning(method: Callable[..., Any]) -> Callable[..., Any]:
    """A `reset` after which the controller may act."""
    inner = _beneath(method)

    @functools.wraps(method)
    def beginning(self: Any, *given: Any, **named: Any) -> Any:
        found = inner(self, *given, **named)
        if self._needs_reset:
            setattr(self, BEGUN, True)
        return found

    return beginning


def _begun(method: Callable[..., Any]) -> Callable[..., Any]:
    """An `action` that needs a `reset` before it, in classes that have one.

    Raises:
        SimulationError: there was none.
    """
    inner = _beneath(method)

    @functools.wraps(method)
    def acting(self: Any, *given: Any, **named: Any) -> Any:
        if self._needs_reset and hasattr(self, "reset"):
            require_reset(self, "action")
        return inner(self, *given, **named)

    return acting


def require_reset(controller: Any, method: str) -> None:
    """Refuse a method of a controller or estimator that was not reset.

    Raises:
        SimulationError: names the method.
    """
    if not hasattr(controller, BEGUN):
        name = type(controller).__name__
        raise SimulationError(f"{name}.{method} comes before {name}.reset: call reset(env) after env.reset()")


def plain(given: Any) -> Any:
    """An environment without its wrappers, anything else as it is."""
    return given.unwrapped if isinstance(given, gymnasium.Wrapper) else given


class Constant(TakesWrapped, needs_reset=False):
    """The same action at every step.

    Args:
        action: one number an action, physical units.
        actions: names of the actions that it sets; another environment is refused.
    """

    def __init__(self, action: npt.ArrayLike, actions: Iterable[str] | None = None) -> None:
        self._action = np.asarray(action, dtype=np.float64)
        self._names = None if actions is None else tuple(actions)

    def reset(self, env: Env) -> None:
        """Nothing to forget.

        Raises:
            ValueError: the environment has other actions.
        """
        if self._names is not None:
            require(env, "this constant", actions=self._names)
        as_vector("action", self._action, len(env.action_names))

    def action(self, env: Env) -> FloatArray:
        """The constant action."""
        return self._action.copy()

    def actions(self, rows: Rows) -> FloatArray:
        """The constant action for each row of a batch."""
        return np.tile(self._action, (len(rows.steps), 1))


class Policy(TakesWrapped, needs_reset=False):
    """A policy that the model declares, as `smpl simulate --policy NAME` runs it.

    Args:
        name: one of `env.model.policies`.
    """

    needs = "model"

    def __init__(self, name: str) -> None:
        self._name = name

    def reset(self, env: Env) -> None:
        """Nothing to forget: a policy is a function of the state and the step.

        Raises:
            ValueError: the model declares no such policy.
        """
        check_names("policy", [self._name], env.model.policies)

    def action(self, env: Env) -> FloatArray:
        """Actions of the policy for the coming step."""
        return env.policy(self._name)

    def actions(self, rows: Rows) -> FloatArray:
        """Actions of the policy in the environments of a batch."""
        return _of_model(self._name, rows)


class Nominal(TakesWrapped, needs_reset=False):
    """The model's policy `nominal`, or the nominal action, as `smpl simulate --policy nominal`."""

    needs = "model"

    def reset(self, env: Env) -> None:
        """Nothing to forget."""

    def action(self, env: Env) -> FloatArray:
        """The action of the policy, or the declared defaults of the actions."""
        return env.policy("nominal") if "nominal" in env.model.policies else env.model.native.defaults("action")

    def actions(self, rows: Rows) -> FloatArray:
        """Actions of the policy in the environments of a batch."""
        return _of_model("nominal", rows)


class Uniform(TakesWrapped):
    """Actions drawn uniformly from the action box, equal in equal episodes.

    Args:
        seed: distinguishes controllers in the same episode; 0 if none.
    """

    def __init__(self, seed: int | None = None) -> None:
        self._seed = as_count("seed", seed or 0, 0, "an integer that is not negative")
        self._generator = np.random.default_rng(self._seed)

    def reset(self, env: Env) -> None:
        """Begin the random numbers of the environment's episode."""
        self._generator = np.random.default_rng([self._seed, *env.episode])

    def action(self, env: Env) -> FloatArray:
        """A random action."""
        return self._generator.uniform(env.action_low, env.action_high)

    def actions(self, rows: Rows) -> FloatArray:
        """Random actions of a batch."""
        low, high = rows.interface.action_low, rows.interface.action_high
        for memory in rows.memory:
            if "generator" not in memory:
                episode = native_seed(memory["seed"]), memory.get("number", 0)
                memory["generator"] = np.random.default_rng([self._seed, *episode])
        return np.stack([memory["generator"].uniform(low, high) for memory in rows.memory])


def _of_model(policy: str, rows: Rows) -> FloatArray:
    """Actions of a policy of the model in the environments of the rows, as they are now."""
    batch: Any = rows.interface
    chosen: FloatArray = np.atleast_2d(batch.policy(policy))
    return chosen if rows.places is None else chosen[rows.places]


class OpenLoop(TakesWrapped, needs_reset=False):
    """A recorded sequence of actions.

    Args:
        actions: one action a step, physical units.
        hold: the last action is held when the sequence has ended; otherwise a step beyond it is an
            error.
    """

    def __init__(self, actions: Iterable[npt.ArrayLike], *, hold: bool = False) -> None:
        self._actions = [np.asarray(action, dtype=np.float64) for action in actions]
        self._hold = hold
        if not self._actions:
            raise ValueError("actions is empty, expected at least one action")

    def reset(self, env: Env) -> None:
        """Nothing to forget: the step of the environment is the position.

        Raises:
            ValueError: an action has a wrong shape.
        """
        for step, action in enumerate(self._actions):
            as_vector(f"action {step}", action, len(env.action_names))

    def action(self, env: Env) -> FloatArray:
        """The action of the environment's step.

        Raises:
            ValueError: the sequence has ended.
        """
        if env.steps >= len(self._actions) and not self._hold:
            raise ValueError(f"the actions end after step {len(self._actions)}: give more, or hold=True")
        return self._actions[min(env.steps, len(self._actions) - 1)].copy()


def require(env: Env, who: str, actions: Iterable[str] = (), states: Iterable[str] = ()) -> None:
    """Refuse an environment that is not the one that a controller was made for.

    Raises:
        ValueError: its actions are others, or it has not these states.
    """
    wanted, needed = tuple(actions), tuple(states)
    if env.action_names != wanted:
        raise ValueError(
            f"{who} is for the actions {', '.join(wanted)}; {env.model.name} has {', '.join(env.action_names)}"
        )
    missing = [name for name in needed if name not in env.state_names]
    if missing:
        raise ValueError(f"{who} looks at the states {', '.join(needed)}; {env.model.name} has no {', '.join(missing)}")
