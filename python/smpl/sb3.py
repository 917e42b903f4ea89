"""Stable-Baselines3 on the native vector environment (extra `sb3`).

Stable-Baselines3 has vector environments of its own kind; `SB3VecEnv` is one of them over `smpl.VectorEnv`, so that all
environments are stepped in one call without the interpreter lock.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env import VecEnv

from smpl.vector import AutoresetMode, VectorEnv


class SB3VecEnv(VecEnv):  # type: ignore[misc]
    """A vector environment of Stable-Baselines3.

    Args:
        model: a compiled model, a path or the name of a shipped model.
        num_envs: number of environments.
        arguments: as of `smpl.VectorEnv`; the mode of autoreset is same-step, as Stable-Baselines3 wants it.
    """

    def __init__(self, model: Any, num_envs: int = 1, **arguments: Any) -> None:
        self.venv = VectorEnv(model, num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **arguments)
        self.render_mode = None
        self._actions: npt.NDArray[Any] | None = None
        super().__init__(num_envs, self.venv.single_observation_space, self.venv.single_action_space)

    def reset(self) -> npt.NDArray[np.float32]:
        """Start all episodes, with the seeds and options given before, and return the observations."""
        seeds = None if all(seed is None for seed in self._seeds) else self._seeds
        given = next((options for options in self._options if options), None)
        observations, infos = self.venv.reset(seed=seeds, options=given)
        self.reset_infos = [row(infos, i) for i in range(self.num_envs)]
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
        """Infos one by one; those of ended episodes are their last ones, with the last observation."""
        result = []
        for i in range(self.num_envs):
            info = row(infos["final_info"] if done[i] else infos, i)
            info["TimeLimit.truncated"] = bool(truncated[i] and not terminated[i])
            if done[i]:
                info["terminal_observation"] = infos["final_obs"][i]
            result.append(info)
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
        """There are none."""
        return [None] * self.num_envs


def row(infos: dict[str, Any], index: int) -> dict[str, Any]:
    """The info of one environment out of those of a vector environment."""
    names: Iterable[str] = (key for key in infos if not key.startswith(("_", "final_")))
    result: dict[str, Any] = {}
    for key in names:
        value = infos[key]
        if isinstance(value, dict):
            result[key] = row(value, index)
        else:
            item = value[index]
            result[key] = item.item() if isinstance(item, np.generic) else item
    return result
