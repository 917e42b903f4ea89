"""Calls of CasADi's solvers that an interrupt or a time limit ends.

A callback stops a solver after an iteration at the time limit, or if a signal handler raises an
exception. The solver fatrop has no callback and ignores interrupts: it works in a separate thread,
in which CasADi has released the interpreter lock. The calling thread waits for it, handles signals,
and leaves it alone at the time limit; it then ends at its limit of iterations.
"""

from __future__ import annotations

import _thread
import signal
import threading
import time
from collections.abc import Callable, Mapping
from types import FrameType
from typing import Any

# Seconds between two looks at the clock, and those that a solver without a callback has after the
# time limit.
_LOOK, _GRACE = 0.2, 0.2
# Signals of which a program may have handlers; a real-time one has no name.
_SIGNALS = tuple(number for number in signal.valid_signals() if isinstance(number, signal.Signals))


class Stop:
    """Request to stop, read by the callback of a solver.

    Attributes:
        asked: the solver has to stop.
        deadline: time of `time.perf_counter` at which it has to stop.
    """

    def __init__(self) -> None:
        self.asked = False
        self.deadline = float("inf")

    def reached(self) -> bool:
        """Return whether the solver has to stop now."""
        return self.asked or time.perf_counter() > self.deadline


class Watched:
    """A solver of CasADi whose calls end at a deadline and by signals.

    Args:
        make: makes the solver from further options.
        sizes: numbers of variables, constraints and parameters of its programme.
        callback: the solver takes an iteration callback.

    Attributes:
        solver: that of CasADi.
    """

    def __init__(self, make: Callable[[Mapping[str, Any]], Any], sizes: tuple[int, int, int], callback: bool) -> None:
        self._stop = Stop()
        self._busy = _thread.allocate_lock()
        self._callback = _callback(self._stop, sizes) if callback else None
        self.solver = make({} if self._callback is None else {"iteration_callback": self._callback})

    def __call__(self, deadline: float, **arguments: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """The result and the statistics of a call.

        Args:
            deadline: time of `time.perf_counter` at which the solver stops.
            arguments: those of the solver.

        Raises:
            RuntimeError: the solver fails.
            TimeoutError: the solver did not stop at the deadline.
        """
        self._stop.asked, self._stop.deadline = False, deadline
        found = self._inline(arguments) if self._callback is not None else self._aside(deadline, arguments)
        if isinstance(found, Exception):
            raise RuntimeError(str(found)) from found
        return found, self.solver.stats()

    def _called(self, arguments: Mapping[str, Any]) -> Any:
        try:
            return self.solver(**arguments)
        except Exception as error:
            return error

    def _inline(self, arguments: Mapping[str, Any]) -> Any:
        """The result of a solver that asks the callback.

        CasADi loses an exception that the handler of a signal raises within an evaluation: it is
        kept here.
        """
        if threading.current_thread() is not threading.main_thread():
            return self._called(arguments)
        handlers = {int(number): signal.getsignal(number) for number in _SIGNALS}
        own = {number: handler for number, handler in handlers.items() if callable(handler)}
        raised: list[BaseException] = []

        def handle(number: int, frame: FrameType | None) -> None:
            try:
                own[number](number, frame)
            except BaseException as error:
                raised.append(error)
                self._stop.asked = True

        for number in own:
            signal.signal(number, handle)
        try:
            found = self._called(arguments)
        finally:
            for number, handler in own.items():
                signal.signal(number, handler)
        if raised:
            raise raised[0]
        return found

    def _aside(self, deadline: float, arguments: Mapping[str, Any]) -> Any:
        """The result of a solver in a separate thread."""
        if self._busy.locked():
            raise TimeoutError("still busy with an earlier call")
        found: list[Any] = []

        def work() -> None:
            try:
                found.append(self._called(arguments))
            finally:
                self._busy.release()

        self._busy.acquire()
        # A thread of `threading` hands over twice at its start.
        _thread.start_new_thread(work, ())
        # An exception of a signal's handler ends the loop.
        while time.perf_counter() < deadline + _GRACE:
            if self._ended(_LOOK):
                return found[0]
        raise TimeoutError("did not stop at the time limit")

    def _ended(self, seconds: float) -> bool:
        """Wait for the end of a call, and handle signals."""
        if self._busy.acquire(timeout=seconds):
            self._busy.release()
            return True
        return False


def _callback(stop: Stop, sizes: tuple[int, int, int]) -> Any:
    """An iteration callback of CasADi that returns 1 to stop the solver."""
    import casadi as ca

    variables, constraints, parameters = sizes
    rows = (variables, 1, constraints, variables, constraints, parameters)

    class Callback(ca.Callback):
        """Reads no argument, so that a call costs microseconds."""

        def __init__(self) -> None:
            super().__init__()
            self.construct("stop", {})

        def get_n_in(self) -> int:
            return len(rows)

        def get_n_out(self) -> int:
            return 1

        def get_sparsity_in(self, i: int) -> Any:
            return ca.Sparsity.dense(rows[i], 1)

        def get_sparsity_out(self, i: int) -> Any:
            return ca.Sparsity.dense(1, 1)

        def has_eval_buffer(self) -> bool:
            return True

        def eval_buffer(self, arguments: Any, results: Any) -> int:
            memoryview(results[0]).cast("B").cast("d")[0] = float(stop.reached())
            return 0

    return Callback()
