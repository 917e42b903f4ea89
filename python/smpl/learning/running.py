"""Running the episodes of a plan, one by one or in a native batch; both give the same bits."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl._arguments import FloatArray
from smpl._native import SimulationError
from smpl._options import start_from_options
from smpl.envs import Env, Interface, from_unit, native_seed, to_unit
from smpl.evaluation import Episode
from smpl.learning.agents import Agent, Rows
from smpl.learning.frames import Frame, episode, of_batch, of_env
from smpl.learning.plan import Job, Plan
from smpl.vector import VectorEnv

# What is told as it is: a package that is missing, what a model has not, the disk.
_OURS = (ImportError, NotImplementedError, OSError, MemoryError)
# Environments of a batch. It does not depend on the machine: what a network gives for a row may depend on how many.
SLOTS = 64
Array = npt.NDArray[Any]


class RunError(RuntimeError):
    """An episode could not be run; the message names it."""


@dataclass
class Settings:
    """What is recorded.

    Attributes:
        states: keep the states.
        parameters: names of the parameters to keep.
        threads: of the native batch; all processors if none.
        latencies: seconds that each decision took are added here, if there is a list.
        stepped: called with the number of episode steps after each of them.
        batch: whether a native batch may be used.
    """

    states: bool = True
    parameters: tuple[str, ...] = ()
    threads: int | None = None
    latencies: list[float] | None = None
    stepped: Callable[[int], None] | None = None
    batch: bool = True


def batched(plan: Plan) -> bool:
    """Whether all agents of a plan act on a whole batch at once."""
    return all(one.batched for one in plan.agents)


def run(plan: Plan, jobs: Sequence[Job], settings: Settings) -> Iterator[tuple[Job, Episode]]:
    """Run episodes; they come in the order in which they end.

    Raises:
        RunError: an episode does not start, or its controller fails or gives an action that is none.
    """
    if settings.batch and batched(plan):
        yield from _run_batch(plan, jobs, settings)
        return
    env = plan.task.env()
    for job in jobs:
        try:
            found = _run_one(plan, env, job, settings)
        except _OURS:
            raise
        except Exception as error:
            raise _about(plan, job, error) from error
        yield job, found


def _run_one(plan: Plan, env: Env, job: Job, settings: Settings) -> Episode:
    chooser = plan.agents[job.agent]
    observation, info = env.reset(seed=job.seed, options=job.options)
    memory = {"seed": job.seed, **chooser.reset(env)}
    start, frames = of_env(env, observation, info, settings.states), []
    ended = False
    while not ended:
        begin = time.perf_counter()
        action = chooser.choose(env, observation, memory)
        if settings.latencies is not None:
            settings.latencies.append(time.perf_counter() - begin)
        given = disturbed(env, job, env.steps, action)
        observation, reward, terminated, truncated, info = env.step(given)
        frame = of_env(env, observation, info, settings.states)
        frame.action, frame.reward = given[None], np.array([reward])
        frame.terminated, frame.truncated = np.array([terminated]), np.array([truncated])
        frames.append(frame)
        ended = terminated or truncated
        if settings.stepped is not None:
            settings.stepped(1)
    parameters = env._native.values("parameter")
    return episode(plan, env, job, start, frames, 0, settings.parameters, parameters)


def _run_batch(plan: Plan, jobs: Sequence[Job], settings: Settings) -> Iterator[tuple[Job, Episode]]:
    """Run in a batch whose places take the next episode when theirs has ended."""
    batch = _Batch(plan, min(SLOTS, len(jobs)), settings)
    waiting = iter(jobs)
    for place in range(batch.size):
        batch.begin(place, next(waiting))
    while batch.running:
        for place in batch.step():
            yield batch.end(place)
            following = next(waiting, None)
            if following is not None:
                batch.begin(place, following)
            else:
                batch.leave(place)


class _Batch:
    """A native batch and the frames of what runs in it.

    Attributes:
        jobs: what runs in each place, none where nothing is recorded any more.
        starts: frame of each place's reset, and the number of the first frame after it.
        frames: the frames that running episodes still need; the first of them has the number `dropped`.
    """

    def __init__(self, plan: Plan, size: int, settings: Settings) -> None:
        self.plan, self.size, self.settings = plan, size, settings
        self.venv: VectorEnv = plan.task.vector(size, settings.threads)
        self.jobs: list[Job | None] = [None] * size
        self.starts: list[tuple[Frame, int]] = []
        self.frames: list[Frame] = []
        self.dropped = 0
        self.memory: list[dict[str, Any]] = [{} for _ in range(size)]
        self.steps = np.zeros(size, dtype=np.int64)
        self.observations, _ = self.venv.reset(seed=0)
        self.states = self.venv.state
        self.starts = [self._frame_of_nothing()] * size

    @property
    def running(self) -> int:
        """How many places have an episode."""
        return sum(job is not None for job in self.jobs)

    def begin(self, place: int, job: Job) -> None:
        """Start an episode."""
        try:
            frame = self._reset(place, job.seed, job.options)
        except (ValueError, SimulationError) as error:
            raise _about(self.plan, job, error) from error
        self.jobs[place], self.memory[place] = job, {"seed": job.seed}
        self.starts[place] = frame.only(place), self.dropped + len(self.frames)
        self._forget()

    def leave(self, place: int) -> None:
        """Leave a place without an episode: its environment runs on, unrecorded."""
        self._reset(place, 0, None)
        self.jobs[place] = None

    def step(self) -> list[int]:
        """One step of all; returns the places whose episode has ended."""
        begin = time.perf_counter()
        chosen = self._actions()
        if self.settings.latencies is not None:
            self.settings.latencies.append((time.perf_counter() - begin) / self.running)
        actions = self._disturbed(chosen)
        observations, rewards, terminated, truncated, info, _ = self.venv._native.step(actions.astype(np.float64))
        frame = of_batch(self.venv, observations, info, self.settings.states)
        frame.action, frame.reward, frame.terminated, frame.truncated = actions, rewards, terminated, truncated
        self.frames.append(frame)
        # A copy: what is recorded must not change with the resets to come.
        self.observations, self.states = observations.copy(), self.venv.state
        self.steps += 1
        ended = np.flatnonzero(terminated | truncated).tolist()
        for place in ended:
            if self.jobs[place] is None:
                self.leave(place)
        if self.settings.stepped is not None:
            self.settings.stepped(self.running)
        return [place for place in ended if self.jobs[place] is not None]

    def end(self, place: int) -> tuple[Job, Episode]:
        """The episode of a place that has ended."""
        job, (start, first) = self.jobs[place], self.starts[place]
        assert job is not None
        parameters = self.venv._native.values("parameter")[place]
        frames = self.frames[first - self.dropped :]
        kept = self.settings.parameters
        return job, episode(self.plan, self.venv, job, start, frames, place, kept, parameters)

    def _frame_of_nothing(self) -> tuple[Frame, int]:
        empty = np.zeros((1, 0))
        return Frame(empty, None, empty, empty, empty, empty, empty, empty, None, empty, None), 0

    def _reset(self, place: int, seed: int, options: dict[str, Any] | None) -> Frame:
        mask = np.zeros(self.size, dtype=np.bool_)
        mask[place] = True
        seeds: list[int | None] = [None] * self.size
        seeds[place] = native_seed(seed)
        observations, info = self.venv._native.reset(mask, seeds, start_from_options(self.venv.model, options))
        frame = of_batch(self.venv, observations, info, self.settings.states)
        self.observations[place] = observations[place]
        self.states[place] = self.venv.state[place]
        self.steps[place] = 0
        return frame

    def _forget(self) -> None:
        """Drop the frames that no running episode needs."""
        first = min(number for job, (_, number) in zip(self.jobs, self.starts, strict=True) if job is not None)
        del self.frames[: first - self.dropped]
        self.dropped = first

    def _actions(self) -> FloatArray:
        """What the agents choose, in the action space."""
        actions = np.zeros((self.size, len(self.venv.action_names)))
        who = np.array([-1 if job is None else job.agent for job in self.jobs])
        idle = self.venv.from_physical(self.venv.model.native.defaults("action"))
        actions[who < 0] = idle
        for number, chooser in enumerate(self.plan.agents):
            mine = np.flatnonzero(who == number)
            if len(mine):
                try:
                    actions[mine] = self._act(chooser, mine)
                except _OURS:
                    raise
                except Exception as error:
                    first = self.jobs[int(mine[0])]
                    assert first is not None
                    raise _about(self.plan, first, error) from error
        return actions

    def _act(self, chooser: Agent, mine: npt.NDArray[np.intp]) -> FloatArray:
        memory = [self.memory[place] for place in mine]
        seen = self.observations[mine], self.states[mine], self.steps[mine]
        return chooser.act(Rows(self.venv, *seen, memory, mine))

    def _disturbed(self, chosen: FloatArray) -> Array:
        given = chosen.astype(np.float32)
        plain = self.jobs[0] is not None and self.jobs[0].shift is None and self.jobs[0].replaced is None
        if plain and np.all(np.isfinite(chosen)):
            return given
        for place, job in enumerate(self.jobs):
            if job is not None:
                try:
                    given[place] = disturbed(self.venv, job, int(self.steps[place]), chosen[place])
                except ValueError as error:
                    raise _about(self.plan, job, error) from error
        return given


def disturbed(interface: Interface, job: Job, step: int, action: FloatArray) -> Array:
    """The action with the noise of the plan, in the precision of data sets: the same actions give the same episode.

    Raises:
        ValueError: it is not finite.
    """
    if not np.all(np.isfinite(action)):
        raise ValueError(f"the action {action} of step {step} is not finite")
    if job.shift is not None or job.replaced is not None:
        low, high = interface.action_low, interface.action_high
        scaled = to_unit(interface.to_physical(action), low, high)
        if job.shift is not None:
            scaled = np.clip(scaled + job.shift[step], -1.0, 1.0)
        if job.replaced is not None:
            scaled = np.where(np.isnan(job.replaced[step]), scaled, job.replaced[step])
        action = interface.from_physical(from_unit(scaled, low, high))
    return np.asarray(action, dtype=np.float32)


def drawn_parameters(plan: Plan) -> tuple[str, ...]:
    """Names of the parameters that differ between episodes: drawn by the model, or by the plan."""
    env = plan.task.env()
    values = []
    for seed in range(plan.seed, plan.seed + 4):
        env.reset(seed=seed)
        values.append(env._native.values("parameter"))
    varied = np.any(np.stack(values) != values[0], axis=0)
    names = zip(plan.task.model.parameter_names, varied, strict=True)
    return tuple(name for name, moves in names if moves or name in plan.randomize)


def _about(plan: Plan, job: Job, error: Exception) -> RunError:
    name, said = plan.agents[job.agent].name, str(error)
    if not isinstance(error, (ValueError, SimulationError)):
        # A fault of the controller's own: what it is, and where.
        frame = traceback.extract_tb(error.__traceback__)[-1]
        said = f"{type(error).__name__}: {error} ({Path(frame.filename).name}, line {frame.lineno})"
    return RunError(f"episode {job.index} (seed {job.seed}, controller {name}): {said}")
