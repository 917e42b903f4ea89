"""What is seen of environments at one instant, and the episode that a sequence of such makes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl import _native
from smpl._arguments import FloatArray
from smpl.envs import Env
from smpl.evaluation import Details, Episode
from smpl.learning.plan import Job, Plan
from smpl.vector import VectorEnv

Array = npt.NDArray[Any]


@dataclass(slots=True)
class Frame:
    """Arrays with one row an environment; those of the step are none at a reset."""

    observation: Array
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
    reward: FloatArray | None = None
    terminated: Array | None = None
    truncated: Array | None = None

    def only(self, place: int) -> Frame:
        """A frame of one environment."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        cut: dict[str, Any] = {name: None if v is None else v[place : place + 1] for name, v in values.items()}
        return Frame(**cut)


def of_batch(venv: VectorEnv, observations: Array, info: _native.BatchInfo, states: bool) -> Frame:
    """The frame of a batch after a reset or a step."""
    time, success, failures, violations, cost, rewards, _, phases, _ = info
    native = venv._native
    return Frame(
        observations,
        native.values("state") if states else None,
        native.values("discrete"),
        native.values("disturbance"),
        time,
        cost,
        violations.T,
        rewards.T,
        failures,
        success,
        phases,
    )


def of_env(env: Env, observation: Array, info: dict[str, Any], states: bool) -> Frame:
    """The frame of a single environment."""
    return Frame(
        observation[None],
        env.state[None] if states else None,
        env.discrete[None],
        env._native.values("disturbance")[None],
        np.array([info["time"]]),
        np.array([info["cost"]]),
        np.array([[info["constraints"][name] for name in env.constraint_names]]),
        np.array([[info["rewards"][name] for name in env.reward_names]]),
        [info["failure"]],
        np.array([info["success"]]),
        [env.model.phases.index(info["phase"])] if env.model.phases else None,
    )


def episode(
    plan: Plan,
    interface: Env | VectorEnv,
    job: Job,
    start: Frame,
    frames: Sequence[Frame],
    place: int,
    kept: Sequence[str],
    parameters: FloatArray,
) -> Episode:
    """The episode that began with `start` (one environment) and went on in row `place` of the frames.

    Args:
        plan, job: what it is an episode of.
        interface: its environment, for names and scaling.
        start, frames, place: where its values are.
        kept: names of the parameters to keep.
        parameters: values of all parameters.
    """

    def steps(name: str) -> Array:
        return np.array([getattr(frame, name)[place] for frame in frames])

    def instants(name: str) -> Array:
        return np.array([getattr(start, name)[0], *(getattr(frame, name)[place] for frame in frames)])

    model, last = plan.task.model, frames[-1]
    actions, rewards, violations = steps("action"), steps("rewards"), instants("violations")
    discrete, disturbances = instants("discrete"), steps("disturbance")
    details = Details(
        interface.to_physical(actions),
        {name: rewards[:, i] for i, name in enumerate(model.reward_names)},
        {name: violations[:, i] for i, name in enumerate(interface.constraint_names)},
        {name: discrete[:, i] for i, name in enumerate(model.discrete_names)},
        {name: disturbances[:, i] for i, name in enumerate(model.disturbance_names)},
        tuple(model.phases[phase] for phase in instants("phase")) if model.phases else (),
        {name: float(parameters[model.parameter_names.index(name)]) for name in kept},
        plan.agents[job.agent].name,
    )
    return Episode(
        job.seed,
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
        job.options,
        details=details,
    )
