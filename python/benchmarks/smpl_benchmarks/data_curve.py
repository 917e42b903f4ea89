"""`python -m smpl.benchmark --suite data`: offline learning by the size and quality of its data."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace

from smpl_benchmarks import subjects
from smpl_benchmarks.cells import compared_with, gain
from smpl_benchmarks.common import SEEDS
from smpl_benchmarks.comparison import Comparison, compare, figures
from smpl_benchmarks.pages import grid
from smpl_benchmarks.recipes import RECIPES
from smpl_benchmarks.records import Result
from smpl_benchmarks.subjects import Run
from smpl_benchmarks.tracks import RESIDUAL

# The name of the suite, and of the track of its runs.
DATA = "data"
# Qualities are those of the releases, see `smpl_benchmarks.recipes`.
ENV, LEARNERS, QUALITIES, SIZES = "Reactor", ("PLAS", "BC", "TD3PlusBC"), ("medium", "mixed"), (20, 100, 500, 2000)


def data_runs(
    budget: str,
    env: str | Sequence[str] | None = None,
    seeds: int = SEEDS,
    algorithms: Sequence[str] = (),
    config: str | os.PathLike[str] | None = None,
) -> list[Run]:
    """Runs of the suite: each learner, quality and number of episodes is a row.

    Args:
        budget, seeds, algorithms, config: see `smpl.benchmark`.
        env: a process, or several, of those with the qualities; the reactor by default.

    Raises:
        ValueError: no such budget, environment or algorithm.
        ImportError: the suite needs PyYAML.
    """
    for name in algorithms:
        subjects.one_of("algorithm", name, LEARNERS)
    found: list[Run] = []
    for one in subjects.runs("offline", budget, env or ENV, seeds, algorithms or LEARNERS, config):
        for quality in QUALITIES:
            subjects.one_of("env", one.env, [place for place, which in RECIPES if which == quality])
            found += [_sized(one, quality, size) for size in SIZES]
    order = {name: place for place, name in enumerate(LEARNERS)}
    return sorted(found, key=lambda one: (order[one.settings["algorithm"]], one.number))


def _sized(one: Run, quality: str, size: int) -> Run:
    recipe = RECIPES[one.env, quality]
    data = {"controller": list(recipe.controllers), "noise": recipe.noise, "episodes": size}
    settings = {**one.settings, "algorithm": one.controller, "data": data}
    return replace(one, controller=_name(one.controller, quality, size), settings=settings, track=DATA)


def _name(learner: str, quality: str, size: int) -> str:
    return f"{learner}-{quality}-{size}"


def data_table(results: Sequence[Result]) -> str:
    """Gain over the nominal policy by learner, quality and number of episodes."""
    mine = [one for one in results if one.run.track == (RESIDUAL if one.run.suite == "control" else DATA)]
    envs = dict.fromkeys(one.run.env for one in mine if one.run.track == DATA)
    last, first = SIZES[-1], SIZES[0]
    head = ["process", "data", "row", *(f"{size} episodes" for size in SIZES), f"{last} - {first} episodes"]
    lines = []
    for env in envs:
        if (one := compare(env, mine)) is not None:
            lines += [line for quality in QUALITIES for learner in LEARNERS if (line := _line(one, quality, learner))]
    return grid(head, lines, left=3) if lines else "No row was trained on data sets of different sizes.\n"


def _line(one: Comparison, quality: str, learner: str) -> list[str]:
    """Gains of a learner by the number of episodes; empty without a row."""
    named = {row.controller: row for row in one.rows if row.suite == "offline"}
    rows = [named.get(_name(learner, quality, size)) for size in SIZES]
    if not any(rows):
        return []
    cells = ["" if row is None else gain(figures(one.nominal, row, None)) for row in rows]
    first, last = rows[0], rows[-1]
    return [one.env, quality, learner, *cells, compared_with(last, first) if first and last else ""]
