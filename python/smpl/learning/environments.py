"""Environments of learners: a wrapper, a batch, and curricula of parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from smpl._native import SimulationError
from smpl.envs import Env
from smpl.learning.formulation import Form, Formulation
from smpl.policies import Rows
from smpl.support.arguments import as_number, as_vector, check_names, check_within
from smpl.vector import AutoresetMode, StepResult, VectorEnv, parse_autoreset_mode

Array = npt.NDArray[Any]


class Curriculum:
    """Parameters with ranges that move during training; each episode draws from them.

    Args:
        stages: name of a parameter to its stages (progress, low, high), progress from 0 to 1 and
            rising; between two stages both ends move linearly.

    Raises:
        ValueError: invalid stages.

    Example:
        >>> Curriculum({"spread": [(0.0, 0.05, 0.05), (0.5, 0.3, 0.3)]}).ranges(0.25)
        {'spread': (0.175, 0.175)}
    """

    def __init__(self, stages: Mapping[str, Sequence[Sequence[float]]]) -> None:
        self.stages = {name: np.array([_stage(name, one) for one in given]) for name, given in stages.items()}
        for name, table in self.stages.items():
            if (
                not len(table)
                or np.any(np.diff(table[:, 0]) <= 0)
                or not np.all((table[:, 0] >= 0) & (table[:, 0] <= 1))
            ):
                raise ValueError(f"curriculum[{name!r}]: the progress of the stages must rise from 0 to 1 at most")

    def ranges(self, progress: float) -> dict[str, tuple[float, float]]:
        """The range of each parameter at a progress from 0 to 1."""
        return {
            name: (
                float(np.interp(progress, table[:, 0], table[:, 1])),
                float(np.interp(progress, table[:, 0], table[:, 2])),
            )
            for name, table in self.stages.items()
        }

    def draw(self, progress: float, generator: np.random.Generator) -> dict[str, float]:
        """Parameters of an episode."""
        return {name: float(generator.uniform(*ends)) for name, ends in self.ranges(progress).items()}


def _stage(name: str, given: Sequence[float]) -> tuple[float, float, float]:
    try:
        progress, low, high = (as_number(f"curriculum[{name!r}]", number) for number in given)
    except (TypeError, ValueError) as error:
        raise ValueError(f"curriculum[{name!r}] has the stage {given!r}, expected (progress, low, high)") from error
    if low > high:
        raise ValueError(f"curriculum[{name!r}] has the stage {given!r}, expected low <= high")
    return progress, low, high


class Formulated(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment in a formulation; its process and `info` stay as they are.

    Args:
        env: an environment of smpl.
        formulation: or a mapping of its attributes.

    Attributes:
        form: the formulation in this environment.

    Raises:
        TypeError: another environment.
        ValueError: the formulation does not fit.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], formulation: Formulation | Mapping[str, Any]) -> None:
        super().__init__(env)
        base = env.unwrapped
        if not isinstance(base, Env):
            raise TypeError(f"Formulated wraps environments of smpl, got {type(base).__name__}")
        self._base, self.form = base, Form(Formulation.of(formulation), base)
        self.observation_space = self.form.observation_space(base.observation_space)
        self.action_space = self.form.action_space()
        self._memory: dict[str, Any] = {}
        self._observation: Array | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; as of the environment."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._memory = {"seed": int(self._base.episode[0])}
        return self._seen(observation), info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Apply an action of the formulation.

        Raises:
            ValueError: the action has a wrong shape or is NaN; nothing is stepped then.
            SimulationError: the episode is over, or has not begun.
        """
        observation, reward, terminated, truncated, info = self.env.step(self.action(action))
        given = self.form.formulation.reward(np.asarray(reward), np.asarray(bool(info["failure"])))
        return self._seen(observation), float(given), terminated, truncated, info

    def action(self, action: Any) -> Array:
        """The action of the environment beneath.

        Raises:
            ValueError: a wrong shape.
            SimulationError: no episode has begun.
        """
        given = as_vector("action", action, len(self.form.learned))
        physical = self.form.physical(self._current(), given[None])
        return self._base.from_physical(physical[0]).astype(np.float32)

    def reverse_action(self, action: Any) -> Array:
        """The action of the formulation nearest to one of the environment beneath."""
        given = as_vector("action", action, len(self._base.action_names))
        return self.form.reverse(self._current(), self._base.to_physical(given)[None])[0]

    def _seen(self, observation: Array) -> Array:
        self._observation = observation
        return self.form.observe([self._memory], observation[None])[0]

    def _current(self) -> Rows:
        base = self._base
        if self._observation is None:
            raise SimulationError("no episode has begun: call reset first")
        return Rows(base, self._observation[None], base.state[None], np.array([base.steps]), [self._memory])


