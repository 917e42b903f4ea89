"""Data sets for other packages: Minari, d3rlpy, D4RL (as a dictionary and as HDF5) and torch."""

from __future__ import annotations

import copy
import json
import os
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.envs.registration import EnvSpec

from smpl.datasets.layouts import Float32Array, joined
from smpl.datasets.loading import Dataset
from smpl.envs import Env
from smpl.episodes import Episode
from smpl.learning.plan import Task
from smpl.support.optional import load
from smpl.support.seeds import native_seed

if TYPE_CHECKING:
    from d3rlpy.dataset import MDPDataset

Array = npt.NDArray[Any]
# Steps that Minari's environment is tried on.
_REPEATED = 10
_D4RL = ("observations", "actions", "rewards", "next_observations", "terminals", "timeouts")


def to_d4rl(episodes: Iterable[Episode]) -> dict[str, Array]:
    """Episodes as the dictionary of D4RL: one row a step, single precision.

    `terminals` is set where the process has ended, `timeouts` where the time limit has; never both
    in one row. `next_observations` is there so that no reader has to shift rows.

    Raises:
        ValueError: there are no episodes.
    """
    rows = [d4rl_rows(episode) for episode in episodes]
    return {key: joined([row[key] for row in rows]) for key in _D4RL}


def d4rl_rows(episode: Episode) -> dict[str, Array]:
    """The rows of one episode, see `to_d4rl`."""
    return {
        "observations": episode.observations[:-1].astype(np.float32),
        "actions": episode.actions.astype(np.float32),
        "rewards": episode.rewards.astype(np.float32),
        "next_observations": episode.observations[1:].astype(np.float32),
        "terminals": episode.terminations.astype(np.bool_),
        "timeouts": (episode.truncations & ~episode.terminations).astype(np.bool_),
    }


def to_hdf5(episodes: Iterable[Episode], path: str | os.PathLike[str]) -> Path:
    """Writes episodes as an HDF5 file in the layout of D4RL (extra `minari`, for h5py).

    Raises:
        ImportError: h5py is missing.
        ValueError: there are no episodes.
    """
    h5py = load("h5py", "this export")
    target = Path(path)
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        with h5py.File(temporary, "w") as file:
            for episode in episodes:
                for key, rows in d4rl_rows(episode).items():
                    _append(file, key, rows)
            if not len(file):
                raise ValueError("episodes is empty, expected one at least")
            if isinstance(episodes, Dataset):
                file.attrs["smpl"] = description(episodes)
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)
    return target


def _append(file: Any, key: str, rows: Array) -> None:
    if key not in file:
        file.create_dataset(key, data=rows, maxshape=(None, *rows.shape[1:]), chunks=True, compression="gzip")
        return
    before = file[key].shape[0]
    file[key].resize(before + len(rows), axis=0)
    file[key][before:] = rows


def to_torch(episodes: Iterable[Episode], folder: str | os.PathLike[str] | None = None) -> Any:
    """`TensorDataset` of torch: observation, action, reward, next observation, terminated.

    Args:
        episodes: the episodes.
        folder: keep the tensors in files there and map them into memory, for what exceeds it.

    Raises:
        ImportError: torch is missing.
    """
    torch = load("torch", "this export")
    keys = ("observations", "actions", "rewards", "next_observations", "terminals")
    if folder is None:
        arrays = to_d4rl(episodes)
        return torch.utils.data.TensorDataset(
            *(torch.from_numpy(np.asarray(arrays[key], dtype=np.float32)) for key in keys)
        )
    mapped = memory_mapped(episodes, folder, keys)
    return torch.utils.data.TensorDataset(*(torch.from_numpy(mapped[key]) for key in keys))


