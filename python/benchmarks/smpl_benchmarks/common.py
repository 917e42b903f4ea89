"""Rows of a table on the same test episodes: training seed k on the first episodes of block k."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from smpl.support.arguments import FloatArray
from smpl_benchmarks.records import Result

# Training seeds of a row, each with its block of test episodes; and the most that a row may have.
SEEDS, MOST_SEEDS = 3, 10


@dataclass(frozen=True)
class Row:
    """Returns of a controller or an algorithm on the common episodes.

    Attributes:
        suite, controller: which one.
        returns: (seeds, episodes); seed k of an algorithm is its k-th training, of a controller its
            k-th block.
        starts: seed of the first episode of each block.
        arguments: of the environment.
        results: the runs.
    """

    suite: str
    controller: str
    returns: FloatArray
    starts: tuple[int, ...]
    arguments: Mapping[str, Any]
    results: Sequence[Result] = field(default=(), repr=False)

    @property
    def episodes(self) -> tuple[tuple[int, int], ...]:
        """First seed and number of episodes of each block."""
        return tuple((start, self.returns.shape[1]) for start in self.starts)


def common_rows(results: Iterable[Result], episodes: int, seeds: int = SEEDS) -> tuple[list[Row], dict[str, str]]:
    """Rows on the first episodes of each block, and the reason for each row that is left out.

    Args:
        results: finished runs of one process.
        episodes: in each block.
        seeds: number of blocks.

    Returns:
        The rows, and `SUITE CONTROLLER` of the others with what they lack.

    Raises:
        ValueError: rows of different episodes or arguments of the environment, see `check_same`.
    """
    grouped: dict[tuple[str, str], dict[int, Result]] = {}
    for one in results:
        grouped.setdefault((one.run.suite, one.run.controller), {})[one.run.number] = one
    rows, left = [], {}
    for (suite, controller), found in grouped.items():
        lengths = [len(found[k].scores["returns"]) if k in found else 0 for k in range(seeds)]
        if min(lengths) < episodes:
            ran = " + ".join(str(one) for one in lengths if one)
            left[f"{suite} {controller}"] = f"{ran} of {seeds} x {episodes} episodes"
            continue
        chosen = [found[k] for k in range(seeds)]
        returns = np.array([one.scores["returns"][:episodes] for one in chosen], dtype=np.float64)
        starts = tuple(one.run.seed for one in chosen)
        rows.append(Row(suite, controller, returns, starts, _task(chosen[0]), chosen))
    check_same(rows)
    return rows, left


def _task(one: Result) -> dict[str, Any]:
    """Arguments of the environment and drawn parameters of the test, as the run had them."""
    made = one.configuration or one.run.described()
    drawn = made["settings"].get("randomize")
    return {**made["arguments"], **({"randomize": drawn} if drawn else {})}


def check_same(rows: Sequence[Row]) -> None:
    """Refuse rows that do not have the same task and the same episodes.

    Raises:
        ValueError: names the first two rows that differ, and what differs.
    """
    for row in rows[1:]:
        first = rows[0]
        for what in ("arguments", "episodes"):
            mine, other = getattr(row, what), getattr(first, what)
            if mine != other:
                raise ValueError(
                    f"rows of different {what} in one table: {row.controller} has {mine}, {first.controller} {other}; "
                    "score them on the same episodes"
                )


def gains(row: Row, nominal: Row) -> FloatArray:
    """Mean gain in the return over the nominal policy, one number per seed."""
    return (row.returns - nominal.returns).mean(axis=1)


def differences(row: Row, other: Row) -> FloatArray:
    """Mean difference of two rows, one number per seed, on the same episodes."""
    return (row.returns - other.returns).mean(axis=1)


def reference_of(rows: Sequence[Row]) -> Row:
    """The highest return of any row on each episode.

    It is a reference, not a bound: each method is local or approximate, and a new method can
    exceed it.
    """
    best = np.max([row.returns for row in rows], axis=0)
    return Row("control", "reference", best, rows[0].starts, rows[0].arguments)


def validated(row: Row) -> float | None:
    """Mean reward of a step on the validation episodes over all seeds; None without validation."""
    found = []
    for one in row.results:
        curve = [float(point["mean"]) for point in one.curve]
        validation = one.scores.get("validation")
        if curve:
            found.append(max(curve))
        elif validation is not None:
            found.append(float(validation["mean"]))
    return float(np.mean(found)) if found else None


def at_limit(row: Row) -> float | None:
    """Share of actions at a limit over all steps; None if a run did not record it."""
    shares = [(one.scores.get("at_limit"), one.scores["steps"]) for one in row.results]
    if not shares or any(share is None for share, _ in shares):
        return None
    return float(sum(share * steps for share, steps in shares) / sum(steps for _, steps in shares))
