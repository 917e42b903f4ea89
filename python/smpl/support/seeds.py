"""Seeds of episodes."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

SEEDS = 2**64


class SeedError(gymnasium.error.Error, ValueError):
    """Error of a seed that is negative or not an integer: Gymnasium's error and a ValueError."""


def check_seed(seed: Any) -> int | None:
    """The seed if it is one, or none. NumPy's integers become Python's: Gymnasium takes no others.

    Raises:
        SeedError: it is negative or not an integer.
    """
    if seed is None:
        return None
    if isinstance(seed, (bool, np.bool_)) or not isinstance(seed, (int, np.integer)):
        raise SeedError(f"seed is {seed!r}, expected an integer or None")
    if seed < 0:
        raise SeedError(f"seed is {seed}, expected an integer that is not negative")
    return int(seed)


def native_seed(seed: int) -> int:
    """The 64 bits that stand for a seed: itself where it has no more, else a hash of it."""
    return seed if seed < SEEDS else int(np.random.SeedSequence(seed).generate_state(1, np.uint64)[0])