def memory_mapped(
    episodes: Iterable[Episode], folder: str | os.PathLike[str], keys: Sequence[str] = _D4RL
) -> dict[str, Array]:
    """The columns of `to_d4rl` as `float32` arrays in files (`KEY.f32`), mapped into memory.

    Raises:
        ValueError: there are no episodes.
    """
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    files = {key: (place / f"{key}.f32").open("wb") for key in keys}
    shapes: dict[str, tuple[int, ...]] = {}
    try:
        for episode in episodes:
            for key, rows in d4rl_rows(episode).items():
                if key in files:
                    files[key].write(np.ascontiguousarray(rows, dtype=np.float32).tobytes())
                    shapes[key] = (shapes.get(key, (0,))[0] + len(rows), *rows.shape[1:])
    finally:
        for file in files.values():
            file.close()
    if not shapes:
        raise ValueError("episodes is empty, expected one at least")
    return {key: np.memmap(place / f"{key}.f32", np.float32, "r+", shape=shapes[key]) for key in keys}


def to_d3rlpy(episodes: Iterable[Episode]) -> MDPDataset:
    """Episodes as a data set of d3rlpy (extra `d3rlpy`).

    d3rlpy drops the last transition of a truncated episode, since it has no next observation. Such
    an episode gets one more row with the final observation, zero action and reward, and the
    time-out is marked on it.

    Raises:
        ImportError: d3rlpy is missing.
    """
    return load("d3rlpy.dataset", "this export").MDPDataset(**d3rlpy_arrays(episodes))


def d3rlpy_arrays(episodes: Iterable[Episode]) -> dict[str, Float32Array]:
    """Arguments of d3rlpy's `MDPDataset`, see `to_d3rlpy`."""
    parts: dict[str, list[npt.NDArray[Any]]] = {
        key: [] for key in ("observations", "actions", "rewards", "terminals", "timeouts")
    }
    for episode in episodes:
        extra = 0 if episode.terminations[-1] else 1
        flags = np.zeros(episode.steps + extra)
        terminals, timeouts = flags.copy(), flags.copy()
        (timeouts if extra else terminals)[-1] = 1
        parts["observations"].append(episode.observations[: episode.steps + extra])
        parts["actions"].append(np.concatenate([episode.actions, np.zeros((extra, episode.actions.shape[1]))]))
        parts["rewards"].append(np.concatenate([episode.rewards, np.zeros(extra)]))
        parts["terminals"].append(terminals)
        parts["timeouts"].append(timeouts)
    return {key: joined(values).astype(np.float32) for key, values in parts.items()}


def to_minari(identifier: str, episodes: Iterable[Episode], env: Any, **texts: Any) -> Any:
    """Write episodes as a Minari data set (extra `minari`) and return it.

    Args:
        identifier: such as `smpl/reactor/nmpc-v0`.
        episodes: the episodes, each complete.
        env: the environment, its id or specification, a model's name or the path of one.
            Its time limit is stored as `max_episode_steps` of the specification.
        texts: passed on: `algorithm_name`, `author`, `author_email`, `code_permalink`,
            `description`, `ref_min_score`, `ref_max_score` (give both or none), `data_format`,
            `requirements`.

    Raises:
        ImportError: Minari is missing.
        ValueError: the data set exists, there is no such environment, or it has other observations
            or actions.

    Warns:
        UserWarning: the environment does not give the first recorded steps again, as one of another
        reward or scenario.
    """
    minari = load("minari", "this export")
    EpisodeBuffer = load("minari.data_collector.episode_buffer", "this export").EpisodeBuffer
    buffers = [
        EpisodeBuffer(
            id=index,
            # The file holds 64 bits of a seed; those that stand for a longer one begin the same
            # episode.
            seed=None if episode.seed is None else native_seed(int(episode.seed)),
            options=episode.options,
            observations=episode.observations,
            actions=episode.actions.astype(np.float32),
            rewards=episode.rewards,
            terminations=episode.terminations,
            truncations=episode.truncations,
            infos=_infos(episode),
        )
        for index, episode in enumerate(episodes)
    ]
    if not buffers:
        raise ValueError("episodes is empty, expected one at least")
    env = _described(env)
    here = gymnasium.make(env) if isinstance(env, (str, EnvSpec)) else env
    _check_spaces(here, episodes, buffers[0])
    _warn_unless_repeated(here, buffers[0])
    made = minari.create_dataset_from_buffers(identifier, buffer=buffers, env=_limited(env, here), **texts)
    if isinstance(episodes, Dataset):
        made.storage.update_metadata({"smpl": description(episodes)})
    return made


