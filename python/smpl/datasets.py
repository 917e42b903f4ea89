"""Data sets: grids of initial states, collection, layouts, and export to Minari and d3rlpy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from smpl.envs import native_seed
from smpl.evaluation import Episode
from smpl.model import FloatArray, as_count, as_number, as_numbers

if TYPE_CHECKING:
    from d3rlpy.dataset import MDPDataset

Float32Array = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]


def initial_grid(
    centre: npt.ArrayLike,
    spread: float,
    points: int,
    low: npt.ArrayLike | None = None,
    high: npt.ArrayLike | None = None,
) -> FloatArray:
    """Full product of equally spaced values of each state, the first state varying fastest.

    Args:
        centre: set-point, shape (states,).
        spread: d; values go from (1 - d) to (1 + d) times the centre, inclusive.
        points: n values a state.
        low, high: box to clip to; none is not clipped (scenario `legacy` of the reactor).

    Returns:
        An array of shape (n ** states, states).

    Raises:
        ValueError: no points, or a centre or a spread that is none.
    """
    points = as_count("points", points)
    middle = as_numbers("centre", centre, "(states,)")
    if middle.ndim != 1 or not np.all(np.isfinite([*middle, as_number("spread", spread)])):
        raise ValueError(f"centre has shape {middle.shape} and spread is {spread!r}, expected (states,), all finite")
    axes = [np.linspace((1 - spread) * x, (1 + spread) * x, points) for x in middle]
    mesh = np.meshgrid(*reversed(axes), indexing="ij")
    grid = np.stack([coordinates.ravel() for coordinates in reversed(mesh)], axis=1)
    if low is None and high is None:
        return grid
    return np.clip(
        grid,
        -np.inf if low is None else np.asarray(low, dtype=np.float64),
        np.inf if high is None else np.asarray(high, dtype=np.float64),
    )


@dataclass(frozen=True)
class Transitions:
    """One row a step: (observation, action, reward, next observation) with the two end flags."""

    observations: Float32Array
    actions: Float32Array
    rewards: FloatArray
    next_observations: Float32Array
    terminations: BoolArray
    truncations: BoolArray
    episodes: npt.NDArray[np.int64]


@dataclass(frozen=True)
class LegacyRows:
    """Rows of the original's data sets: one more than steps in each episode.

    Row t holds observation t, the action chosen from it, and the reward and flags received before it (0 and false in
    row 0); the last row holds the final observation and an unused action. `terminals` is set at time-outs too.
    """

    observations: Float32Array
    actions: Float32Array
    rewards: FloatArray
    terminals: BoolArray
    timeouts: BoolArray
    episodes: npt.NDArray[np.int64]


def transitions(episodes: Sequence[Episode]) -> Transitions:
    """Episodes in the default layout."""
    return Transitions(
        _join([e.observations[:-1] for e in episodes]),
        _join([e.actions for e in episodes]),
        _join([e.rewards for e in episodes]),
        _join([e.observations[1:] for e in episodes]),
        _join([e.terminations for e in episodes]),
        _join([e.truncations for e in episodes]),
        _numbers(episodes, extra=0),
    )


def legacy_rows(episodes: Sequence[Episode]) -> LegacyRows:
    """Episodes in the original's layout."""
    return LegacyRows(
        _join([e.observations for e in episodes]),
        _join([np.concatenate([e.actions, e.actions[-1:]]) for e in episodes]),
        _join([np.concatenate([[0.0], e.rewards]) for e in episodes]),
        _join([np.concatenate([[False], e.terminations | e.truncations]) for e in episodes]),
        _join([np.concatenate([[False], e.truncations]) for e in episodes]),
        _numbers(episodes, extra=1),
    )


def to_d3rlpy(episodes: Sequence[Episode]) -> MDPDataset:
    """Episodes as a data set of d3rlpy (extra `d3rlpy`).

    d3rlpy drops the last transition of a truncated episode, since it has no next observation there: such an episode
    gets one more row with the final observation, zero action and reward, and the time-out is marked on it.

    Raises:
        ImportError: d3rlpy is missing.
    """
    try:
        from d3rlpy.dataset import MDPDataset
    except ImportError as error:
        raise ImportError("this export needs d3rlpy: pip install 'smpl[d3rlpy]'") from error
    return MDPDataset(**d3rlpy_arrays(episodes))


def d3rlpy_arrays(episodes: Sequence[Episode]) -> dict[str, Float32Array]:
    """Arguments of d3rlpy's `MDPDataset`, see `to_d3rlpy`."""
    parts: dict[str, list[npt.NDArray[Any]]] = {
        key: [] for key in ("observations", "actions", "rewards", "terminals", "timeouts")
    }
    for episode in episodes:
        extra = 1 if _open_ended(episode) else 0
        flags = np.zeros(episode.steps + extra)
        terminals, timeouts = flags.copy(), flags.copy()
        (timeouts if extra else terminals)[-1] = 1
        parts["observations"].append(episode.observations[: episode.steps + extra])
        parts["actions"].append(np.concatenate([episode.actions, np.zeros((extra, episode.actions.shape[1]))]))
        parts["rewards"].append(np.concatenate([episode.rewards, np.zeros(extra)]))
        parts["terminals"].append(terminals)
        parts["timeouts"].append(timeouts)
    return {key: _join(values).astype(np.float32) for key, values in parts.items()}


def to_minari(identifier: str, episodes: Sequence[Episode], env: Any, **description: Any) -> Any:
    """Write episodes as a Minari data set (extra `minari`) and return it.

    Args:
        identifier: such as `smpl/reactor/nmpc-v0`.
        episodes: the episodes, each complete.
        env: the environment or its id.
        description: passed on: `algorithm_name`, `author`, `author_email`, `code_permalink`, `description`,
            `ref_min_score`, `ref_max_score` (give both or none), `data_format`, `requirements`.

    Raises:
        ImportError: Minari is missing.
        ValueError: the data set exists.
    """
    try:
        import minari
        from minari.data_collector.episode_buffer import EpisodeBuffer
    except ImportError as error:
        raise ImportError("this export needs Minari: pip install 'smpl[minari]'") from error
    buffers = [
        EpisodeBuffer(
            id=index,
            # The file holds 64 bits of a seed; those that stand for a longer one begin the same episode.
            seed=None if episode.seed is None else native_seed(int(episode.seed)),
            options=episode.options,
            observations=episode.observations,
            actions=episode.actions.astype(np.float32),
            rewards=episode.rewards,
            terminations=episode.terminations,
            truncations=episode.truncations,
            infos={"cost": episode.costs, "time": episode.times},
        )
        for index, episode in enumerate(episodes)
    ]
    return minari.create_dataset_from_buffers(identifier, buffer=buffers, env=env, **description)


def _open_ended(episode: Episode) -> bool:
    return not bool(episode.terminations[-1])


def _join(parts: Sequence[npt.NDArray[Any]]) -> Any:
    if not parts:
        raise ValueError("episodes is empty, expected one at least")
    return np.concatenate(parts, axis=0)


def _numbers(episodes: Sequence[Episode], extra: int) -> npt.NDArray[np.int64]:
    return np.repeat(np.arange(len(episodes)), [e.steps + extra for e in episodes])
