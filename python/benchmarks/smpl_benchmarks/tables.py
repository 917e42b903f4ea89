"""The table of the benchmark: scores of each row over its seeds, with the published ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl._native import __version__
from smpl.learning.formulation import Formulation
from smpl.learning.statistics import bootstrap, interquartile_mean
from smpl_benchmarks.learned import inside_formulation
from smpl_benchmarks.paper import LEARNED, plain
from smpl_benchmarks.records import Result
from smpl_benchmarks.significance import Interval, stratified_bootstrap
from smpl_benchmarks.subjects import SUBJECTS, Run


def table(
    every: Sequence[Run], results: Mapping[str, Result], skipped: Mapping[str, str], stale: Mapping[str, Sequence[str]]
) -> dict[str, Any]:
    """Scores of each controller over its seeds, as `table.json` has them.

    Args:
        every: the runs that were asked for.
        results: those that are finished, by the run's name.
        skipped: why a controller cannot be run, by `SUITE ENV NAME`.
        stale: what has changed since a result was made, by the run's name.
    """
    rows = []
    for which in dict.fromkeys((one.env, one.suite, one.controller) for one in every):
        env, suite, controller = which
        row: dict[str, Any] = {"env": env, "suite": suite, "controller": controller}
        mine = _of(which, every, results)
        if not mine:
            rows.append({**row, "skipped": skipped[f"{suite} {env} {controller}"]})
            continue
        changed = sorted({what for one in mine for what in stale.get(one.run.name, ())})
        row |= _row(mine)
        leads = {
            other: _leads(mine, _of((env, "control", other), every, results))
            for other in ("nominal", "full_information")
        }
        for key, other, sign in (("gain", "nominal", 1.0), ("regret", "full_information", -1.0)):
            lead = leads[other]
            row[key] = sign * float(lead.mean()) + 0.0 if len(lead) else None  # no negative zero
        compared = leads["nominal"]
        parts = [_leads([one], _of((env, "control", "nominal"), every, results)) for one in mine]
        row["gain_interval"] = list(_interval([part for part in parts if len(part)])) if len(compared) else None
        row["better"] = [int((compared > 0).sum()), len(compared)] if len(compared) else None
        rows.append({**row, "changed": changed})
    order = list(dict.fromkeys([*SUBJECTS, *(one.env for one in every)]))
    rows.sort(key=lambda row: order.index(row["env"]))
    suites = list(dict.fromkeys(one.suite for one in every))
    return {"suite": ", ".join(suites), "budget": every[0].budget, "smpl": __version__, "rows": rows}


def _of(which: tuple[str, str, str], every: Sequence[Run], results: Mapping[str, Result]) -> list[Result]:
    """Finished runs of an environment, suite and controller."""
    mine = [one for one in every if (one.env, one.suite, one.controller) == which]
    return [results[one.name] for one in mine if one.name in results]


def _row(mine: Sequence[Result]) -> dict[str, Any]:
    scores = [one.scores for one in mine]
    returns = np.concatenate([one["returns"] for one in scores])
    steps = np.array([one["steps"] for one in scores], dtype=np.float64)
    means, deviations = (np.array([one[key] for one in scores], dtype=np.float64) for key in ("mean", "std"))
    mean = float((steps * means).sum() / steps.sum())
    variance = float((steps * (deviations**2 + (means - mean) ** 2)).sum() / steps.sum())
    first = mine[0].run
    return {
        "seeds": len(scores),
        "episodes": len(returns),
        "mean": mean,
        "std": float(np.sqrt(variance)),
        # Twenty steps of an episode compare with nothing.
        "published": None if first.budget == "smoke" else _published(first),
        "return_mean": float(returns.mean()),
        "return_interval": list(_interval([one["returns"] for one in scores])),
        "return_iqm": float(interquartile_mean(returns)),
        "failures": sum(one["failures"] for one in scores),
        "successes": sum(one["successes"] for one in scores),
        "seconds": sum(one["seconds"] for one in scores),
        "diverged": sum("diverged" in one for one in scores),
        "rewards_only": _rewards_only(first),
    }


def _interval(seeds: Sequence[npt.ArrayLike]) -> Interval:
    """95 % interval of a mean over training seeds; of one seed over its episodes."""
    if len(seeds) == 1:
        return bootstrap(seeds[0])
    return stratified_bootstrap([float(np.asarray(one, dtype=np.float64).mean()) for one in seeds])


def _rewards_only(one: Run) -> bool:
    """True if only the rewards of a formulation of actions or observations were learned from."""
    if one.suite != "offline" or inside_formulation(one.settings):
        return False
    return not Formulation.of(one.settings["formulation"]).shapes_rewards_only


def _leads(mine: Sequence[Result], others: Sequence[Result]) -> np.ndarray:
    """By how much the return is higher than another's, for each episode that both have run."""
    other = {one.run.number: one for one in others}
    lead: list[float] = []
    for one in mine:
        if one.run.number in other:
            pairs = zip(one.scores["returns"], other[one.run.number].scores["returns"], strict=False)
            lead += [float(here) - float(there) for here, there in pairs]
    return np.array(lead)


