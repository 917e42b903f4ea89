"""Places of the page of results: tables and sentences that are made from the records alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from smpl_benchmarks import paper
from smpl_benchmarks.cells import between, decided, episodes_of, gain, number, over, share
from smpl_benchmarks.common import SEEDS
from smpl_benchmarks.comparison import (
    THRESHOLDS,
    Comparison,
    aggregate,
    better_than,
    claim,
    compared,
    figures,
)
from smpl_benchmarks.controls import CONTROLS, settings
from smpl_benchmarks.data_curve import data_table
from smpl_benchmarks.further import seeds, tracks
from smpl_benchmarks.pages import grid
from smpl_benchmarks.provenance import checks, cost, longer, tuning
from smpl_benchmarks.records import Result
from smpl_benchmarks.tracks import RESIDUAL


def places(results: Sequence[Result], records: Path | None = None, budget: str = "short") -> dict[str, str]:
    """Text of each place by its name, from finished runs and the folder of their records."""
    main = [one for one in results if one.run.track == RESIDUAL]
    every = compared(main)
    first = [one for one in main if one.run.number < SEEDS]
    found = {
        "best": headline(every),
        "aggregate": aggregated(every),
        "published": published(first),
        "seeds": seeds(every),
        "tracks": tracks(results, every),
        "controls": budgets(every),
        "checks": checks(records, budget),
        "cost": cost(first),
        "longer": longer(records),
        "data": data_table(results),
        "tuning": tuning(),
    }
    for one in every:
        found |= {
            f"comparison {one.env}": comparison(one),
            f"claim {one.env}": sentence(one),
            f"reference {one.env}": references(one),
        }
    return found


def headline(every: Sequence[Comparison]) -> str:
    """The control and the learned policy that validation selects, and their difference."""
    head = [
        "process",
        "episodes",
        "nominal",
        "control",
        "its gain",
        "learned",
        "its gain",
        "learned - control",
        "reference",
    ]
    lines = []
    for one in every:
        found = claim(one)
        nominal = one.nominal if found is None else found.nominal
        begin = [one.env, episodes_of(nominal), f"{nominal.returns.mean():.5g}"]
        reference = f"{one.reference_gain:+.4g}"
        if found is None:
            lines.append([*begin, *["not validated", "", "", "", ""], reference])
            continue
        control, learned = (figures(nominal, row, None) for row in (found.control, found.learned))
        difference = decided(found.difference, found.student, found.sign)
        lines.append(
            [
                *begin,
                found.control.controller,
                gain(control),
                found.learned.controller,
                gain(learned),
                difference,
                reference,
            ]
        )
    return grid(head, lines, left=1)


def sentence(one: Comparison) -> str:
    """The claim of a process in words, with its intervals."""
    found = claim(one)
    if found is None:
        return "No row of this process has validation scores, so that no policy is selected and nothing is claimed."
    learned, control = found.learned.controller, found.control.controller
    verdict = {
        1: f"`{learned}` is above `{control}`",
        0: f"the data do not decide between `{learned}` and `{control}`",
        -1: f"`{learned}` is below `{control}`",
    }[found.sign]
    others = [row.controller for row, sign in better_than(one, found.control) if sign > 0 and row.controller != learned]
    more = f"No other learned row has both intervals above `{control}`."
    if others:
        more = f"Other learned rows above `{control}`, without correction for their number: {', '.join(others)}."
    if one.unvalidated:
        more += f"\nNot selected, without validation scores: {', '.join(one.unvalidated)}."
    run = {row.controller for row in (*one.rows, *one.references)}
    if missing := [name for name in CONTROLS.get(one.env, {}) if name not in run]:
        more += f"\nControls that were not run: {', '.join(missing)}."
    return (
        f"Validation selects the control `{control}` and the learned policy `{learned}`.\n"
        f"On the {episodes_of(found.nominal)} test episodes their returns differ by {found.difference:+.4g} "
        f"per episode (95 % over seeds: bootstrap {between(found.bootstrap)}, "
        f"Student {between(found.student)}): {verdict}.\n"
        f"A training is better than the control with probability {found.probability:.2f}.\n{more}"
    )


def comparison(one: Comparison) -> str:
    """Rows of a process on the same test episodes, by their gain."""
    control = one.selected(("control",))
    name = "selected control" if control is None else f"`{control.controller}`"
    head = [
        "suite",
        "row",
        "return",
        "gain",
        "95 %",
        "better",
        f"over {name}",
        "validation",
        "at a limit",
        "failures",
        "cost",
    ]
    lines = []
    for row in sorted(one.rows, key=lambda row: -float(row.returns.mean())):
        mine = figures(one.nominal, row, control)
        lines.append(
            [
                row.suite, row.controller, f"{mine['return']:.5g}", f"{mine['gain']:+.4g}", between(mine["interval"]),
                f"{mine['better']} of {row.returns.size}", over(mine), number(mine["validation"]),
                share(mine["at_limit"]), number(mine["failures"]), number(mine["cost"]),
            ]
        )  # fmt: skip
    text = grid(head, lines, left=2)
    if one.left:
        listed = "; ".join(f"{key} ({why})" for key, why in sorted(one.left.items()))
        text += f"\nNot re-scored on these episodes, and therefore not in the table: {listed}.\n"
    return text


def references(one: Comparison) -> str:
    """Controls on the episodes that slow ones have run too, with the reference."""
    nominal = next(row for row in one.references if row.controller == "nominal")
    head = ["row", "return", "gain over nominal", "below the reference"]
    rows = [row for row in one.references if row.suite == "control" and row.controller != "random"]
    best = next(row for row in rows if row.controller == "reference")
    lines = []
    for row in sorted(rows, key=lambda row: -float(row.returns.mean())):
        gain, deficit = (row.returns - nominal.returns).mean(), (best.returns - row.returns).mean()
        lines.append([row.controller, f"{row.returns.mean():.5g}", f"{gain:+.4g}", f"{deficit:.4g}"])
    episodes = f"The first {nominal.returns.shape[1]} episodes of each of {len(nominal.starts)} blocks."
    return f"{episodes}\n\n{grid(head, lines, left=1)}"


def aggregated(every: Sequence[Comparison]) -> str:
    """Interquartile means, performance profiles, probabilities of improvement, all processes."""
    found = aggregate(every)
    # The rival is not a row of all processes if nothing is compared with it.
    rival = ["P(better than `constant`)"] if any(row["improvement"] is not None for row in found) else []
    head = ["row", "IQM", "95 %", *(f"> {one:g}" for one in THRESHOLDS), *rival]
    lines = [
        [
            row["row"], f"{row['iqm']:.3g}", between(row["interval"]), *(f"{share:.2f}" for share in row["profile"]),
            *([number(row["improvement"])] if rival else []),
        ]
        for row in found
    ]  # fmt: skip
    return f"Processes: {', '.join(one.env for one in every)}.\n\n{grid(head, lines, left=1)}"


def published(results: Sequence[Result]) -> str:
    """Figures of the paper next to the rows of the same algorithm in both scenarios."""
    head = ["process", "suite", "row", "paper", "ours, `legacy`", "ours, `default`", "task differs"]
    known = len(paper.LEARNED)
    return (
        grid(head, paper.lines(results), left=3)
        + f"\nThe paper has {paper.ROWS} rows of learned policies; {known} of their figures are known in this "
        f"repository, the other {paper.ROWS - known} are not, and are left out rather than estimated.\n"
    )


def budgets(every: Sequence[Comparison]) -> str:
    """Controls of each process with the budget of their tuning."""
    head = ["process", "row", "method", "tuning"]
    lines = []
    for one in every:
        for name, control in CONTROLS.get(one.env, {}).items():
            run = any(row.controller == name for row in (*one.rows, *one.references))
            budget = settings(one.env, name)["control"]["budget"]
            lines.append([one.env, name, control.what, budget if run else f"{budget}; not run"])
    return grid(head, lines, left=4)
