"""Environment and episodes of a plan."""

from __future__ import annotations

import hashlib
import importlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from smpl.envs import Env
from smpl.learning.agents import Agent, agent
from smpl.learning.starts import Starts
from smpl.loop import Job
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_count, as_number, check_within, elements
from smpl.support.seeds import SeedError, check_seed
from smpl.vector import VectorEnv

# Arguments of the environment that a model is compiled with; the others belong to the environment.
_COMPILED = ("scenario", "variants", "settings", "observation", "reward", "extra", "max_step")


@dataclass(frozen=True)
class Task:
    """An environment: its model and what else it is made with.

    Attributes:
        name: what it was asked for by.
        model: compiled.
        arguments: `normalize`, `dense_reward`, `max_steps` of `smpl.Env`.
    """

    name: str
    model: Model
    arguments: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, env: Any, **arguments: Any) -> Task:
        """The task of an id (`smpl/Reactor-v0`, `MODULE:ID`), a name, a path, a model or an `Env`.

        Raises:
            ValueError: an id that there is not, or of another package.
            TypeError: a wrapped environment: wrappers cannot be made again in workers.
        """
        given = {key: value for key, value in arguments.items() if value is not None}
        if isinstance(env, gymnasium.Env):
            return _of_env(env, given)
        name = _registered(env) if isinstance(env, str) else None
        if name is not None:
            spec = gymnasium.spec(name)
            if spec.entry_point != "smpl.envs:Env":
                raise ValueError(f"{env!r} is not an environment of smpl")
            given = {**spec.kwargs, **given}
            path: Any = given.pop("model")
        else:
            path = env
        compiled = {key: given.pop(key) for key in _COMPILED if key in given}
        made = Env(path, **compiled, **given)
        named = str(env) if isinstance(env, (str, Path)) else made.model.name
        return cls(named, made.model, _telling(given, made.model))

    def env(self) -> Env:
        """A new environment."""
        return Env(self.model, **self.arguments)

    def vector(self, num_envs: int, threads: int | None) -> VectorEnv:
        """A new batch without autoreset."""
        return VectorEnv(self.model, num_envs, autoreset_mode="disabled", num_threads=threads, **self.arguments)

    @property
    def checksum(self) -> str:
        """SHA-256 of the model's files, its scenario's included, and of what it was compiled with.

        Raises:
            ValueError: the files have changed since it was compiled.
        """
        if self.model.is_stale():
            raise ValueError(f"a file of {self.model.name} has changed since it was compiled: compile it again")
        digest = hashlib.sha256()
        for source in self.model.native.sources:
            digest.update(Path(source).read_bytes() if Path(source).is_file() else b"")
        compiled = {k: v for k, v in self.model._arguments.items() if k not in ("path", "scenario")}
        compiled["scenario"] = Path(str(self.model._arguments.get("scenario"))).name
        digest.update(json.dumps(compiled, sort_keys=True, default=str).encode())
        digest.update(json.dumps(self.arguments, sort_keys=True, default=str).encode())
        return digest.hexdigest()


