"""Vector environment: many environments of one model, stepped in threads."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.vector.utils import batch_space

from smpl import _native
from smpl.envs import Env, Interface, Observation, choose_model, raise_ended
from smpl.model import Model
from smpl.support.arguments import (
    COUNTS,
    FloatArray,
    as_count,
    as_flag,
    as_numbers,
    check_limit,
    check_method,
    check_names,
)
from smpl.support.compiling import Setting
from smpl.support.options import listed
from smpl.support.reset_options import start_from_options
from smpl.support.seeds import SeedError, check_seed, native_seed

if TYPE_CHECKING:
    from gymnasium.vector import AutoresetMode as AutoresetMode
else:
    try:
        from gymnasium.vector import AutoresetMode
    except ImportError:  # gymnasium 1.0 has none

        class AutoresetMode(Enum):
            """When a sub-environment that has ended is reset."""

            NEXT_STEP = "NextStep"
            SAME_STEP = "SameStep"
            DISABLED = "Disabled"


BoolArray = npt.NDArray[np.bool_]
# Those that every info has.
INFO_KEYS = ("time", "failure", "success", "success_name", "constraints", "cost", "rewards")
StepResult = tuple[Observation, FloatArray, BoolArray, BoolArray, dict[str, Any]]


class VectorEnv(Interface, gymnasium.vector.VectorEnv[Any, Any, Any]):
    """Environments of one model behind Gymnasium's vector interface.

    Sub-environment i of `reset(seed=s)` gives, bit for bit, what `smpl.Env` gives with seed s + i,
    for every number of environments and threads. `infos` holds arrays, each with a mask under
    `_key`; `constraints` and `rewards` are mappings to such arrays.

    Args:
        model, normalize, dense_reward, reward, observation: as for `smpl.Env`.
        scenario, variants, settings, max_steps, info_state: as for `smpl.Env`.
        method, max_step, extra: as for `smpl.Env`.
        num_envs: number of sub-environments.
        autoreset_mode: an AutoresetMode, or its name or value in any case, underscores ignored.
        num_threads: threads that step, fewer if one is faster; None for all processors.
        render_mode: must be None; a batch has no picture.
        max_episode_steps: the same as `max_steps`, under the name of `gymnasium.make_vec`.
    """

    @listed
    def __init__(
        self,
        model: Model | Interface | str | os.PathLike[str],
        num_envs: int = 1,
        *,
        normalize: bool | str = True,
        dense_reward: bool = True,
        reward: str | None = None,
        observation: str = "default",
        scenario: str | os.PathLike[str] | None = None,
        variants: Iterable[str] = (),
        settings: Mapping[str, Setting] | None = None,
        max_steps: int | None = None,
        max_episode_steps: int | None = None,
        info_state: bool = False,
        autoreset_mode: AutoresetMode | str = "next_step",
        num_threads: int | None = None,
        render_mode: str | None = None,
        method: str | None = None,
        max_step: float | None = None,
        extra: str | None = None,
    ) -> None:
        num_envs = as_count("num_envs", num_envs, below=COUNTS)
        if render_mode is not None:
            raise ValueError("a native vector environment cannot be rendered: render_mode must be None")
        compiled = choose_model(model, observation, reward, scenario, variants, settings, extra, max_step)
        self.num_envs = num_envs
        self.autoreset_mode = parse_autoreset_mode(autoreset_mode)
        self.metadata = {**Env.metadata, "autoreset_mode": self.autoreset_mode}
        self.render_mode = None
        self.single_observation_space, self.single_action_space = self._describe(compiled, normalize)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        if num_threads is not None:
            expected = "a positive integer, or 0 or None for all processors"
            num_threads = as_count("num_threads", num_threads, 0, expected, COUNTS)
        self.num_threads = num_threads or os.cpu_count() or 1
        limit = check_limit(max_episode_steps if max_steps is None else max_steps)
        mode = str(self.autoreset_mode.value)
        method = check_method(method)
        flags = self.normalize, as_flag("dense_reward", dense_reward), as_flag("info_state", info_state)
        self._options = (num_envs, *flags, limit, method, self.num_threads, mode)
        self._native = _native.Batch(compiled.native, *self._options)
        self.constraint_names = tuple(self._native.constraint_names)
        self._masked = tuple(f"_{key}" for key in INFO_KEYS)
        self._masked_constraints = tuple(f"_{name}" for name in self.constraint_names)
        self._masked_rewards = tuple(f"_{name}" for name in self.reward_names)
        self._mask_count = len(self._masked) + 2 + len(self.constraint_names) + len(self.reward_names)
        self._no_texts = np.empty(num_envs, dtype=object)
        self._no_texts.fill("")
        self._seeded = False

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start episodes in all sub-environments, or in those of `options["reset_mask"]`.

        Args:
            seed: s gives sub-environment i the seed s + i; a sequence gives each its own, where an
                entry may be None.
            options: as for `smpl.Env.reset`, the same for all; `reset_mask` is a boolean array with
                at least one True.

        Raises:
            ValueError: an unknown option or name, a wrong shape or number of seeds.
        """
        options = dict(options or {})
        mask = self._reset_mask(options.pop("reset_mask", None))
        start = self._start(options)
        one = isinstance(seed, (int, np.integer))
        super().reset(seed=check_seed(seed) if one else None)
        observations, info = self._native.reset(mask, self._given_seeds(seed), start)
        return observations, self._infos(info, self._masks(mask))

    def step(self, actions: npt.ArrayLike) -> StepResult:
        """Step all sub-environments; those that have ended are dealt with as `autoreset_mode` says.

        Raises:
            ValueError: wrong shape or a NaN action; nothing is stepped then.
            gymnasium.error.ResetNeeded: with autoreset disabled, a sub-environment that has ended
                was not reset.
        """
        expected = (self.num_envs, len(self.action_names))
        values = as_numbers("actions", actions, str(expected))
        if values.shape != expected:
            raise ValueError(f"actions has shape {values.shape}, expected {expected}")
        try:
            observations, rewards, terminated, truncated, info, final = self._native.step(values)
        except _native.SimulationError as error:
            raise_ended(error)
        infos = self._infos(info, np.ones((self._mask_count, self.num_envs), dtype=np.bool_))
        if final is not None:
            infos.update(self._final(*final))
        return observations, rewards, terminated, truncated, infos

    def close_extras(self, **kwargs: Any) -> None:
        """Nothing is left open."""

    # Copies and pickles go on where the original is, as those of `smpl.Env`.

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_native": self._native.snapshot()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._native = _native.Batch(self.model.native, *self._options)
        self._native.restore(state["_native"])

    # Access as of the vectorisers of Gymnasium.

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """The attribute for each sub-environment, or what all share.

        Values of `state`, `discrete`, `disturbance` and `parameter` are arrays. Disturbances are
        those of the last step.
        """
        if name == "state":
            return tuple(self.state)
        if name in ("discrete", "disturbance", "parameter"):
            return tuple(self._native.values(name))
        value = getattr(self, name)
        return (value,) * self.num_envs

    @property
    def state(self) -> FloatArray:
        """A copy of the differential states, physical units, shape (environments, states)."""
        return self._native.values("state")

    # Episodes and seeds.

    def policy(self, name: str) -> FloatArray:
        """Physical actions (num_envs, actions) of a policy of the model for the coming step.

        Args:
            name: one of `model.policies`.

        Raises:
            ValueError: the model declares no such policy.
        """
        return self._native.policy(name)

    def _start(self, options: Mapping[str, Any]) -> _native.Start | None:
        try:
            return start_from_options(self.model, options)
        except ValueError:
            from smpl.support.reset_options import OPTIONS

            check_names("options", options, (*OPTIONS, "reset_mask"))
            raise

    def _reset_mask(self, given: Any) -> BoolArray:
        if given is None:
            return np.ones(self.num_envs, dtype=np.bool_)
        mask = np.asarray(given)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise ValueError(
                f"options['reset_mask'] has shape {mask.shape} and type {mask.dtype}, "
                f"expected ({self.num_envs},) and bool"
            )
        if not mask.any():
            raise ValueError("options['reset_mask'] selects no environment")
        return np.array(mask, dtype=np.bool_)

    def _given_seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None] | None:
        """A seed for each sub-environment, None for its next episode; drawn at the first reset."""
        if seed is None and self._seeded:
            return None
        seeds = self._seeds(int(self.np_random.integers(2**63)) if seed is None else seed)
        self._seeded = True
        return [None if one is None else native_seed(one) for one in seeds]

    def _seeds(self, seed: Any) -> list[int | None]:
        """One for each sub-environment."""
        if isinstance(seed, str) or not isinstance(seed, (int, np.integer, Sequence, np.ndarray)):
            raise SeedError(f"seed is {seed!r}, expected an integer, None, or one of these for each environment")
        if isinstance(seed, (int, np.integer)):
            first = check_seed(seed) or 0
            return [first + i for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise ValueError(f"seed has {len(seed)} entries, expected {self.num_envs}")
        return [check_seed(one) for one in seed]

    def _final(self, ended: BoolArray, observations: Observation, info: _native.BatchInfo) -> dict[str, Any]:
        """Last observations and infos of the episodes that have ended."""
        final = np.full(self.num_envs, None, dtype=object)
        for index in np.flatnonzero(ended):
            final[index] = observations[index]
        return {
            "final_obs": final,
            "_final_obs": ended,
            "final_info": self._infos(info, self._masks(ended)),
            "_final_info": ended.copy(),
        }

    def _texts(self, given: Sequence[str] | None) -> npt.NDArray[np.object_]:
        """One text for each sub-environment, possibly empty."""
        texts = self._no_texts.copy()
        if given is not None:
            texts[:] = given
        return texts

    def _masks(self, mask: BoolArray) -> BoolArray:
        """A copy of a mask for every key of the infos."""
        return np.repeat(mask[np.newaxis], self._mask_count, axis=0)

    def _infos(self, info: _native.BatchInfo, masks: BoolArray) -> dict[str, Any]:
        """Arrays of the compiled module as Gymnasium's vector info, with a mask for each key."""
        time, success, failures, constraints, cost, rewards, state, phases, successes = info
        rows = iter(masks)
        # Rows of a fresh matrix, and so are the masks: an array for each, and one allocation for
        # all.
        violations = dict(zip(self.constraint_names, constraints, strict=True))
        violations.update(zip(self._masked_constraints, rows, strict=False))
        all_rewards = dict(zip(self.reward_names, rewards, strict=True))
        all_rewards.update(zip(self._masked_rewards, rows, strict=False))
        values: dict[str, Any] = {
            "time": time,
            "failure": self._texts(failures),
            "success": success,
            "success_name": self._texts(successes),
            "constraints": violations,
            "cost": cost,
            "rewards": all_rewards,
        }
        values.update(zip(self._masked, rows, strict=False))
        if phases is not None:
            values["phase"] = np.array([self.model.phases[phase] for phase in phases], dtype=object)
            values["_phase"] = next(rows)
        if state is not None:
            values["state"] = state
            values["_state"] = next(rows)
        return values


def make_vec(model: Model | str | os.PathLike[str], num_envs: int = 1, **arguments: Any) -> VectorEnv:
    """A vector environment of a model, a path or a name; arguments as of `VectorEnv`."""
    return VectorEnv(model, num_envs, **arguments)


def parse_autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """The mode that a member, a name or a value means; case and underscores do not matter.

    Raises:
        ValueError: there is no such mode.
    """
    if isinstance(mode, AutoresetMode):
        return mode
    plain = str(mode).replace("_", "").lower()
    for member in AutoresetMode:
        if member.value.lower() == plain:
            return member
    raise ValueError(f"autoreset_mode is {mode!r}; there are: {', '.join(m.name.lower() for m in AutoresetMode)}")
