"""Formulation of a learning task: actions, observations and rewards of a learner.

The process does not change. `FormulatedPolicy` converts actions of a formulation's policy to those
of the environment, so that it is collected, evaluated and compared as any other.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box

from smpl.controllers import Recorded, Uniform
from smpl.envs import Env, Interface
from smpl.episodes import Episode
from smpl.learning.names import named
from smpl.model import Model
from smpl.policies import Rows, acted, as_policy, check_spaces, draws
from smpl.support.arguments import (
    FloatArray,
    as_count,
    as_finite_number,
    as_mapping,
    as_number,
    check_names,
    elements,
)
from smpl.support.hints import of_argument
from smpl.support.scaling import from_unit
from smpl.support.seeds import native_seed

Array = npt.NDArray[Any]
FILE = "formulation.json"
# Centres other than controllers.
_CENTRES = ("box", "nominal", "rules", "recipe")


@dataclass(frozen=True)
class Formulation:
    """Actions, observations and rewards of a learner instead of the environment's own.

    An action a in [-1, 1] means `centre + reach * a * (distance from the centre to the limit on
    that side)`, so that 0 is the centre and, with `reach` 1, -1 and 1 are the limits.

    Attributes:
        centre: `box` (middle of the limits), `nominal` (declared defaults), `rules` or `recipe`, or
            a controller that the learner corrects. `rules` are the two rules of the antibody
            process or its plant for the level of a tank and the switch, nominal for the rest.
            `recipe` is the model's policy `nominal`, which must be a function of the step alone. A
            controller is named as one that acts on batches (`pid`, `profile`, `constant:...`) or as
            another policy of the model.
        reach: share of the way from the centre to a limit that the learner may go.
        left: names of actions, single ones or arrays, that are left to the centre; the learner does
            not have them.
        limits: name of an action to (low, high) in physical units: a box inside the declared one. A
            centre outside of it is moved to its nearest end.
        windows: name of an observation to (low, high) in physical units: the learner observes these
            as -1 and 1, clipped, instead of the observation. A process that is held near a point
            moves little within its bounds.
        history: observations that a policy sees, the newest last; 1 for the present one only.
        reward_scale: factor of rewards.
        reward_range: (low, high) that scaled rewards are clipped to.
        failure_reward: reward of a step that ends in a failure, instead of the scaled one; None for
            the scaled one.

    Raises:
        ValueError: an invalid number.
    """

    centre: str = "box"
    reach: float = 1.0
    left: tuple[str, ...] = ()
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    windows: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    history: int = 1
    reward_scale: float = 1.0
    reward_range: tuple[float, float] | None = None
    failure_reward: float | None = None

    def __post_init__(self) -> None:
        as_count("history", self.history)
        reach, scale = as_number("reach", self.reach), as_number("reward_scale", self.reward_scale)
        if not 0 < reach <= 1:
            raise ValueError(f"reach is {self.reach!r}, expected a share above 0, at most 1")
        if not (np.isfinite(scale) and scale > 0):
            raise ValueError(f"reward_scale is {self.reward_scale!r}, expected a positive number")
        left: Any = self.left
        if isinstance(left, str) or not isinstance(left, Iterable):
            raise ValueError(f"left is {left!r}, expected names of actions")
        object.__setattr__(self, "left", tuple(left))
        for what in ("limits", "windows"):
            ends = as_mapping(what, getattr(self, what)).items()
            object.__setattr__(self, what, {name: _ends(f"{what}[{name!r}]", bounds) for name, bounds in ends})
        if self.failure_reward is not None:
            as_finite_number("failure_reward", self.failure_reward)
        if self.reward_range is not None:
            object.__setattr__(self, "reward_range", _ends("reward_range", self.reward_range))

    @classmethod
    def of(cls, given: Mapping[str, Any] | Formulation | None) -> Formulation:
        """From a mapping, as a configuration file has it.

        Raises:
            ValueError: an unknown key or a wrong value.
        """
        if isinstance(given, Formulation):
            return given
        known = [one.name for one in fields(cls)]
        for name in given or {}:
            if name not in known and (hint := of_argument("formulation", name, known)):
                raise ValueError(f"formulation: unknown {name!r}; {hint}; there are: {', '.join(known)}")
        check_names("formulation", given or {}, known)
        return cls(**(given or {}))

    def reward(self, rewards: Array, failed: Array) -> Array:
        """Rewards as the learner gets them; `failed` marks steps that end in a failure."""
        scaled = np.asarray(rewards, dtype=np.float64) * self.reward_scale
        if self.reward_range is not None:
            scaled = np.clip(scaled, *self.reward_range)
        return scaled if self.failure_reward is None else np.where(failed, self.failure_reward, scaled)

    @property
    def shapes_rewards_only(self) -> bool:
        """True if actions and observations are the environment's own."""
        return replace(self, reward_scale=1.0, reward_range=None, failure_reward=None) == Formulation()

    def write(self, folder: Path) -> None:
        """Saves it next to a policy, where `--policy` finds it."""
        (folder / FILE).write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")


