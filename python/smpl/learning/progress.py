"""A progress bar, by tqdm where it is installed."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any


class Progress:
    """Counts episodes on the terminal with their rate and the remaining time.

    Args:
        show: whether to show anything.
        text: in front of the bar.
        total: episodes in all.
        done: how many were there before.
    """

    def __init__(self, show: bool, text: str, total: int, done: int = 0) -> None:
        self._show, self._text, self._total, self._done = show, text, total, done
        self._begun, self._shown, self._before = time.monotonic(), 0.0, done
        self._bar: Any = None
        if show:
            try:
                from tqdm import tqdm

                self._bar = tqdm(desc=text, total=total, initial=done, unit="episode", dynamic_ncols=True)
            except ImportError:
                pass

    def add(self, count: int) -> None:
        """Count episodes that are done."""
        self._done += count
        if self._bar is not None:
            self._bar.update(count)
        elif self._show and time.monotonic() - self._shown > 1:
            self._shown = time.monotonic()
            self._line()

    def _line(self) -> None:
        rate = (self._done - self._before) / max(time.monotonic() - self._begun, 1e-9)
        left = f", {(self._total - self._done) / rate:.0f} s left" if rate else ""
        print(f"{self._text}: {self._done}/{self._total}, {rate:.3g} episodes/s{left}", file=sys.stderr)

    def __enter__(self) -> Progress:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.close()
        elif self._show:
            self._line()
