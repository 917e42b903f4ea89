"""Episodes and their statistics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from smpl._arguments import FloatArray, as_count
from smpl.controllers.adapt import as_player
from smpl.envs import Env, SeedError, check_seed


@dataclass(frozen=True)
class Details:
    """What a data set keeps of an episode beside its transitions.

    Attributes:
        physical: actions in physical units, (T, actions).
        rewards: every declared reward by name, (T,).
        violations: of each constraint by name, (T + 1,).
        discrete: discrete variables by name, (T + 1,).
        disturbances: by name, in force during each step, (T,).
        phases: name of the phase, T + 1; empty for a model without a schedule.
        parameters: those that are drawn or set, by name.
        controller: its name.
    """

    physical: FloatArray
    rewards: dict[str, FloatArray]
    violations: dict[str, FloatArray]
    discrete: dict[str, FloatArray]
    disturbances: dict[str, FloatArray]
    phases: tuple[str, ...]
    parameters: dict[str, float]
    controller: str


@dataclass(frozen=True)
class Given:
    """What an episode had beside its start and its actions.

    Attributes:
        parameters: those that were drawn or set, by name.
        discrete: discrete variables at the start, by name.
        disturbances: by name, in force during each step, (T,).
    """

    parameters: dict[str, float]
    discrete: dict[str, float]
    disturbances: dict[str, FloatArray]


@dataclass(frozen=True)
class Episode:
    """One episode of T steps; arrays of T + 1 rows start with the state of the reset.

    Attributes:
        seed: seed of the reset, if one was given.
        observations: (T + 1, observations), as the environment returned them.
        states: (T + 1, states), physical units; without columns where they were not kept.
        actions: (T, actions), as the environment was given them: of its action space, in its precision.
        rewards, terminations, truncations: (T,).
        costs, times: (T + 1,).
        failure: empty where there was none.
        success: whether a success condition ended it.
        options: those of the reset. With them and the seed the actions give the same episode again, bit for bit.
        applied: (T, actions), the actions in physical units, as they arrived beneath all wrappers.
        readings: (T + 1, observations), in physical units, as the model showed them beneath all wrappers.
        details: what a data set keeps beside these.
        given: parameters, discrete variables at the start and disturbances.
    """

    seed: int | None
    observations: npt.NDArray[np.float32]
    states: FloatArray
    actions: npt.NDArray[np.float32]
    rewards: FloatArray
    terminations: npt.NDArray[np.bool_]
    truncations: npt.NDArray[np.bool_]
    costs: FloatArray
    times: FloatArray
    failure: str
    success: bool
    options: dict[str, Any] | None = None
    applied: FloatArray | None = None
    readings: FloatArray | None = None
    details: Details | None = None
    given: Given | None = None

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.rewards)

    @property
    def total(self) -> float:
        """Sum of the rewards."""
        return float(self.rewards.sum())


@dataclass(frozen=True)
class Statistics:
    """Mean and population standard deviation, and over how many values."""

    mean: float
    deviation: float
    count: int

    @classmethod
    def of(cls, values: npt.ArrayLike) -> Statistics:
        """Statistics of a list of numbers; NaN for none."""
        array = np.asarray(values, dtype=np.float64)
        if array.size == 0:
            return cls(float("nan"), float("nan"), 0)
        return cls(float(array.mean()), float(array.std()), int(array.size))


def run_episode(env: Any, controller: Any, seed: int | None = None, options: dict[str, Any] | None = None) -> Episode:
    """Run an episode to its end.

    Args:
        env: an `smpl.Env`, possibly wrapped; wrappers that change actions are undone, see `smpl.wrappers.outer_action`.
        controller: chooses the actions: see `smpl.controllers.as_player`. It is reset first.
        seed, options: as for `reset`.

    Raises:
        TypeError: no environment of smpl, no controller, or a wrapper whose changes cannot be undone.
        ValueError: the controller is not for this environment, or gives an action of a wrong shape.
    """
    base = _base(env)
    player = as_player(controller)
    player.check(env)
    observation, info = env.reset(seed=seed, options=options)
    player.reset(env)
    observations, states, costs, times = [observation], [base.state], [info["cost"]], [info["time"]]
    actions, rewards, terminations, truncations = [], [], [], []
    applied, readings = [], [base.reading]
    parameters, discrete, disturbances = _own_parameters(base), base.discrete.tolist(), []
    terminated = truncated = False
    while not (terminated or truncated):
        action, physical = player.choose(env, observation)
        observation, reward, terminated, truncated, info = env.step(action)
        if env is not base and physical is not None and not info["failure"]:
            _check_arrival(base, env, action, physical)
        observations.append(observation)
        states.append(base.state)
        costs.append(info["cost"])
        times.append(info["time"])
        actions.append(action)
        applied.append(base.action)
        readings.append(base.reading)
        disturbances.append(base._native.values("disturbance"))
        rewards.append(reward)
        terminations.append(terminated)
        truncations.append(truncated)
    return Episode(
        seed,
        np.stack(observations),
        np.stack(states),
        np.stack(actions),
        np.asarray(rewards, dtype=np.float64),
        np.asarray(terminations, dtype=np.bool_),
        np.asarray(truncations, dtype=np.bool_),
        np.asarray(costs, dtype=np.float64),
        np.asarray(times, dtype=np.float64),
        info["failure"],
        info["success"],
        options,
        applied=np.stack(applied),
        readings=np.stack(readings),
        given=Given(
            parameters,
            dict(zip(base.discrete_names, discrete, strict=True)),
            dict(zip(base.model.disturbance_names, np.stack(disturbances).T, strict=True)),
        ),
    )


def _own_parameters(env: Env) -> dict[str, float]:
    """Parameters of the episode that are not the model's."""
    values, usual = env._native.values("parameter"), env.model.native.defaults("parameter")
    names = env.model.parameter_names
    return {names[place]: float(values[place]) for place in np.flatnonzero(values != usual)}