class LearnedBox(Box):
    """Action space of a formulation, so that a policy with its space has the formulation.

    Attributes:
        formulation: as a mapping of its attributes.
        names: observations and actions of the environment that it was laid over.
    """

    def __init__(self, form: Form) -> None:
        super().__init__(-1.0, 1.0, (len(form.learned),), np.float32)
        self.formulation = asdict(form.formulation)
        self.names = names_of(form.interface)


def names_of(interface: Interface | Model) -> dict[str, list[str]]:
    """Names of the observations and actions that a policy meets, in their order."""
    return {"observations": list(interface.observation_names), "actions": list(interface.action_names)}


class Form:
    """A formulation of one environment: its spaces, and what arrives at the process.

    Args:
        formulation: how the learner sees it.
        interface: the environment, single or a batch.

    Raises:
        ValueError: an unknown action, observation or centre, limits outside of the action's bounds,
            or no action is left to learn.
    """

    def __init__(self, formulation: Formulation, interface: Interface) -> None:
        self.formulation, self.interface = formulation, interface
        names = interface.action_names
        left = elements("left", formulation.left, names)
        limits = elements("limits", formulation.limits, names)
        self.learned = np.array([i for i, name in enumerate(names) if name not in left], dtype=np.intp)
        if not len(self.learned):
            raise ValueError(f"left has all actions ({', '.join(names)}): nothing is left to learn")
        self.low, self.high = interface.action_low.copy(), interface.action_high.copy()
        for name, whole in limits.items():
            i, (low, high) = names.index(name), formulation.limits[whole]
            if not self.low[i] <= low < high <= self.high[i]:
                raise ValueError(
                    f"limits[{name!r}] is ({low}, {high}), expected a part of {self.low[i]}..{self.high[i]}"
                )
            self.low[i], self.high[i] = low, high
        self._centre, self.needs = _centre(formulation.centre, interface, self.low, self.high)
        if formulation.centre == "nominal":
            self._warn_of_nominal(interface.model.native.defaults("action"), names)
        windows = elements("windows", formulation.windows, interface.observation_names)
        self._windowed = np.array([interface.observation_names.index(name) for name in windows], dtype=np.intp)
        self._bounds = interface.observation_low[self._windowed], interface.observation_high[self._windowed]
        self._window = np.array([formulation.windows[whole] for whole in windows.values()]).reshape(-1, 2).T

    def _warn_of_nominal(self, nominal: FloatArray, names: Sequence[str]) -> None:
        for i, name in enumerate(names):
            if not self.low[i] <= nominal[i] <= self.high[i]:
                warnings.warn(
                    f"limits[{name!r}] is ({self.low[i]:g}, {self.high[i]:g}) without the nominal action "
                    f"{nominal[i]:g}: what is learned goes from the limit that is nearest to it",
                    stacklevel=4,
                )

    def action_space(self) -> Box:
        """The learned actions in [-1, 1]."""
        if self.formulation.shapes_rewards_only:
            return Box(-1.0, 1.0, (len(self.learned),), np.float32)
        return LearnedBox(self)

    def observation_space(self, single: Any) -> Box:
        """The observations of `history` instants, one after the other."""
        count, low, high = self.formulation.history, single.low.copy(), single.high.copy()
        low[self._windowed], high[self._windowed] = -1.0, 1.0
        return Box(np.tile(low, count), np.tile(high, count), dtype=np.float32)

    def physical(self, rows: Rows, actions: Array) -> FloatArray:
        """All physical actions for the learner's (environments, learned actions)."""
        centre = np.clip(self._centre(rows), self.low, self.high)
        scaled = np.clip(np.asarray(actions, dtype=np.float64), -1.0, 1.0) * self.formulation.reach
        middle, low, high = (values[..., self.learned] for values in (centre, self.low, self.high))
        centre[:, self.learned] = middle + scaled * np.where(scaled < 0, middle - low, high - middle)
        return centre

    def reverse(self, rows: Rows, physical: Array) -> FloatArray:
        """Actions of the learner that come nearest to the given ones in physical units."""
        centre = np.clip(self._centre(rows), self.low, self.high)[:, self.learned]
        shift = np.asarray(physical, dtype=np.float64)[:, self.learned] - centre
        width = np.where(shift < 0, centre - self.low[self.learned], self.high[self.learned] - centre)
        scaled = np.divide(shift, width * self.formulation.reach, out=np.zeros_like(shift), where=width > 0)
        return np.clip(scaled, -1.0, 1.0)

    def observe(self, memory: Sequence[dict[str, Any]], observations: Array) -> Array:
        """Observations with earlier ones; an episode begins with copies of the first one."""
        count, observations = self.formulation.history, self._through_windows(observations)
        if count == 1:
            return observations
        for one, observation in zip(memory, observations, strict=True):
            seen = one.get("seen")
            one["seen"] = [observation.copy()] * count if seen is None else [*seen[1:], observation.copy()]
        return np.stack([np.concatenate(one["seen"]) for one in memory])

    @property
    def follows_step(self) -> bool:
        """True if the centre is a function of the step alone."""
        return self.formulation.centre in ("box", "nominal", "recipe")

    def slopes(self, seen: Array) -> FloatArray:
        """Derivatives of what a learner observes, by the measured values in physical units.

        Args:
            seen: observations of the learner, (rows, observations); one that is clipped has the
                slope 0.

        Raises:
            ValueError: the formulation has a history.
        """
        if self.formulation.history != 1:
            raise ValueError(f"history is {self.formulation.history}, expected 1: derivatives are of one observation")
        low, high = self.interface.observation_low.copy(), self.interface.observation_high.copy()
        low[self._windowed], high[self._windowed] = self._window
        scaled = np.isfinite(low) & np.isfinite(high) & (high > low)
        if not self.interface.normalize:
            scaled &= np.isin(np.arange(len(low)), self._windowed)
        width = np.where(scaled, high - low, 2.0)
        return np.where(scaled & (np.abs(seen) >= 1.0), 0.0, 2.0 / width)

    def _through_windows(self, observations: Array) -> Array:
        """A batch of observations with those that have windows as the learner sees them."""
        if not len(self._windowed):
            return observations
        seen, values = observations.copy(), observations[:, self._windowed].astype(np.float64)
        if self.interface.normalize:
            values = from_unit(values, *self._bounds)
        low, high = self._window
        seen[:, self._windowed] = np.clip((2 * values - (high + low)) / (high - low), -1.0, 1.0)
        return seen


