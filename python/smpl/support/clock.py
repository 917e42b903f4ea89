"""Time limits of calls that take long."""

from __future__ import annotations

import time

from smpl.support.arguments import as_number


def as_seconds(name: str, value: float) -> float:
    """A number of seconds above 0.

    Raises:
        ValueError: it is not; the message names the argument.
    """
    if not as_number(name, value) > 0:
        raise ValueError(f"{name} is {value}, expected seconds above 0")
    return float(value)


class Clock:
    """Time since a call began, against its limit.

    Args:
        seconds: limit; none if None.
        name: of the argument that gives it.

    Raises:
        ValueError: the limit is not above 0.
    """

    def __init__(self, seconds: float | None, name: str = "seconds") -> None:
        limit = float("inf") if seconds is None else as_seconds(name, seconds)
        self._end = time.perf_counter() + limit

    def over(self) -> bool:
        """True if the limit is reached."""
        return time.perf_counter() > self._end
