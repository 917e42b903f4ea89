"""Stable-Baselines3 on the native vector environment (extra `sb3`).

`SB3VecEnv` is a vector environment of Stable-Baselines3 over `smpl.VectorEnv`: one call without the
interpreter lock steps all environments.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env import VecEnv

from smpl.vector import AutoresetMode, VectorEnv


class SB3VecEnv(VecEnv):  # type: ignore[misc]
    """A vector environment of Stable-Baselines3.

    Args:
        model: a compiled model, a path, the name of a shipped model, or the id of a registered
            environment (`smpl/Reactor-v0`). Or an `smpl.VectorEnv` with same-step autoreset,
            without further arguments.
        num_envs: number of environments, 1 by default.
        arguments: as of `smpl.VectorEnv`; the mode of autoreset is same-step, as Stable-Baselines3
            requires.

    Raises:
        ValueError: an id of another package, or a vector environment that does not fit.
    """

    def __init__(self, model: Any, num_envs: int | None = None, **arguments: Any) -> None:
        self.venv = _vector(model, num_envs, arguments)
        self.render_mode = None
        self._actions: npt.NDArray[Any] | None = None
        super().__init__(self.venv.num_envs, self.venv.single_observation_space, self.venv.single_action_space)

    def reset(self) -> npt.NDArray[np.float32]:
        """Starts all episodes with the seeds and options set before; returns observations."""
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        given = next((options for options in self._options if options), None)
        observations, infos = self.venv.reset(seed=seeds, options=given)
        self.reset_infos = rows(infos)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.bool_], list[dict[str, Any]]]:
        """Step and return observations, rewards, ends and infos.

        Raises:
            RuntimeError: `step_async` was not called before.
        """
        if self._actions is None:
            raise RuntimeError("step_wait() before step_async()")
        observations, rewards, terminated, truncated, infos = self.venv.step(self._actions)
        self._actions = None
        done = terminated | truncated
        return observations, rewards.astype(np.float32), done, self._info_list(done, terminated, truncated, infos)

    def _info_list(
        self,
        done: npt.NDArray[np.bool_],
        terminated: npt.NDArray[np.bool_],
        truncated: npt.NDArray[np.bool_],
        infos: dict[str, Any],
    ) -> list[dict[str, Any]]:
        """Infos one by one; ended episodes have their last one, with the last observation."""
        result = rows(infos)
        ended = np.flatnonzero(done)
        last = rows(infos["final_info"], ended) if len(ended) else []
        for i, info in zip(ended, last, strict=True):
            result[i] = {**info, "terminal_observation": infos["final_obs"][i]}
        for info, limit in zip(result, (truncated & ~terminated).tolist(), strict=True):
            info["TimeLimit.truncated"] = limit
        return result

    def close(self) -> None:
        """Close the environments."""
        self.venv.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of each environment."""
        values = (self.render_mode,) * self.num_envs if attr_name == "render_mode" else self.venv.get_attr(attr_name)
        return [values[i] for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refused: environments of a batch share their attributes."""
        raise AttributeError(f"attributes of a native batch cannot be set one by one: {attr_name}")

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """A method of the vector environment that all share, called once."""
        value = getattr(self.venv, method_name)(*method_args, **method_kwargs)
        return [value for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        """No environment of a batch has a wrapper."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[npt.NDArray[np.uint8] | None]:
        """Returns no methods."""
        return [None] * self.num_envs


def _vector(model: Any, num_envs: int | None, arguments: dict[str, Any]) -> VectorEnv:
    """The vector environment that the arguments mean."""
    inner = getattr(model, "unwrapped", model)
    if isinstance(inner, gymnasium.vector.VectorEnv):
        if inner is not model or not isinstance(inner, VectorEnv):
            raise ValueError(f"model is {model}, expected an smpl.VectorEnv without wrappers")
        if inner.autoreset_mode != AutoresetMode.SAME_STEP:
            raise ValueError(f"autoreset_mode is {inner.autoreset_mode.name}, Stable-Baselines3 needs SAME_STEP")
        if num_envs not in (None, inner.num_envs) or arguments:
            raise ValueError("num_envs and other arguments belong to the vector environment that is given")
        return inner
    if isinstance(model, str) and model.removeprefix("smpl:") in gymnasium.registry:
        spec = gymnasium.spec(model)
        if spec.vector_entry_point != "smpl.vector:VectorEnv":
            raise ValueError(f"{model!r} is not an environment of smpl")
        arguments = {**spec.kwargs, **arguments}
        model = arguments.pop("model")
    count = 1 if num_envs is None else num_envs
    return VectorEnv(model, count, autoreset_mode=AutoresetMode.SAME_STEP, **arguments)


def rows(infos: dict[str, Any], indices: npt.NDArray[np.intp] | None = None) -> list[dict[str, Any]]:
    """The infos of a vector environment one by one, of all environments or of some."""
    names = [key for key in infos if not key.startswith(("_", "final_"))]
    columns = [_column(infos[name], indices) for name in names]
    return [dict(zip(names, values, strict=True)) for values in zip(*columns, strict=True)]


def _column(values: Any, indices: npt.NDArray[np.intp] | None) -> list[Any]:
    """A value for each environment: a number, a text, a mapping or a vector."""
    if isinstance(values, dict):
        return rows(values, indices)
    chosen = values if indices is None else values[indices]
    return list(chosen) if chosen.ndim > 1 else chosen.tolist()
