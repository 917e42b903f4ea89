"""Episodes and their statistics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.episodes import Details, Episode
from smpl.loop import Job, Player, Settings, Single, run_jobs
from smpl.policies import as_policy
from smpl.support.arguments import as_count
from smpl.support.options import listed
from smpl.support.seeds import SeedError, check_seed

__all__ = [
    "Details", "Episode", "Statistics", "evaluate", "per_episode", "pooled", "returns", "run_episode",
]  # fmt: skip


@dataclass(frozen=True)
class Statistics:
    """Mean and population standard deviation, and over how many values."""

    mean: float
    deviation: float
    count: int

    @classmethod
    def of(cls, values: npt.ArrayLike) -> Statistics:
        """Statistics of a list of numbers; NaN for none."""
        array = np.asarray(values, dtype=np.float64)
        if array.size == 0:
            return cls(float("nan"), float("nan"), 0)
        return cls(float(array.mean()), float(array.std()), int(array.size))


def run_episode(env: Any, controller: Any, seed: int | None = None, options: dict[str, Any] | None = None) -> Episode:
    """Run an episode to its end.

    Args:
        env: an `smpl.Env`, possibly wrapped; wrappers that change actions are undone, see
            `smpl.wrappers.outer_action`.
        controller: chooses the actions: see `smpl.policies.as_policy`. It is reset first.
        seed, options: as for `reset`.

    Raises:
        TypeError: no environment of smpl, no controller, or a wrapper whose changes cannot be
            undone.
        ValueError: the controller is not for this environment, or gives an action of a wrong shape.
    """
    stage, policy = Single(env), as_policy(controller)
    policy.check(env)
    player = Player(type(controller).__name__, policy)
    ((_, episode),) = run_jobs(stage, [player], [Job(0, seed, options)], Settings(finite=False))
    return episode


@listed
def evaluate(
    env: Any,
    controller: Any,
    episodes: int = 20,
    seed: int = 0,
    starts: Iterable[npt.ArrayLike | Mapping[str, float]] | None = None,
) -> list[Episode]:
    """Run episodes with the seeds seed, seed + 1, ..., or one from each given start.

    Args:
        env, controller: as for `run_episode`.
        episodes: how many; not used with `starts`.
        seed: of the first episode.
        starts: states to start from, as for `reset(options={"state": ...})`.

    Raises:
        ValueError: an invalid number of episodes, seed or start.
    """
    as_count("episodes", episodes)
    if check_seed(seed) is None:
        raise SeedError("seed is None, expected an integer")
    if starts is not None and not isinstance(starts, Iterable):
        raise ValueError(f"starts is {starts!r}, expected states to start from")
    if starts is None:
        return [run_episode(env, controller, seed + i) for i in range(episodes)]
    return [run_episode(env, controller, seed + i, {"state": state}) for i, state in enumerate(starts)]


def pooled(episodes: Sequence[Episode]) -> Statistics:
    """Mean and population deviation over all steps of all episodes: published mu_r, sigma_r."""
    return Statistics.of(np.concatenate([episode.rewards for episode in episodes]) if episodes else [])


def per_episode(episodes: Sequence[Episode], failed: float | None = None) -> Statistics:
    """Statistics over episodes of the mean of their rewards.

    Args:
        episodes: the episodes.
        failed: value of a failed episode instead of its mean, such as the error reward.
    """
    return Statistics.of(
        [failed if failed is not None and episode.failure else episode.rewards.mean() for episode in episodes]
    )


def returns(episodes: Sequence[Episode]) -> Statistics:
    """Statistics over episodes of the sum of their rewards."""
    return Statistics.of([episode.total for episode in episodes])