class FormulatedVectorEnv(VectorEnv):
    """A native batch in a formulation, with a curriculum where there is one.

    Args:
        model, num_envs, arguments: as of `smpl.VectorEnv`.
        formulation: or a mapping of its attributes.
        curriculum: parameters that move with `progress`; needs same-step autoreset.

    Attributes:
        progress: from 0 to 1, set by who trains; anything else is a ValueError.

    Raises:
        ValueError: an invalid argument.
    """

    def __init__(
        self,
        model: Any,
        num_envs: int = 1,
        *,
        formulation: Formulation | Mapping[str, Any] | None = None,
        curriculum: Curriculum | Mapping[str, Any] | None = None,
        autoreset_mode: AutoresetMode | str = "next_step",
        **arguments: Any,
    ) -> None:
        mode = parse_autoreset_mode(autoreset_mode)
        self.curriculum = Curriculum(curriculum) if isinstance(curriculum, Mapping) else curriculum
        if self.curriculum is not None and mode != AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode is {mode.name}, a curriculum needs SAME_STEP")
        native = AutoresetMode.DISABLED if self.curriculum is not None else mode
        super().__init__(model, num_envs, autoreset_mode=native, **arguments)
        if self.curriculum is not None:
            check_names("curriculum", self.curriculum.stages, self.model.parameter_names)
            for name, table in self.curriculum.stages.items():
                for _, low, high in table.tolist():
                    check_within(f"a stage of curriculum[{name!r}]", (low, high), name, self.model)
            self.autoreset_mode, self.metadata = mode, {**self.metadata, "autoreset_mode": mode}
        self.progress = 0.0
        self.form = Form(Formulation.of(formulation), self)
        self.single_observation_space = self.form.observation_space(self.single_observation_space)
        self.single_action_space = self.form.action_space()
        batch = gymnasium.vector.utils.batch_space
        self.observation_space = batch(self.single_observation_space, num_envs)
        self.action_space = batch(self.single_action_space, num_envs)
        self._memory: list[dict[str, Any]] = [{} for _ in range(num_envs)]
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._ended = np.zeros(num_envs, dtype=np.bool_)
        self._draws = np.random.default_rng(0)

    @property
    def progress(self) -> float:
        """Share of the training that is done, from 0 to 1."""
        return self._progress

    @progress.setter
    def progress(self, value: float) -> None:
        number = as_number("progress", value)
        if not 0.0 <= number <= 1.0:
            raise ValueError(f"progress is {value!r}, expected a number from 0 to 1")
        self._progress = number

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Starts episodes as `smpl.VectorEnv`; a seed also repeats the curriculum's parameters."""
        if seed is not None:
            first = seed if isinstance(seed, (int, np.integer)) else next((s for s in seed if s is not None), 0)
            self._draws = np.random.default_rng([int(first), 6])
        chosen = self._reset_mask((options or {}).get("reset_mask"))
        observations, infos = super().reset(seed=seed, options=options)
        if self.curriculum is not None:
            observations = self._by_curriculum(chosen, observations)
        return self._begun(chosen, observations), infos

    def step(self, actions: npt.ArrayLike) -> StepResult:
        """Step all with actions of the formulation.

        Raises:
            ValueError: wrong shape or a NaN action.
        """
        given, expected = np.asarray(actions), (self.num_envs, len(self.form.learned))
        if given.shape != expected:
            raise ValueError(f"actions has shape {given.shape}, expected {expected}")
        own = self.from_physical(self.form.physical(self.rows, given)).astype(np.float32)
        observations, rewards, terminated, truncated, infos = super().step(own)
        done = terminated | truncated
        rewards = self.form.formulation.reward(rewards, _failed(terminated, infos))
        if self.curriculum is not None and done.any():
            observations = self._restart(done, observations, infos)
        same = self.autoreset_mode == AutoresetMode.SAME_STEP
        fresh = done if same else self._ended & (self.autoreset_mode == AutoresetMode.NEXT_STEP)
        if same and done.any():
            self._finish(done, infos)
        self._ended = done
        self._steps += 1
        return self._begun(fresh, observations), rewards, terminated, truncated, infos

    @property
    def rows(self) -> Rows:
        """Inputs of the centre at the coming step, with the observations of the process."""
        return Rows(self, self._observations, self.state, self._steps, self._memory)

    def _begun(self, fresh: Array, observations: Array) -> Array:
        """The observations of the formulation; `fresh` ones are the first of an episode."""
        for i in np.flatnonzero(fresh):
            self._memory[i] = {"seed": int(i)}
        self._steps[fresh] = 0
        self._observations = observations
        return self.form.observe(self._memory, observations)

    def _finish(self, done: Array, infos: dict[str, Any]) -> None:
        """Give the last observations of ended episodes what came before them."""
        for i in np.flatnonzero(done):
            last = infos["final_obs"][i]
            infos["final_obs"][i] = self.form.observe([self._memory[i]], last[None])[0]

    def _restart(self, done: Array, observations: Array, infos: dict[str, Any]) -> Array:
        """Same-step autoreset with the parameters of the curriculum."""
        final = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(done):
            final[i] = observations[i].copy()
        last = {key: value for key, value in infos.items() if not key.startswith("final_")}
        infos.update(final_obs=final, _final_obs=done.copy(), final_info=last, _final_info=done.copy())
        return self._by_curriculum(done, observations)

    def _by_curriculum(self, chosen: Array, observations: Array) -> Array:
        assert self.curriculum is not None
        result = observations.copy()
        for i in np.flatnonzero(chosen):
            mask = np.zeros(self.num_envs, dtype=np.bool_)
            mask[i] = True
            options = {"parameters": self.curriculum.draw(self.progress, self._draws), "reset_mask": mask}
            result[i] = super().reset(options=options)[0][i]
        return result


def _failed(terminated: Array, infos: dict[str, Any]) -> Array:
    """Mask of the steps that have ended in a failure."""
    texts = infos["final_info"]["failure"] if "final_info" in infos else infos["failure"]
    return terminated & (texts != "")
