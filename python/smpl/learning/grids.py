"""Grids of initial states."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from smpl.support.arguments import FloatArray, as_count, as_number, as_numbers


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
        ValueError: no points, or an invalid centre or spread.
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
