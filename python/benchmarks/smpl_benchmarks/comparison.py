"""Comparison of rows on the same test episodes; rows are selected on validation episodes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from smpl.learning.statistics import interquartile_mean
from smpl.support.arguments import FloatArray
from smpl_benchmarks.common import (
    SEEDS,
    Row,
    at_limit,
    common_rows,
    differences,
    gains,
    reference_of,
    validated,
)
from smpl_benchmarks.records import Result
from smpl_benchmarks.significance import (
    Interval,
    improvement,
    performance_profile,
    stratified_bootstrap,
    student,
    supported,
)
from smpl_benchmarks.subjects import SUBJECTS

LEARNED = ("offline", "online")
THRESHOLDS = (0.0, 0.25, 0.5, 0.75, 1.0)
# Rows that are never selected: the reference uses the test episodes, random actions are a floor.
_NEVER_SELECTED = ("reference", "random")


@dataclass(frozen=True)
class Comparison:
    """Rows of a process.

    Attributes:
        env: its name.
        rows: on the common test episodes.
        left: rows without these episodes, and what they lack.
        references: rows on the first episodes of each block, those of slow controllers included;
            the last is `reference`, the highest return of any control on each episode.
        further: rows on all blocks of the learned rows with more than `SEEDS` training seeds; empty
            without such rows or without the nominal policy on these blocks.
        short: learned rows with fewer of these blocks, and the nominal policy and the selected
            control if they lack some, with what they lack.
    """

    env: str
    rows: list[Row]
    left: dict[str, str]
    references: list[Row]
    further: list[Row] = field(default_factory=list)
    short: dict[str, str] = field(default_factory=dict)

    @property
    def nominal(self) -> Row:
        """The nominal policy, the zero of all gains."""
        return _named(self.rows, "nominal")

    def selected(self, suites: Sequence[str]) -> Row | None:
        """The row of the suites with the highest reward of a step in validation, if any."""
        scored = [(validated(row), row) for row in self.rows if row.suite in suites]
        known = [(value, row) for value, row in scored if value is not None and row.controller not in _NEVER_SELECTED]
        return max(known, key=lambda pair: pair[0])[1] if known else None

    def widest(self, rows: Sequence[Row]) -> Comparison:
        """The comparison on the blocks of `further` if all these rows have them."""
        having = {(row.suite, row.controller) for row in self.further}
        return replace(self, rows=self.further) if all((row.suite, row.controller) in having for row in rows) else self

    def row_of(self, other: Row) -> Row | None:
        """The row with the suite and the name of another."""
        return next((row for row in self.rows if (row.suite, row.controller) == (other.suite, other.controller)), None)

    @property
    def unvalidated(self) -> list[str]:
        """Controls of the table without validation scores, which are not selected."""
        controls = [row for row in self.rows if row.suite == "control" and row.controller not in _NEVER_SELECTED]
        return [row.controller for row in controls if validated(row) is None]

    @property
    def reference_gain(self) -> float:
        """Mean gain of the reference over the nominal policy on its episodes."""
        return float(gains(_named(self.references, "reference"), _named(self.references, "nominal")).mean())


def compare(env: str, results: Iterable[Result]) -> Comparison | None:
    """The comparison of a process; None if its nominal policy was not run on the common episodes.

    Raises:
        ValueError: rows of different tasks or episodes.
    """
    mine = [one for one in results if one.run.env == env]
    nominal = [one for one in mine if (one.run.suite, one.run.controller) == ("control", "nominal")]
    if not nominal:
        return None
    subject = SUBJECTS.get(env)
    shortest = min(len(one.scores["returns"]) for one in nominal)
    episodes = subject.episodes[nominal[0].run.budget] if subject else shortest
    blocks = min(len(nominal), SEEDS)
    controls = common_rows([one for one in mine if one.run.suite == "control"], 1, blocks)[0]
    few = min([episodes, *(len(one.scores["returns"]) for row in controls for one in row.results)])
    rows, left = common_rows(mine, episodes, blocks)
    references, _ = common_rows(mine, few, blocks)
    if "nominal" not in [row.controller for row in rows]:
        return None
    best = reference_of([row for row in references if row.suite == "control"])
    return _with_further(Comparison(env, rows, left, [*references, best]), mine, episodes)


def _with_further(one: Comparison, mine: Sequence[Result], episodes: int) -> Comparison:
    """The comparison with the rows on more than `SEEDS` blocks."""
    seeds: dict[str, int] = {}
    for found in mine:
        if found.run.suite in LEARNED:
            name = f"{found.run.suite} {found.run.controller}"
            seeds[name] = max(seeds.get(name, 0), found.run.number + 1)
    most = max([SEEDS, *seeds.values()])
    if most == SEEDS:
        return one
    rows, left = common_rows(mine, episodes, most)
    control = one.selected(("control",))
    needed = {"control nominal"} | ({f"control {control.controller}"} if control else set())
    short = {name: why for name, why in left.items() if name in needed or seeds.get(name, 0) > SEEDS}
    return replace(one, further=[] if "control nominal" in short else rows, short=short)


def compared(results: Iterable[Result]) -> list[Comparison]:
    """Comparisons of all processes in the order of the benchmark."""
    found = list(results)
    order = dict.fromkeys([*SUBJECTS, *(one.run.env for one in found)])
    return [one for env in order if (one := compare(env, found)) is not None]


@dataclass(frozen=True)
class Claim:
    """Learned policy and control selected by validation, and their difference in the test.

    Attributes:
        learned, control, nominal: the rows, on all blocks that these three have.
        difference: mean over seeds of the learned policy's return minus the control's.
        bootstrap, student: intervals of it over seeds.
        sign: 1 or -1 if both exclude zero, otherwise 0.
        probability: that a training is better than the control.
    """

    learned: Row
    control: Row
    nominal: Row
    difference: float
    bootstrap: Interval
    student: Interval
    sign: int
    probability: float


def claim(one: Comparison) -> Claim | None:
    """The claim of a process; None without a validated learned policy or control."""
    learned, control = one.selected(LEARNED), one.selected(("control",))
    if learned is None or control is None:
        return None
    wide = one.widest([learned, control])
    learned, control = (_named(wide.rows, row.controller, row.suite) for row in (learned, control))
    values = differences(learned, control)
    probability = improvement(gains(learned, wide.nominal), gains(control, wide.nominal))
    return Claim(
        learned, control, wide.nominal, float(values.mean()), stratified_bootstrap(values), student(values),
        supported(values), probability,
    )  # fmt: skip


def better_than(one: Comparison, control: Row) -> list[tuple[Row, int]]:
    """Learned rows with the sign of their supported difference from a control, on common blocks."""
    found = []
    for row in one.rows:
        if row.suite in LEARNED:
            wide = one.widest([row, control]).rows
            mine, other = _named(wide, row.controller, row.suite), _named(wide, control.controller)
            found.append((row, supported(differences(mine, other))))
    return found


def normalised(every: Sequence[Comparison]) -> dict[str, FloatArray]:
    """Gain over the nominal policy in units of the reference's gain, (seeds, processes).

    Only rows that all processes have.
    """
    found = {}
    for suite, name in _everywhere(every):
        columns = [gains(_named(one.rows, name, suite), one.nominal) / one.reference_gain for one in every]
        found[name if suite == "control" else f"{name} ({suite})"] = np.stack(columns, axis=1)
    return found


def _everywhere(every: Sequence[Comparison]) -> list[tuple[str, str]]:
    sets = [[(row.suite, row.controller) for row in one.rows] for one in every]
    return [pair for pair in (sets[0] if sets else []) if all(pair in one for one in sets)]


def aggregate(every: Sequence[Comparison], rival: str = "constant") -> list[dict[str, Any]]:
    """Interquartile means with intervals, performance profiles, probabilities of improvement.

    Processes whose reference gains nothing have no unit and are left out.
    """
    scores = normalised([one for one in every if one.reference_gain > 0])
    rows = []
    for name, matrix in scores.items():
        rows.append(
            {
                "row": name,
                "iqm": float(interquartile_mean(matrix.ravel())),
                "interval": stratified_bootstrap(matrix, interquartile_mean),
                "profile": performance_profile(matrix, THRESHOLDS).tolist(),
                "improvement": improvement(matrix, scores[rival]) if rival in scores else None,
            }
        )
    return sorted(rows, key=lambda row: -float(row["iqm"]))


def figures(nominal: Row, row: Row, control: Row | None) -> Mapping[str, Any]:
    """Numbers of a row of the table of a process, with the nominal policy as the zero."""
    mine = gains(row, nominal)
    whole = sum(len(found.scores["returns"]) for found in row.results) == row.returns.size
    costed = all("cost_mean" in found.scores for found in row.results)
    return {
        "return": float(row.returns.mean()),
        "gain": float(mine.mean()),
        "interval": stratified_bootstrap(mine),
        "iqm": float(interquartile_mean(mine)),
        "worst": float(mine.min()),
        "better": int((row.returns > nominal.returns).sum()),
        "over": None if control is None else float(differences(row, control).mean()),
        "sign": 0 if control is None else supported(differences(row, control)),
        "validation": validated(row),
        "at_limit": at_limit(row),
        "failures": sum(found.scores["failures"] for found in row.results) if whole else None,
        "cost": float(np.mean([found.scores["cost_mean"] for found in row.results])) if whole and costed else None,
    }


def _named(rows: Sequence[Row], name: str, suite: str = "control") -> Row:
    return next(row for row in rows if (row.suite, row.controller) == (suite, name))