def _published(one: Run) -> tuple[float, float | None] | None:
    if one.suite == "control":
        return SUBJECTS[one.env].controllers.get(one.controller) if one.env in SUBJECTS else None
    # Its figures belong to the original's behaviour.
    legacy = one.arguments.get("scenario") == "legacy"
    return LEARNED.get((one.suite, one.env, plain(one.controller))) if legacy else None


_HEADINGS = (
    *("environment", "suite", "controller", "per step", "published", "return", "over nominal", "better", "regret"),
    *("failures", "successes", "episodes", "seeds", "s"),
)


def lines(table: Mapping[str, Any]) -> list[list[str]]:
    """Heading and rows as text."""
    found = [list(_HEADINGS)]
    for row in table["rows"]:
        if "skipped" in row:
            cells = [row["env"], row["suite"], row["controller"], f"skipped: {row['skipped']}"]
            found.append([*cells, *[""] * (len(_HEADINGS) - len(cells))])
            continue
        low, high = row["return_interval"]
        published = " ± ".join(f"{value:.5g}" for value in row["published"] or () if value is not None)
        steps = f"{row['mean']:.5g} ± {row['std']:.5g}"
        returns = f"{row['return_mean']:.5g} ({low:.5g} to {high:.5g})"
        gain = "" if row["gain"] is None else f"{row['gain']:+.4g}"
        better = "" if row["better"] is None else "{} of {}".format(*row["better"])
        regret = "" if row["regret"] is None else f"{row['regret']:.4g}"
        counts = [str(row[key]) for key in ("failures", "successes", "episodes", "seeds")]
        name = row["controller"] + "*" * bool(row["changed"]) + "†" * bool(row["diverged"])
        name += "‡" * bool(row["rewards_only"])
        found.append(
            [
                row["env"],
                row["suite"],
                name,
                steps,
                published,
                returns,
                gain,
                better,
                regret,
                *counts,
                f"{row['seconds']:.0f}",
            ]
        )
    return found


def remarks(table: Mapping[str, Any]) -> str:
    """Explanations of marked rows; empty without any."""
    changed = sorted({what for row in table["rows"] for what in row.get("changed", ())})
    notes = [f"\n\\* made before a change of: {', '.join(changed)}.\n"] if changed else []
    if any(row.get("diverged") for row in table["rows"]):
        notes.append("\n† training diverged: the best policy until then.\n")
    if any(row.get("rewards_only") for row in table["rows"]):
        notes.append(
            "\n‡ learned from a data set of another controller than `centre`: of the formulation the rewards count, "
            "actions and observations are the environment's own.\n"
        )
    return "".join(notes)
