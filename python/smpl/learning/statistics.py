"""Statistics of returns: interquartile means, bootstrap intervals, probability of improvement.

After Agarwal et al., Deep reinforcement learning at the edge of the statistical precipice (NeurIPS
2021), section 4. The interquartile mean discards the lowest and the highest quarter of the values.
Intervals are percentiles of bootstrap replicates. The probability of improvement is that of the
Mann-Whitney statistic.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from smpl.support.arguments import FloatArray

Statistic = Callable[[FloatArray], FloatArray]
# Replicates of the bootstrap, and the most numbers that are drawn at a time.
RESAMPLES = 2000
_CHUNK = 2**22


def mean(values: FloatArray) -> FloatArray:
    """Mean along the last axis."""
    return np.mean(values, axis=-1)


def interquartile_mean(values: npt.ArrayLike) -> FloatArray:
    """Mean of the middle half along the last axis; cuts a quarter at each end, rounded down."""
    array = np.asarray(values, dtype=np.float64)
    count = array.shape[-1]
    cut = count // 4
    if cut == 0:
        return np.mean(array, axis=-1)
    middle = np.partition(array, (cut, count - cut - 1), axis=-1)[..., cut : count - cut]
    return np.mean(middle, axis=-1)


def bootstrap(
    values: npt.ArrayLike,
    statistic: Statistic = mean,
    confidence: float = 0.95,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> tuple[float, float]:
    """Percentile bootstrap interval of a statistic of independent values; NaN for none.

    Args:
        values: shape (values,).
        statistic: works along the last axis.
        confidence: of the interval.
        resamples: replicates.
        seed: the same interval for the same values.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.size == 0:
        return float("nan"), float("nan")
    generator = np.random.default_rng(seed)
    rows = max(1, _CHUNK // array.size)
    replicates = []
    for first in range(0, resamples, rows):
        shape = (min(rows, resamples - first), array.size)
        replicates.append(statistic(array[generator.integers(0, array.size, shape)]))
    tail = (1 - confidence) / 2
    low, high = np.quantile(np.concatenate(replicates), [tail, 1 - tail])
    return float(low), float(high)


def probability_of_improvement(values: npt.ArrayLike, others: npt.ArrayLike) -> float:
    """Probability that one of `values` exceeds one of `others`; ties count half; NaN if empty."""
    x, y = np.asarray(values, dtype=np.float64), np.sort(np.asarray(others, dtype=np.float64))
    if not x.size or not y.size:
        return float("nan")
    below, not_above = np.searchsorted(y, x, side="left"), np.searchsorted(y, x, side="right")
    return float(np.mean(below + not_above) / (2 * y.size))