class _Acting(Recorded):
    """Acts on batches in a formulation, which is laid over each environment once."""

    def __init__(self, formulation: Formulation) -> None:
        self._formulation = formulation
        self._form: Form | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_form": None}

    def _laid_over(self, interface: Interface) -> Form:
        if self._form is None or self._form.interface is not interface:
            self._form = Form(self._formulation, interface)
        return self._form


class FormulatedPolicy(_Acting):
    """A policy of a formulation as one of the environment beneath.

    Args:
        policy: with `predict`, or a function; observations and actions of the formulation.
        formulation: what it was trained in.
    """

    def __init__(self, policy: Any, formulation: Formulation) -> None:
        super().__init__(formulation)
        self._policy, self._inner, self.batched = policy, as_policy(policy), True
        if self._inner.physical or self._inner.needs:
            raise TypeError(f"policy is {type(policy).__name__}, expected an object with predict, or a function")

    def check(self, env: Env) -> None:
        """Refuse an environment in which the policy does not fit its formulation.

        Raises:
            ValueError: the numbers of observations or actions differ.
        """
        form = self._laid_over(env)
        check_spaces(self._policy, form.observation_space(env.observation_space), form.action_space(), env)
        rows = Rows(env, env._returned[None], env.state[None], np.array([env.steps]), [{}])  # type: ignore[index]
        self.batched = not draws(lambda: self.act(rows))

    def reset(self, env: Any, seed: int | None) -> None:
        """Start an episode of the policy."""
        self._inner.reset(env, seed)

    def act(self, rows: Rows) -> FloatArray:
        """Actions for a batch, in the action space of the environment."""
        form = self._laid_over(rows.interface)
        seen = replace(rows, observations=form.observe(rows.memory, rows.observations))
        actions = self._inner.act(seen)
        if actions.shape != (len(rows.steps), len(form.learned)):
            expected = len(rows.steps), len(form.learned)
            raise ValueError(f"the policy gave actions of shape {actions.shape}, expected {expected}")
        return rows.interface.from_physical(form.physical(rows, actions))