def evaluate(
    env: Any,
    controller: Any,
    episodes: int = 20,
    seed: int = 0,
    starts: Iterable[npt.ArrayLike | Mapping[str, float]] | None = None,
) -> list[Episode]:
    """Run episodes with the seeds seed, seed + 1, ..., or one from each given start.

    Args:
        env, controller: as for `run_episode`.
        episodes: how many; not used with `starts`.
        seed: of the first episode.
        starts: states to start from, as for `reset(options={"state": ...})`.

    Raises:
        ValueError: no number of episodes, no seed, or a start that is none.
    """
    as_count("episodes", episodes)
    if check_seed(seed) is None:
        raise SeedError("seed is None, expected an integer")
    if starts is not None and not isinstance(starts, Iterable):
        raise ValueError(f"starts is {starts!r}, expected states to start from")
    if starts is None:
        return [run_episode(env, controller, seed + i) for i in range(episodes)]
    return [run_episode(env, controller, seed + i, {"state": state}) for i, state in enumerate(starts)]


def pooled(episodes: Sequence[Episode]) -> Statistics:
    """Mean and population standard deviation over all steps of all episodes: the published mu_r and sigma_r."""
    return Statistics.of(np.concatenate([episode.rewards for episode in episodes]) if episodes else [])


def per_episode(episodes: Sequence[Episode], failed: float | None = None) -> Statistics:
    """Statistics over episodes of the mean of their rewards.

    Args:
        episodes: the episodes.
        failed: value of a failed episode in place of its mean, such as the error reward.
    """
    return Statistics.of(
        [failed if failed is not None and episode.failure else episode.rewards.mean() for episode in episodes]
    )


def returns(episodes: Sequence[Episode]) -> Statistics:
    """Statistics over episodes of the sum of their rewards."""
    return Statistics.of([episode.total for episode in episodes])


def _check_arrival(base: Env, env: Any, given: npt.NDArray[Any], chosen: FloatArray) -> None:
    """Refuse a wrapper that changed the action on its way although it is no `ActionWrapper`."""
    arrived = base.action
    expected = np.clip(chosen, base.action_low, base.action_high)
    width = base.action_high - base.action_low
    if not np.all(np.minimum(abs(arrived - chosen), abs(arrived - expected)) <= 1e-5 * width):
        raise TypeError(f"a wrapper of {env} changed the action {chosen} to {arrived} (given: {given})")


def _base(env: Any) -> Env:
    base = getattr(env, "unwrapped", env)
    if not isinstance(base, Env):
        raise TypeError(f"env is {type(base).__name__}, expected an environment of smpl")
    if not isinstance(env, gymnasium.Env):
        raise TypeError(
            f"env is {type(env).__name__}, which has not Gymnasium's interface: give the one inside, env.env"
        )
    return base
