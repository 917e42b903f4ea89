"""Cells of the tables of the page of results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from smpl_benchmarks.common import Row, differences
from smpl_benchmarks.significance import Interval, student, supported

_MARKS = {1: "+", 0: "", -1: "-"}
_VERDICTS = {1: "**above**", 0: "not decided", -1: "**below**"}


def episodes_of(row: Row) -> str:
    """Number of blocks and of the episodes of each."""
    return f"{row.returns.shape[0]} x {row.returns.shape[1]}"


def over(mine: Mapping[str, Any]) -> str:
    """Difference from the selected control of a table, with its sign if it is supported."""
    return "" if mine["over"] is None else f"{mine['over']:+.4g} {_MARKS[mine['sign']]}".strip()


def decided(difference: float, interval: Interval, sign: int) -> str:
    """A difference with its interval, and the verdict on it."""
    return f"{difference:+.4g} ({between(interval)}), {_VERDICTS[sign]}"


def compared_with(row: Row, control: Row | None) -> str:
    """Difference of a row from a control, with Student's interval over seeds and the verdict."""
    if control is None or row is control:
        return ""
    values = differences(row, control)
    return decided(float(values.mean()), student(values), supported(values))


def gain(mine: Mapping[str, Any]) -> str:
    """Gain over the nominal policy with its interval."""
    return f"{mine['gain']:+.4g} ({between(mine['interval'])})"


def between(ends: Sequence[float]) -> str:
    """Ends of an interval."""
    return f"{ends[0]:+.4g} to {ends[1]:+.4g}"


def number(value: float | None) -> str:
    """A number; empty for None."""
    return "" if value is None else f"{value:.4g}"


def share(value: float | None) -> str:
    """A share as a percentage; empty for None."""
    return "" if value is None else f"{100 * value:.0f} %"
