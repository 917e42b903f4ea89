"""Work on a plan in processes; a failed process is replaced, and its work is repeated."""

from __future__ import annotations

import ast
import multiprocessing
import os
import pickle
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any, TypeVar

Result = TypeVar("Result")
# How often in a row a process may die before any piece is done.
_DEATHS = 3
_SHARED: list[Any] = []


def spread(
    work: Callable[[Any, Any], Result], shared: Any, pieces: Sequence[Any], workers: int
) -> Iterator[tuple[Any, Result]]:
    """Pieces with what `work(shared, piece)` gives for each, in the order in which they are done.

    Args:
        work: a function of a module; done twice it must do no harm.
        shared: what all pieces have in common; it is sent to each process once.
        pieces: must be hashable.
        workers: processes.

    Raises:
        ValueError: `shared` cannot be sent to other processes, or not made there.
        RuntimeError: processes die again and again.
    """
    if (script := _unguarded()) is not None:
        warnings.warn(
            f'one process does all the work: {script} has no `if __name__ == "__main__":`, and others would run it',
            stacklevel=2,
        )
        for piece in dict.fromkeys(pieces):
            yield piece, work(shared, piece)
        return
    try:
        sent = pickle.dumps(shared)
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        raise ValueError(
            f"the controller cannot be sent to other processes ({error}): give workers=1, or MODULE:NAME"
        ) from error
    left, deaths = list(dict.fromkeys(pieces)), 0
    while left:
        before = len(left)
        try:
            for piece, result in _pool(work, sent, left, workers):
                left.remove(piece)
                yield piece, result
        except BrokenProcessPool as error:
            deaths = 0 if len(left) < before else deaths + 1
            if deaths == _DEATHS:
                raise RuntimeError(
                    "worker processes die again and again (out of memory?): what is whole is kept, and the same "
                    "command goes on; give fewer workers"
                ) from error


def _unguarded() -> str | None:
    """The running script if a new process, which imports it, would run it again; else None."""
    main = sys.modules["__main__"]
    path = Path(str(getattr(main, "__file__", None) or ""))
    if getattr(main, "__spec__", None) is not None or path.suffix != ".py" or not path.is_file():
        return None
    try:
        body = ast.parse(path.read_text(encoding="utf-8", errors="replace")).body
    except (SyntaxError, ValueError):  # written since it was started
        return path.name
    tests = (
        name for one in body if isinstance(one, ast.If) for name in ast.walk(one.test) if isinstance(name, ast.Name)
    )
    return None if any(name.id == "__name__" for name in tests) else path.name


def _pool(
    work: Callable[[Any, Any], Result], sent: bytes, pieces: Sequence[Any], workers: int
) -> Iterator[tuple[Any, Result]]:
    # Spawned, not forked: the threads of this process are not in a child.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(min(workers, len(pieces), _most()), context, _begin, (sent,))
    try:
        waiting = {pool.submit(_do, work, piece): piece for piece in pieces}
        for done in as_completed(waiting):
            yield waiting[done], done.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _most() -> int:
    """Most worker processes: four a processor, and 64 on a small machine."""
    return max(64, 4 * (os.cpu_count() or 1))


def _begin(sent: bytes) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # An error is reported with the first piece: one that is raised here would look as if the
    # process had died.
    try:
        _SHARED[:] = [pickle.loads(sent)]
    except Exception as error:
        _SHARED[:] = [_Unknown(f"{type(error).__name__}: {error}")]


def _end_with_parent() -> None:
    """A process whose parent was killed would wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


class _Unknown(str):
    """Reason for which a piece cannot be unpickled here."""

    __slots__ = ()


def _do(work: Callable[[Any, Any], Result], piece: Any) -> Result:
    if isinstance(_SHARED[0], _Unknown):
        raise ValueError(
            f"the controller cannot be made in other processes ({_SHARED[0]}): define it in a module and import it "
            "from there, or give workers=1, or MODULE:NAME"
        )
    return work(_SHARED[0], piece)