class Exploration(_Acting):
    """The centre of a formulation with noise on the learned actions, for data sets.

    Args:
        formulation: as the learner will see the environment.
        noise: standard deviation of normal noise on actions in [-1, 1], clipped there.
    """

    def __init__(self, formulation: Formulation, noise: float) -> None:
        super().__init__(formulation)
        self._noise = noise

    def act(self, rows: Rows) -> FloatArray:
        """Actions for a batch in the environment's action space, by the seeds of the episodes."""
        form = self._laid_over(rows.interface)
        actions = np.stack([self._drawn(one, len(form.learned)) for one in rows.memory])
        return rows.interface.from_physical(form.physical(rows, actions))

    def _drawn(self, memory: dict[str, Any], count: int) -> FloatArray:
        if "explored" not in memory:
            memory["explored"] = np.random.default_rng([native_seed(memory["seed"]), 5])
        drawn: FloatArray = memory["explored"].normal(0.0, self._noise, count)
        return drawn


def formulated(episode: Episode, form: Form) -> Episode:
    """An episode of the environment as a learner of the formulation would have had it.

    Args:
        episode: with all of its states, where the centre reads them.
        form: the formulation, of that environment.

    Returns:
        The episode with the observations, actions and rewards of the learner.

    Raises:
        ValueError: states that the centre reads were not kept, or an action is not one of the
            formulation.
    """
    interface = form.interface
    for what, array, names in (
        ("observations", episode.observations, interface.observation_names),
        ("actions", episode.actions, interface.action_names),
    ):
        if array.shape[1] != len(names):
            raise ValueError(f"the episode has {array.shape[1]} {what}, {interface.model.name} has {len(names)}")
    kept, every = episode.states.shape[1], len(interface.model.state_names)
    if form.needs == "model":
        raise ValueError(
            f"the centre {form.formulation.centre!r} is a policy of {interface.model.name}: what it would have chosen "
            "is not known of recorded episodes"
        )
    if form.needs == "states" and kept != every:
        having = f"with {kept} of {every} states" if kept else "without states"
        raise ValueError(
            f"the data set was collected {having}, and the centre {form.formulation.centre!r} reads all: states=True"
        )
    steps = np.arange(episode.steps)
    rows = Rows(interface, episode.observations[:-1], episode.states[:-1], steps, [{} for _ in steps])
    given = interface.to_physical(episode.actions)
    actions = form.reverse(rows, given)
    # Actions are kept in single precision, scaled to the declared box.
    off = np.abs(form.physical(rows, actions) - given) > 1e-6 * (interface.action_high - interface.action_low)
    if off.any():
        step, which = np.argwhere(off)[0]
        raise ValueError(
            f"step {step} of the episode of seed {episode.seed} has {interface.action_names[which]} = "
            f"{given[step, which]:.6g}, which is not one of its formulation's actions"
        )
    memory: list[dict[str, Any]] = [{}]
    seen = np.concatenate([form.observe(memory, row[None]) for row in episode.observations])
    return replace(rewarded(episode, form.formulation), observations=seen, actions=actions.astype(np.float32))


def rewarded(episode: Episode, formulation: Formulation) -> Episode:
    """The episode with the rewards of the formulation."""
    failed = episode.terminations & bool(episode.failure)
    return replace(episode, rewards=formulation.reward(episode.rewards, failed))


def _ends(what: str, bounds: Any) -> tuple[float, float]:
    ends = list(bounds) if isinstance(bounds, Iterable) and not isinstance(bounds, str) else []
    if len(ends) != 2:
        raise ValueError(f"{what} is {bounds!r}, expected (low, high)")
    low, high = (as_number(what, bound) for bound in ends)
    if not (low < high and np.isfinite(low) and np.isfinite(high)):
        raise ValueError(f"{what} is {bounds!r}, expected (low, high), both finite")
    return low, high


