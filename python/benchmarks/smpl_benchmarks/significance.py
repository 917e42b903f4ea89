"""Statistics over training seeds: scores are matrices (runs, tasks), one column per process.

Definitions follow R. Agarwal et al., Deep reinforcement learning at the edge of the statistical
precipice (NeurIPS 2021), as in the package `rliable`. The interquartile mean is that of all
entries. A bootstrap replicate draws runs with replacement within each task. A performance profile
is the share of entries above a threshold. The probability of improvement is the Mann-Whitney
statistic of each task, averaged over tasks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from smpl.learning.statistics import Statistic, mean, probability_of_improvement
from smpl.support.arguments import FloatArray

RESAMPLES = 2000
# Quantiles 0.975 of Student's distribution with 1, 2, ... degrees of freedom.
_STUDENT = (
    *(12.7062, 4.3027, 3.1824, 2.7764, 2.5706, 2.4469, 2.3646, 2.3060, 2.2622, 2.2281),
    *(2.2010, 2.1788, 2.1604, 2.1448, 2.1314, 2.1199, 2.1098, 2.1009, 2.0930, 2.0860),
)
Interval = tuple[float, float]


def performance_profile(scores: npt.ArrayLike, thresholds: Sequence[float]) -> FloatArray:
    """Share of the entries above each threshold."""
    entries = np.ravel(np.asarray(scores, dtype=np.float64))
    return np.array([np.mean(entries > one) for one in thresholds])


def improvement(scores: npt.ArrayLike, others: npt.ArrayLike) -> float:
    """Probability that a run of `scores` is above a run of `others`, averaged over the tasks."""
    first, second = _matrix(scores), _matrix(others)
    if first.shape[1] != second.shape[1]:
        raise ValueError(f"scores have {first.shape[1]} and {second.shape[1]} tasks, expected the same tasks")
    return float(np.mean([probability_of_improvement(*one) for one in zip(first.T, second.T, strict=True)]))


def stratified_bootstrap(
    scores: npt.ArrayLike,
    statistic: Statistic = mean,
    confidence: float = 0.95,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> Interval:
    """Percentile interval of a statistic, by a bootstrap of the runs within each task.

    Args:
        scores: shape (runs, tasks); a vector is one task.
        statistic: of all entries, along the last axis.
        confidence: of the interval.
        resamples: number of replicates.
        seed: of the draws; the same interval for the same scores.
    """
    matrix = _matrix(scores)
    generator = np.random.default_rng(seed)
    places = generator.integers(0, len(matrix), (resamples, *matrix.shape))
    drawn = matrix[places, np.arange(matrix.shape[1])].reshape(resamples, -1)
    tail = (1 - confidence) / 2
    low, high = np.quantile(statistic(drawn), [tail, 1 - tail])
    return float(low), float(high)


def student(values: npt.ArrayLike) -> Interval:
    """95 % interval of a mean by Student's distribution; infinite for one value."""
    array = np.asarray(values, dtype=np.float64)
    if len(array) < 2:
        return -math.inf, math.inf
    quantile = _STUDENT[len(array) - 2] if len(array) - 2 < len(_STUDENT) else 1.96
    half = quantile * float(array.std(ddof=1)) / math.sqrt(len(array))
    return float(array.mean()) - half, float(array.mean()) + half


def supported(differences: npt.ArrayLike) -> int:
    """Sign of a mean difference if both intervals over seeds exclude zero, otherwise 0.

    A bootstrap of three seeds cannot leave their range and is too narrow; Student's interval is
    required as well.
    """
    intervals = (stratified_bootstrap(differences), student(differences))
    if all(low > 0 for low, _ in intervals):
        return 1
    return -1 if all(high < 0 for _, high in intervals) else 0


def _matrix(scores: npt.ArrayLike) -> FloatArray:
    """Scores as (runs, tasks)."""
    array = np.asarray(scores, dtype=np.float64)
    return array[:, None] if array.ndim == 1 else array
