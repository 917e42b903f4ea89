"""The episode loop, for one environment or a native batch.

`run_jobs` is the only place in which a policy meets an environment: evaluation, collection and the
benchmark call it. Both kinds of environment give the same bits.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import gymnasium
import numpy as np
import numpy.typing as npt

from smpl import _native
from smpl.envs import Env, Interface
from smpl.episodes import Array, Episode, Frame, episode_of
from smpl.policies import Policy, Rows
from smpl.support.arguments import FloatArray
from smpl.support.reset_options import start_from_options
from smpl.support.scaling import from_unit, to_unit
from smpl.support.seeds import native_seed
from smpl.vector import VectorEnv
from smpl.wrappers import outer_action

# Errors that are raised as they are: a missing package, a capability that a model lacks, the disk.
_OURS = (ImportError, NotImplementedError, OSError, MemoryError)


@dataclass(frozen=True)
class Job:
    """One episode to run.

    Attributes:
        index: number of the episode among those that are run.
        seed, options: as for `reset`.
        agent: number of the policy.
        shift: added to the actions, scaled to [-1, 1], (steps, actions); None without noise.
        replaced: random actions in [-1, 1] instead of those of the policy, NaN elsewhere; or None.
    """

    index: int
    seed: int | None
    options: dict[str, Any] | None
    agent: int = 0
    shift: FloatArray | None = None
    replaced: FloatArray | None = None


@dataclass
class Settings:
    """Options of the loop.

    Attributes:
        states: keep the states.
        parameters: names of the parameters to keep whatever their values.
        threads: of the native batch; all processors if None.
        latencies: list to which the seconds of each decision are added, if given.
        stepped: called with the number of episode steps after each of them.
        batch: whether several environments may run at once.
        finite: refuse actions that are not finite; otherwise the environment treats them.
    """

    states: bool = True
    parameters: tuple[str, ...] = ()
    threads: int | None = None
    latencies: list[float] | None = None
    stepped: Callable[[int], None] | None = None
    batch: bool = True
    finite: bool = True


class Stage(Protocol):
    """The environments of a loop.

    Attributes:
        size: number of environments, at most that of the episodes.
        observations, states: of the present instant, one row per environment.
        outer: argument of `Policy.reset`.
    """

    size: int
    observations: Array
    states: FloatArray
    outer: Any

    @property
    def interface(self) -> Any:
        """The `Env` or `VectorEnv` beneath all wrappers."""

    def reset(self, place: int, job: Job) -> Frame:
        """Start an episode in one environment."""

    def episode(self, job: Job) -> tuple[int, int]:
        """Seed of the episode that has begun, and its number since that seed was given."""

    def leave(self, place: int) -> None:
        """Keep an environment running that has no episode to record."""

    def actions(self, chosen: FloatArray, physical: bool, who: str) -> FloatArray:
        """Actions of a policy as elements of the action space."""

    def step(self, actions: FloatArray) -> Frame:
        """Step all environments."""


class Single:
    """One environment, in wrappers or not.

    Raises:
        TypeError: the environment is not one of smpl.
    """

    def __init__(self, env: Any, states: bool = True) -> None:
        self.size, self.outer, self._keeps = 1, env, states
        self.interface: Env = base_of(env)
        self.observations, self.states = np.empty((1, 0)), np.empty((1, 0))
        self._chosen: FloatArray | None = None

    def reset(self, place: int, job: Job) -> Frame:
        """Start an episode."""
        observation, info = self.outer.reset(seed=job.seed, options=job.options)
        return self._frame(observation, info)

    def episode(self, job: Job) -> tuple[int, int]:
        """Seed and number of the episode that has begun."""
        return self.interface.episode

    def leave(self, place: int) -> None:
        """The environment stays at the end of its last episode."""

    def actions(self, chosen: FloatArray, physical: bool, who: str) -> FloatArray:
        """Elements of the action space, of the actions of a policy."""
        expected = (len(self.interface.action_names),) if physical else self.outer.action_space.shape
        if chosen.shape[1:] != expected:
            raise ValueError(f"the policy's action has shape {chosen.shape[1:]}, expected {expected}")
        self._chosen = chosen[0] if physical else None
        return outer_action(self.outer, self.interface.from_physical(chosen[0]))[None] if physical else chosen

    def step(self, actions: FloatArray) -> Frame:
        """Step all environments."""
        # As data sets store it: the same actions give the same episode.
        action = np.asarray(actions[0], dtype=self.outer.action_space.dtype)
        observation, reward, terminated, truncated, info = self.outer.step(action)
        frame = self._frame(observation, info)
        if self.outer is not self.interface and self._chosen is not None and not info["failure"]:
            self._check_arrival(action, self._chosen)
        frame.action, frame.reward, frame.physical = action[None], np.array([reward]), self.interface.action[None]
        frame.terminated, frame.truncated = np.array([terminated]), np.array([truncated])
        return frame

    def _frame(self, observation: Any, info: dict[str, Any]) -> Frame:
        base = self.interface
        self.observations, self.states = np.asarray(observation)[None], base.state[None]
        phases = base.model.phases
        return Frame(
            self.observations,
            np.asarray(base._returned)[None],
            self.states if self._keeps else None,
            base.discrete[None],
            base._native.values("disturbance")[None],
            np.array([info["time"]]),
            np.array([info["cost"]]),
            np.array([[info["constraints"][name] for name in base.constraint_names]]),
            np.array([[info["rewards"][name] for name in base.reward_names]]),
            [info["failure"]],
            np.array([info["success"]]),
            [phases.index(info["phase"])] if phases else None,
        )

    def _check_arrival(self, given: Array, chosen: FloatArray) -> None:
        """Refuse a wrapper that changed the action although it is not an `ActionWrapper`."""
        base = self.interface
        arrived, expected = base.action, np.clip(chosen, base.action_low, base.action_high)
        width = base.action_high - base.action_low
        if not np.all(np.minimum(abs(arrived - chosen), abs(arrived - expected)) <= 1e-5 * width):
            raise TypeError(f"a wrapper of {self.outer} changed the action {chosen} to {arrived} (given: {given})")


class Batch:
    """A native batch that is reset place by place."""

    def __init__(self, venv: VectorEnv, states: bool = True) -> None:
        self.size, self.outer, self.interface, self._keeps = venv.num_envs, venv, venv, states
        self.observations, _ = venv.reset(seed=0)
        self.states = venv.state

    def reset(self, place: int, job: Job) -> Frame:
        """Start an episode."""
        assert job.seed is not None
        return self._reset(place, job.seed, job.options)

    def episode(self, job: Job) -> tuple[int, int]:
        """Seed and number of the episode that has begun."""
        assert job.seed is not None
        return job.seed, 0

    def leave(self, place: int) -> None:
        """Restart a place, whose episode is not recorded."""
        self._reset(place, 0, None)

    def _reset(self, place: int, seed: int, options: dict[str, Any] | None) -> Frame:
        venv = self.interface
        mask = np.zeros(venv.num_envs, dtype=np.bool_)
        mask[place] = True
        seeds: list[int | None] = [None] * venv.num_envs
        seeds[place] = native_seed(seed)
        observations, info = venv._native.reset(mask, seeds, start_from_options(venv.model, options))
        frame = self._frame(observations, info)
        self.observations[place] = observations[place]
        self.states[place] = venv.state[place]
        return frame.only(place)

    def actions(self, chosen: FloatArray, physical: bool, who: str) -> FloatArray:
        """Elements of the action space, of the actions of a policy."""
        expected = len(chosen), len(self.interface.action_names)
        if chosen.shape != expected:
            raise ValueError(f"{who} gave actions of shape {chosen.shape}, expected {expected}")
        return self.interface.from_physical(chosen) if physical else chosen

    def step(self, actions: FloatArray) -> Frame:
        """Step all environments."""
        given = actions.astype(np.float32)
        observations, rewards, terminated, truncated, info, _ = self.interface._native.step(given.astype(np.float64))
        frame = self._frame(observations, info)
        frame.action, frame.reward, frame.terminated, frame.truncated = given, rewards, terminated, truncated
        # A copy: what is recorded must not change with the resets to come.
        self.observations, self.states = observations.copy(), self.interface.state
        return frame

    def _frame(self, observations: Array, info: _native.BatchInfo) -> Frame:
        time, success, failures, violations, cost, rewards, _, phases, _ = info
        native = self.interface._native
        return Frame(
            observations,
            observations,
            native.values("state") if self._keeps else None,
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


@dataclass(frozen=True)
class Player:
    """A policy by its name."""

    name: str
    policy: Policy


def run_jobs(
    stage: Stage,
    players: Sequence[Any],
    jobs: Sequence[Job],
    settings: Settings,
    about: Callable[[Job, Exception], Exception] | None = None,
) -> Iterator[tuple[Job, Episode]]:
    """Run episodes; they come in the order in which they end.

    Args:
        stage: the environments; a place takes the next episode when its own has ended.
        players: `Player`, or anything with `name` and `policy`; `Job.agent` is their index.
        jobs: the episodes.
        settings: what is recorded.
        about: makes the error to raise of an episode and what went wrong in it.
    """
    loop = _Loop(stage, players, settings, about)
    waiting = iter(jobs)
    for place in range(loop.size):
        loop.begin(place, next(waiting))
    while loop.running:
        for place in loop.step():
            yield loop.end(place)
            following = next(waiting, None)
            if following is not None:
                loop.begin(place, following)
            else:
                loop.leave(place)


@dataclass
class _Place:
    """An environment of the loop, which is recorded while it has a job."""

    job: Job | None = None
    start: Frame | None = None
    first: int = 0
    memory: dict[str, Any] = field(default_factory=dict)


class _Loop:
    """The environments of a stage and the frames of what runs in them.

    Attributes:
        places: of the environments; `first` is the number of the first frame after the reset.
        frames: those that running episodes still need; the first of them has the number `dropped`.
    """

    def __init__(
        self,
        stage: Stage,
        players: Sequence[Any],
        settings: Settings,
        about: Callable[[Job, Exception], Exception] | None,
    ) -> None:
        self.stage, self.size, self.players, self.settings, self._about = stage, stage.size, players, settings, about
        self.places = [_Place() for _ in range(self.size)]
        self.frames: list[Frame] = []
        self.dropped = 0
        self.steps = np.zeros(self.size, dtype=np.int64)

    @property
    def running(self) -> int:
        """Number of environments with an episode."""
        return sum(one.job is not None for one in self.places)

    def begin(self, place: int, job: Job) -> None:
        """Start an episode."""
        with self._naming(job):
            start = self.stage.reset(place, job)
            self.players[job.agent].policy.reset(self.stage.outer, job.seed)
        seed, number = self.stage.episode(job)
        memory = {"seed": seed, "number": number}
        self.places[place] = _Place(job, start, self.dropped + len(self.frames), memory)
        self.steps[place] = 0
        self._forget()

    def leave(self, place: int) -> None:
        """Leave an environment without an episode: it runs on, unrecorded."""
        self.stage.leave(place)
        self.steps[place] = 0
        self.places[place].job = None

    def step(self) -> list[int]:
        """One step of all; returns the places whose episode has ended."""
        begin = time.perf_counter()
        chosen = self._actions()
        if self.settings.latencies is not None:
            self.settings.latencies.append((time.perf_counter() - begin) / self.running)
        given = self._disturbed(chosen)
        with self._naming(next(one.job for one in self.places if one.job is not None)):
            frame = self.stage.step(given)
        self.frames.append(frame)
        self.steps += 1
        ended = np.flatnonzero(frame.terminated | frame.truncated).tolist()  # type: ignore[operator]
        for place in ended:
            if self.places[place].job is None:
                self.leave(place)
        if self.settings.stepped is not None:
            self.settings.stepped(self.running)
        return [place for place in ended if self.places[place].job is not None]

    def end(self, place: int) -> tuple[Job, Episode]:
        """The episode of a place that has ended."""
        one = self.places[place]
        assert one.job is not None and one.start is not None
        frames = self.frames[one.first - self.dropped :]
        name, interface = self.players[one.job.agent].name, self.stage.interface
        about = one.job.seed, one.job.options, name
        return one.job, episode_of(interface, *about, one.start, frames, place, self.settings.parameters)

    def _forget(self) -> None:
        """Drop the frames that no running episode needs."""
        first = min(one.first for one in self.places if one.job is not None)
        del self.frames[: first - self.dropped]
        self.dropped = first

    def _actions(self) -> FloatArray:
        """Actions of the policies, in the action space."""
        who = np.array([-1 if one.job is None else one.job.agent for one in self.places])
        if self.size == 1:
            return self._act(self.players[int(who[0])], np.arange(1))
        interface = self.stage.interface
        actions = np.zeros((self.size, len(interface.action_names)))
        actions[who < 0] = interface.from_physical(interface.model.native.defaults("action"))
        for number, player in enumerate(self.players):
            mine = np.flatnonzero(who == number)
            if len(mine):
                actions[mine] = self._act(player, mine)
        return actions

    def _act(self, player: Any, mine: npt.NDArray[np.intp]) -> FloatArray:
        stage, job = self.stage, self.places[int(mine[0])].job
        assert job is not None
        with self._naming(job):
            memory = [self.places[place].memory for place in mine]
            seen = stage.observations[mine], stage.states[mine], self.steps[mine]
            rows = Rows(stage.interface, *seen, memory, mine)
            return stage.actions(player.policy.act(rows), player.policy.physical, player.name)

    def _disturbed(self, chosen: FloatArray) -> FloatArray:
        """Actions with the noise of their jobs, in the precision of data sets."""
        plain = all(one.job is None or (one.job.shift is None and one.job.replaced is None) for one in self.places)
        if not self.settings.finite or (plain and np.all(np.isfinite(chosen))):
            return chosen
        given = chosen.astype(np.float32).astype(np.float64)
        for place, one in enumerate(self.places):
            if one.job is not None:
                with self._naming(one.job):
                    given[place] = disturbed(self.stage.interface, one.job, int(self.steps[place]), chosen[place])
        return given

    @contextlib.contextmanager
    def _naming(self, job: Job) -> Iterator[None]:
        """Name the episode in what is raised."""
        try:
            yield
        except _OURS:
            raise
        except Exception as error:
            if self._about is None:
                raise
            raise self._about(job, error) from error


def disturbed(interface: Interface, job: Job, step: int, action: FloatArray) -> Array:
    """The action with the noise of the job, in the precision of data sets.

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


def base_of(env: Any) -> Env:
    """The environment of smpl in its wrappers.

    Raises:
        TypeError: no environment of smpl is beneath.
    """
    base = getattr(env, "unwrapped", env)
    if not isinstance(base, Env):
        raise TypeError(f"env is {type(base).__name__}, expected an environment of smpl")
    if not isinstance(env, gymnasium.Env):
        raise TypeError(
            f"env is {type(env).__name__}, which does not implement `gymnasium.Env`: pass the wrapped one, env.env"
        )
    return base