def _described(env: Any) -> Any:
    """Specification from which Minari can make the environment of a model's name or path."""
    if not isinstance(env, (str, Path)) or str(env) in gymnasium.registry:
        return env
    task = Task.of(env)
    model = str(Path(env).resolve()) if Path(env).exists() else str(env)
    return EnvSpec(f"{task.model.name}-v0", entry_point="smpl.envs:Env", kwargs={"model": model})


def _limited(env: Any, here: Any) -> Any:
    """The specification with the time limit of the environment.

    Readers such as d3rlpy's `get_minari` require the limit. Environments of smpl are registered
    without it, because their own limit counts.
    """
    spec = here.spec if not isinstance(env, EnvSpec) else env
    if spec is None or spec.max_episode_steps is not None or not isinstance(here.unwrapped, Env):
        return env
    return replace(spec, max_episode_steps=here.unwrapped.max_steps)


def _check_spaces(env: Any, episodes: Iterable[Episode], first: Any) -> None:
    """Refuse an environment whose observations or actions are not those of the episodes."""
    spaces = {"observations": (env.observation_space, first.observations), "actions": (env.action_space, first.actions)}
    for what, (space, array) in spaces.items():
        if space.shape != array.shape[1:]:
            raise ValueError(f"the episodes have {what} of shape {array.shape[1:]}, the environment {space.shape}")
    if isinstance(episodes, Dataset):
        recorded, now = episodes.manifest.about["normalize"], getattr(env.unwrapped, "normalize", None)
        if now is not None and now != recorded:
            raise ValueError(f"the episodes were recorded with normalize={recorded}, the environment has {now}")


def _warn_unless_repeated(env: Any, first: Any) -> None:
    """Say so where an environment of smpl does not give the first steps of the episodes again."""
    if not isinstance(env.unwrapped, Env) or first.seed is None:
        return
    env = copy.deepcopy(env)  # the caller's generator does not change
    try:
        observation, _ = env.reset(seed=first.seed, options=first.options)
        for k, action in enumerate(first.actions[:_REPEATED]):
            _check_observation(env.unwrapped.observation_names, observation, first.observations[k], k)
            observation, reward, *_ = env.step(action)
            if not _near(reward, first.rewards[k]):
                raise ValueError(f"step {k + 1} gives the reward {reward:.6g}, recorded is {first.rewards[k]:.6g}")
    except ValueError as error:
        warnings.warn(
            f"the environment does not repeat the episodes ({error}): "
            "give the one that they were recorded in, with its scenario, reward and other arguments",
            stacklevel=3,
        )


def _check_observation(names: Sequence[str], here: Array, there: Array, steps: int) -> None:
    """Refuse an observation that is not the recorded one.

    Raises:
        ValueError: it is not; the message names what differs.
    """
    for i, near in enumerate(_near(here, there)):
        if not near:
            name = names[i] if len(names) == len(here) else f"number {i}"
            raise ValueError(f"after {steps} steps the observation {name} is {here[i]:.6g}, recorded is {there[i]:.6g}")


def _near(here: Any, there: Any) -> Any:
    """True if values are those of the file, whose actions are in single precision."""
    return np.isclose(here, there, rtol=1e-3, atol=1e-3)


def _infos(episode: Episode) -> dict[str, Any]:
    """Costs, times, violations and rewards by name with T + 1 entries; entry 0 is the reset."""
    infos: dict[str, Any] = {"cost": episode.costs, "time": episode.times}
    if episode.details is not None:
        infos["violations"] = dict(episode.details.violations)
        infos["rewards"] = {name: np.concatenate([[0.0], v]) for name, v in episode.details.rewards.items()}
    return infos


def description(dataset: Dataset) -> str:
    """Units, bounds, versions and origin of a data set as JSON."""
    manifest = dataset.manifest
    return json.dumps({"about": manifest.about, "identity": manifest.identity, "names": manifest.names}, default=str)