@dataclass(frozen=True)
class Plan:
    """Episodes to run; episode i is a function of the plan and of i.

    Attributes:
        task: the environment.
        agents: who acts; each episode draws one of them.
        episodes: how many.
        seed: episode i has the seed seed + i.
        weights: shares of the agents; equal if empty.
        starts: where they start.
        noise: standard deviation of normal noise on actions, for actions scaled to [-1, 1].
        epsilon: probability that a step takes a uniformly random action.
        randomize: name of a parameter to the range that it is drawn from in each episode.
    """

    task: Task
    agents: tuple[Agent, ...]
    episodes: int
    seed: int = 0
    weights: tuple[float, ...] = ()
    starts: Starts = field(default_factory=lambda: Starts("sampled"))
    noise: float = 0.0
    epsilon: float = 0.0
    randomize: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        task: Task,
        controllers: Any,
        episodes: int,
        *,
        seed: int = 0,
        weights: Sequence[float] = (),
        starts: Any = None,
        noise: float = 0.0,
        epsilon: float = 0.0,
        randomize: Mapping[str, tuple[float, float]] | None = None,
    ) -> Plan:
        """A plan after its arguments were looked at.

        Raises:
            ValueError: an argument has an invalid value; the message names it.
        """
        given = controllers if isinstance(controllers, (list, tuple)) else [controllers]
        agents = tuple(agent(one, task.model) for one in given)
        count = as_count("episodes", episodes)
        first = check_seed(seed)
        if first is None or first + count >= 2**63:
            raise SeedError(f"seed is {seed!r}, expected an integer below 2**63 - episodes")
        env = task.env()
        for one in agents:
            env.reset(seed=first)
            try:
                one.check(env)
            except (ArithmeticError, AttributeError, LookupError, NameError) as error:
                raise ValueError(f"controller {one.name}: its reset fails: {type(error).__name__}: {error}") from error
        given_ranges = {name: _range(name, bounds) for name, bounds in (randomize or {}).items()}
        whole = elements("randomize", given_ranges, task.model.parameter_names)
        ranges = {name: given_ranges[named] for name, named in whole.items()}
        fixed = dict(task.model._arguments["settings"])
        for name, ends in ranges.items():
            check_within(f"randomize[{name!r}]", ends, name, task.model)
            if name in fixed:
                raise ValueError(f"randomize[{name!r}]: the settings of the environment fix it at {fixed[name]}")
        return cls(
            task, agents, count, first, _shares(weights, len(agents)), Starts.of(starts, env, count, first),
            _between("noise", noise, np.inf), _between("epsilon", epsilon, 1.0), ranges,
        )  # fmt: skip

    def job(self, index: int) -> Job:
        """Episode number `index`."""
        seed = self.seed + index
        options: dict[str, Any] = {}
        state = self.starts.option(index)
        if state is not None:
            options["state"] = state
        if self.randomize:
            generator = np.random.default_rng([seed, 1])
            options["parameters"] = {name: float(generator.uniform(*ends)) for name, ends in self.randomize.items()}
        shape = (
            int(self.task.arguments.get("max_steps") or self.task.model.max_steps),
            len(self.task.model.action_names),
        )
        return Job(
            index, seed, options or None, self._chosen(seed), self._shift(seed, shape), self._random(seed, shape)
        )

    def jobs(self, first: int, last: int) -> list[Job]:
        """Episodes first, ..., last - 1."""
        return [self.job(index) for index in range(first, last)]

    def _chosen(self, seed: int) -> int:
        if len(self.agents) == 1:
            return 0
        return int(np.random.default_rng([seed, 2]).choice(len(self.agents), p=self.weights))

    def _shift(self, seed: int, shape: tuple[int, int]) -> FloatArray | None:
        return np.random.default_rng([seed, 3]).normal(0.0, self.noise, shape) if self.noise else None

    def _random(self, seed: int, shape: tuple[int, int]) -> FloatArray | None:
        if not self.epsilon:
            return None
        generator = np.random.default_rng([seed, 4])
        taken = generator.uniform(size=(shape[0], 1)) < self.epsilon
        return np.where(taken, generator.uniform(-1.0, 1.0, shape), np.nan)


def _registered(env: str) -> str | None:
    """Id of a registered environment, with or without `MODULE:`; None for a name or path.

    Raises:
        ValueError: an id of smpl that there is not, or a module that cannot be imported.
    """
    module, colon, name = env.rpartition(":")
    if colon and "/" not in module and not Path(env).exists():
        try:
            importlib.import_module(module)
        except ImportError as error:
            raise ValueError(f"environment {env!r}: {error}") from error
    if name in gymnasium.registry:
        return name
    if name.startswith("smpl/"):
        known = ", ".join(one for one in gymnasium.registry if one.startswith("smpl/"))
        raise ValueError(f"there is no environment {name!r}; there are: {known}")
    return None


def _of_env(env: Any, given: dict[str, Any]) -> Task:
    if not isinstance(env.unwrapped, Env):
        raise TypeError(f"env is {type(env.unwrapped).__name__}, expected an environment of smpl")
    if given:
        raise ValueError(f"{', '.join(given)}: belongs to the environment that is given")
    inner = env
    while isinstance(inner, gymnasium.Wrapper):
        if not type(inner).__module__.startswith("gymnasium.wrappers.common"):
            raise TypeError(f"env is wrapped by {type(inner).__name__}; give the environment beneath, or its id")
        inner = inner.env
    normalize, dense, _, limit, method = env.unwrapped._options
    arguments = {"normalize": normalize, "dense_reward": dense, "max_steps": limit, "method": method}
    kept = {key: value for key, value in arguments.items() if value is not None}
    return Task(env.unwrapped.model.name, env.unwrapped.model, _telling(kept, env.unwrapped.model))


def _telling(arguments: dict[str, Any], model: Model) -> dict[str, Any]:
    """Arguments without defaults, so that equal environments have equal arguments."""
    anyway = {"normalize": True, "dense_reward": True, "info_state": False, "max_steps": model.max_steps}
    return {key: value for key, value in arguments.items() if key not in anyway or anyway[key] != value}


def _shares(weights: Sequence[float], count: int) -> tuple[float, ...]:
    shares = [as_number("weights", weight) for weight in weights] or [1.0] * count
    if len(shares) != count or not all(np.isfinite(share) and share >= 0 for share in shares) or not sum(shares):
        raise ValueError(f"weights is {list(weights)}, expected {count} numbers >= 0, one a controller")
    return tuple(share / sum(shares) for share in shares)


def _between(name: str, value: float, most: float) -> float:
    number = as_number(name, value)
    if not (0 <= number <= most and np.isfinite(number)):
        raise ValueError(f"{name} is {value!r}, expected a number from 0 to {most}")
    return number


def _range(name: str, bounds: Any) -> tuple[float, float]:
    low, high = (as_number(f"randomize[{name!r}]", bound) for bound in bounds)
    if not (np.isfinite(low) and np.isfinite(high) and low <= high):
        raise ValueError(f"randomize[{name!r}] is {bounds!r}, expected (low, high), both finite")
    return low, high
