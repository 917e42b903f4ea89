"""The record of an episode, and its assembly from the instants of one environment or a batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.envs import Env
from smpl.support.arguments import FloatArray
from smpl.support.scaling import from_unit
from smpl.vector import VectorEnv

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class Details:
    """Record of an episode in addition to its transitions.

    Attributes:
        physical: (T, actions), actions in physical units, as they arrived beneath all wrappers.
        rewards: every declared reward by name, (T,).
        violations: of each constraint by name, (T + 1,).
        discrete: discrete variables by name, (T + 1,).
        disturbances: by name, in force during each step, (T,).
        phases: name of the phase, T + 1; empty for a model without a schedule.
        parameters: by name, those of the episode that differ from the model's, and those that the
            caller asked for; of a data set, those that it keeps.
        controller: its name.
        readings: (T + 1, observations), in physical units, as the model showed them beneath all
            wrappers; None for an episode of a data set.
    """

    physical: FloatArray
    rewards: dict[str, FloatArray]
    violations: dict[str, FloatArray]
    discrete: dict[str, FloatArray]
    disturbances: dict[str, FloatArray]
    phases: tuple[str, ...]
    parameters: dict[str, float]
    controller: str
    readings: FloatArray | None = None


@dataclass(frozen=True)
class Episode:
    """One episode of T steps; arrays of T + 1 rows start with the state of the reset.

    Attributes:
        seed: seed of the reset, if one was given.
        observations: (T + 1, observations), as the environment returned them.
        states: (T + 1, states), physical units; without columns where they were not kept.
        actions: (T, actions), elements of the action space, in its precision.
        rewards, terminations, truncations: (T,).
        costs, times: (T + 1,).
        failure: empty where there was none.
        success: whether a success condition ended it.
        options: those of the reset. With them, the seed and the actions the episode is the same
            again, bit for bit.
        details: the rest of the record; None for an episode that was imported.
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
    details: Details | None = None

    @property
    def steps(self) -> int:
        """Number of steps."""
        return len(self.rewards)

    @property
    def total(self) -> float:
        """Sum of the rewards."""
        return float(self.rewards.sum())

    @property
    def applied(self) -> FloatArray | None:
        """`details.physical`; None without details."""
        return None if self.details is None else self.details.physical

    @property
    def readings(self) -> FloatArray | None:
        """`details.readings`; None without details."""
        return None if self.details is None else self.details.readings


@dataclass(slots=True)
class Frame:
    """Values at one instant, one row per environment; those of a step are None at a reset.

    Attributes:
        shown: observations of the model beneath all wrappers.
        action: argument of the environment; physical: as it arrived, None if scaling gives it.
    """

    observation: Array
    shown: Array
    states: FloatArray | None
    discrete: FloatArray
    disturbance: FloatArray
    time: FloatArray
    cost: FloatArray
    violations: FloatArray
    rewards: FloatArray
    failure: Sequence[str] | None
    success: Array
    phase: Sequence[int] | None
    action: Array | None = None
    physical: FloatArray | None = None
    reward: FloatArray | None = None
    terminated: Array | None = None
    truncated: Array | None = None

    def only(self, place: int) -> Frame:
        """A frame of one environment."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        cut: dict[str, Any] = {name: None if v is None else v[place : place + 1] for name, v in values.items()}
        return Frame(**cut)


def episode_of(
    interface: Env | VectorEnv,
    seed: int | None,
    options: dict[str, Any] | None,
    controller: str,
    start: Frame,
    frames: Sequence[Frame],
    place: int,
    kept: Sequence[str],
) -> Episode:
    """The episode that began with `start` and went on in row `place` of the frames."""

    def steps(name: str) -> Array:
        return np.array([getattr(frame, name)[place] for frame in frames])

    def instants(name: str) -> Array:
        return np.array([getattr(start, name)[0], *(getattr(frame, name)[place] for frame in frames)])

    model, last = interface.model, frames[-1]
    actions, rewards, violations = steps("action"), steps("rewards"), instants("violations")
    discrete, disturbances, readings = instants("discrete"), steps("disturbance"), instants("shown").astype(np.float64)
    if interface.normalize:
        readings = from_unit(readings, interface.observation_low, interface.observation_high)
    details = Details(
        interface.to_physical(actions) if last.physical is None else steps("physical"),
        {name: rewards[:, i] for i, name in enumerate(model.reward_names)},
        {name: violations[:, i] for i, name in enumerate(interface.constraint_names)},
        {name: discrete[:, i] for i, name in enumerate(model.discrete_names)},
        {name: disturbances[:, i] for i, name in enumerate(model.disturbance_names)},
        tuple(model.phases[phase] for phase in instants("phase")) if model.phases else (),
        _parameters(interface, place, kept),
        controller,
        readings,
    )
    return Episode(
        seed,
        instants("observation"),
        instants("states") if start.states is not None else np.empty((len(frames) + 1, 0)),
        actions,
        steps("reward"),
        steps("terminated"),
        steps("truncated"),
        instants("cost"),
        instants("time"),
        "" if last.failure is None else str(last.failure[place]),
        bool(last.success[place]),
        options,
        details,
    )


def _parameters(interface: Env | VectorEnv, place: int, kept: Sequence[str]) -> dict[str, float]:
    """Parameters of the episode: those that differ from the model's, and those that are kept."""
    names, values = interface.model.parameter_names, interface._native.values("parameter")
    own = values if isinstance(interface, Env) else values[place]
    different = set(np.flatnonzero(own != interface.model.native.defaults("parameter")).tolist())
    different |= {names.index(name) for name in kept}
    return {names[one]: float(own[one]) for one in sorted(different)}
