"""Work on a plan on a cluster of Ray (extra `ray`); work of failed nodes is repeated.

Pieces go out a few at a time. A piece whose worker or node died goes out again; the first result of
a piece is the one that counts. Results come back to this process, which alone writes files: the
nodes need no common disk.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from smpl.support.optional import load

Result = TypeVar("Result")
# Pieces in work for each processor, seconds after which new processors are looked for, and how
# often in a row pieces may be lost before any is done.
_AHEAD, _LOOK, _LOSSES = 2, 5.0, 100


def spread_on_ray(
    work: Callable[[Any, Any], Result], shared: Any, pieces: Sequence[Any], address: str
) -> Iterator[tuple[Any, Result]]:
    """Pieces with what `work(shared, piece)` gives for each, in the order in which they are done.

    Args:
        work: a function of a module that all nodes have; done twice it must do no harm.
        shared: what all pieces have in common; it is sent to each node once.
        pieces: must be hashable.
        address: of the cluster: `auto` for the one that runs here, `local` to start one on this
            machine, or HOST:PORT.

    Raises:
        ImportError: Ray is missing.
        ValueError: `shared` cannot be sent.
        RuntimeError: no cluster is there, or workers die again and again.
    """
    ray = connect(address)
    sent = ray.put(_pickled(shared))
    remote = ray.remote(max_retries=0, num_cpus=1)(_do)
    waiting = list(dict.fromkeys(pieces))
    waiting.reverse()
    running: dict[Any, Any] = {}
    losses = 0
    try:
        while waiting or running:
            while waiting and len(running) < _AHEAD * _processors(ray):
                piece = waiting.pop()
                running[remote.remote(work, sent, piece)] = piece
            for done in ray.wait(list(running), timeout=_LOOK)[0]:
                piece = running.pop(done)
                try:
                    result = ray.get(done)
                except ray.exceptions.RayTaskError as error:
                    raise error.cause if isinstance(error.cause, Exception) else error from None
                except ray.exceptions.RayError as error:
                    losses = _lost(losses, error)
                    waiting.append(piece)
                    continue
                losses = 0
                yield piece, result
    finally:
        for one in running:
            ray.cancel(one, force=True)


def connect(address: str) -> Any:
    """The module of Ray, connected.

    Raises:
        ImportError: it is missing.
        RuntimeError: there is no cluster at the address.
    """
    ray = load("ray", "work on a cluster")
    if not ray.is_initialized():
        try:
            ray.init(
                address=None if address == "local" else address, log_to_driver=False, logging_level="ERROR",
                include_dashboard=False if address == "local" else None,
            )  # fmt: skip
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise RuntimeError(
                f"no cluster of Ray at {address!r} ({error}): start one by `ray start --head`, or give --ray local"
            ) from error
    return ray


def _do(work: Callable[[Any, Any], Any], sent: bytes, piece: Any) -> Any:
    """Runs in a worker, where `shared` is unpickled once."""
    key = hash(sent)
    if _SHARED.get("key") != key:
        _SHARED.update(key=key, value=pickle.loads(sent))
    return work(_SHARED["value"], piece)


_SHARED: dict[str, Any] = {}


def _processors(ray: Any) -> int:
    return max(1, int(ray.cluster_resources().get("CPU", 1)))


def _lost(losses: int, error: Exception) -> int:
    if losses + 1 == _LOSSES:
        raise RuntimeError(
            f"workers of the cluster die again and again ({error}): what is whole is kept, and the same command goes on"
        ) from error
    return losses + 1


def _pickled(shared: Any) -> bytes:
    try:
        return pickle.dumps(shared)
    except (pickle.PicklingError, TypeError, AttributeError) as error:
        raise ValueError(f"the controller cannot be sent to a cluster ({error}): give MODULE:NAME") from error