def _centre(
    name: str, interface: Interface, low: FloatArray, high: FloatArray
) -> tuple[Callable[[Rows], FloatArray], str]:
    """Physical actions of the centre for a batch (writable), and the rows it needs.

    That is nothing, the `states` of the rows, or the `model`, which a running environment only can
    be asked.
    """
    if name == "box":
        return lambda rows: np.tile((low + high) / 2, (len(rows.steps), 1)), ""
    if name == "nominal":
        nominal = interface.model.native.defaults("action")
        return lambda rows: np.tile(nominal, (len(rows.steps), 1)), ""
    if name == "rules":
        return _rules(interface), "states"
    if name == "recipe":
        table = _recipe(interface.model)
        return lambda rows: table[np.minimum(rows.steps, len(table) - 1)], ""
    try:
        controller = named(name, interface.model)
    except ValueError as error:
        raise ValueError(f"centre is {name!r}; there are: {', '.join(_CENTRES)}, and controllers ({error})") from error
    chosen = as_policy(controller)
    if isinstance(controller, Uniform):
        raise ValueError(f"centre is {name!r}, another action each time; there are: {', '.join(_CENTRES)}, ...")
    if not chosen.batched:
        raise ValueError(
            f"centre is {name!r}, which does not act on batches; there are: {', '.join(_CENTRES)}, pid, policies of "
            "the model, ..."
        )
    env = Env(interface.model, normalize=interface.normalize)
    observation, _ = env.reset(seed=0)
    try:
        chosen.reset(env, 0)
        given = acted(chosen, Rows(env, observation[None], env.state[None], np.array([0]), [{"seed": 0}]), name)
    except ValueError as error:
        raise ValueError(f"centre is {name!r}, which does not fit {interface.model.name}: {error}") from error
    if not np.isfinite(given).all():
        raise ValueError(f"centre is {name!r}, expected finite actions")
    return lambda rows: interface.to_physical(acted(chosen, rows, name)), chosen.needs


# Policy `nominal` of the antibody process: its level rule, and the outlet concentration, mg/L, at
# which it switches.
_LEVEL, _FLOW, _GAIN, _BREAKTHROUGH = 15.0, 21.689197033088462, 50 / 180, 0.4957757365045033
_SWAP = 20


@lru_cache(maxsize=8)
def _recipe(model: Model) -> FloatArray:
    """Actions of the policy `nominal` by step, read off two episodes; shape (steps, actions)."""
    first, second = (_followed(Env(model), seed) for seed in (0, 1))
    common = min(len(first), len(second))
    # Of two equal episodes a policy that reads the state is equal too.
    if not (model.native.is_recipe("nominal") and np.array_equal(first[:common], second[:common])):
        raise ValueError(f"centre is 'recipe', but the policy 'nominal' of {model.name} depends on more than the step")
    return max(first, second, key=len)


def _followed(env: Env, seed: int) -> FloatArray:
    """Actions of an episode of the policy `nominal`."""
    env.reset(seed=seed)
    actions, ended = [], False
    while not ended:
        actions.append(env.policy("nominal"))
        _, _, terminated, truncated, _ = env.step(env.from_physical(actions[-1]))
        ended = terminated or truncated
    return np.array(actions)


def _rules(interface: Interface) -> Callable[[Rows], FloatArray]:
    model = interface.model
    try:
        level = model.state_names.index("h")
        flow, switch = model.action_names.index("F_out"), model.action_names.index("switch")
        due = _swap_is_due(model.state_names)
    except (ValueError, IndexError) as error:
        raise ValueError(
            f"centre is 'rules', which {model.name} does not have; only the antibody process and its plant have"
        ) from error
    nominal = model.native.defaults("action")

    def centre(rows: Rows) -> FloatArray:
        actions = np.tile(nominal, (len(rows.states), 1))
        actions[:, flow] = _FLOW + _GAIN * (rows.states[:, level] - _LEVEL)
        actions[:, switch] = due(rows)
        return actions

    return centre


def _swap_is_due(states: Sequence[str]) -> Callable[[Rows], Array]:
    """Swap of columns: every 20 steps in the plant, which has two, else at breakthrough."""
    if "col[1].c[1]" in states:
        return lambda rows: rows.steps % _SWAP == _SWAP - 1
    outlet = states.index([name for name in states if name.startswith("col.c[")][-1])
    return lambda rows: rows.states[:, outlet] >= _BREAKTHROUGH
