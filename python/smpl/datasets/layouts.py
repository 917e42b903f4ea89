"""Episodes as rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.episodes import Episode
from smpl.support.arguments import FloatArray

Float32Array = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]


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

    Row t holds observation t, the action chosen from it, and the reward and flags received before
    it (0 and false in row 0). The last row holds the final observation and an unused action.
    `terminals` is set at time-outs too.
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
        joined([e.observations[:-1] for e in episodes]),
        joined([e.actions for e in episodes]),
        joined([e.rewards for e in episodes]),
        joined([e.observations[1:] for e in episodes]),
        joined([e.terminations for e in episodes]),
        joined([e.truncations for e in episodes]),
        _numbers(episodes, extra=0),
    )


def legacy_rows(episodes: Sequence[Episode]) -> LegacyRows:
    """Episodes in the original's layout."""
    return LegacyRows(
        joined([e.observations for e in episodes]),
        joined([np.concatenate([e.actions, e.actions[-1:]]) for e in episodes]),
        joined([np.concatenate([[0.0], e.rewards]) for e in episodes]),
        joined([np.concatenate([[False], e.terminations | e.truncations]) for e in episodes]),
        joined([np.concatenate([[False], e.truncations]) for e in episodes]),
        _numbers(episodes, extra=1),
    )


def joined(parts: Sequence[npt.NDArray[Any]]) -> Any:
    """Arrays one after the other; of no episodes nothing can be made."""
    if not parts:
        raise ValueError("episodes is empty, expected one at least")
    return np.concatenate(parts, axis=0)


def _numbers(episodes: Sequence[Episode], extra: int) -> npt.NDArray[np.int64]:
    return np.repeat(np.arange(len(episodes)), [e.steps + extra for e in episodes])
