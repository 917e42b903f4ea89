"""Rewards of a step in the paper of 2022: mean and deviation over all steps of all episodes.

The paper has 81 rows of learned policies. `LEARNED` has those whose figures are known here; figures
are added to it only from the paper's tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from smpl_benchmarks.records import Result
from smpl_benchmarks.subjects import SUBJECTS

Key = tuple[str, str, str]
Figures = tuple[float, float | None]
# Rows of learned policies in the paper's tables.
ROWS = 81
CONTROL: dict[Key, Figures] = {
    ("control", "Atropine", "mpc"): (-20.6094, 339.5105),
    ("control", "MAb", "mpc"): (1322.5012, 174.7515),
    ("control", "MAb", "empc"): (1314.1145, 221.4624),
    **{
        ("control", env, name): figures
        for env, subject in SUBJECTS.items()
        for name, figures in subject.controllers.items()
        if figures is not None
    },
}
LEARNED: dict[Key, Figures] = {
    ("offline", "Reactor", "AWAC"): (-0.0965, None),
    ("online", "Beer", "PPO"): (1.0688, 20.70),
    ("online", "Beer", "A3C"): (0.8706, None),
    ("online", "Beer", "ARS"): (-200.0, 0.0),
    ("online", "Beer", "PG"): (-1.99, 14.0014),
    ("online", "MAb", "PPO"): (-92.7862, 137.6964),
    ("online", "MAb", "A3C"): (-88.8452, 272.8659),
    ("online", "MAb", "IMPALA"): (-94.3842, 184.2320),
    ("online", "MAb", "PG"): (-86.1046, 241.7652),
    ("online", "MAb", "SAC"): (-90.1491, 233.4410),
    ("online", "MAb", "DDPG"): (-95.1542, 288.9491),
    ("offline", "MAb", "BC"): (1322.8184, 111.1911),
    ("offline", "MAb", "PLAS"): (1324.1982, 124.7369),
    ("offline", "MAb", "PLASWithPerturbation"): (1357.0842, 122.1667),
    ("offline", "MAb", "AWAC"): (1374.2244, 61.2931),
    ("offline", "MAb", "TD3"): (708.1167, 571.8498),
    ("offline", "MAb", "BEAR"): (1268.8020, 297.5198),
    ("offline", "MAb", "BCQ"): (1247.0172, 313.2412),
    ("offline", "MAb", "SAC"): (1197.1507, 503.1202),
    ("offline", "MAb", "DDPG"): (711.1741, 574.0687),
    ("offline", "MAb", "CQL"): (1254.5728, 233.4812),
    ("offline", "MAb", "COMBO"): (1165.3812, 440.0366),
    ("offline", "MAb", "MOPO"): (-100.0, 0.0),
}
# Differences between the paper's task and that of the benchmark's rows.
DIFFERS = {
    ("control", "Reactor"): "",
    ("offline", "Reactor"): "data of `pid` with noise, training reward `setpoint`",
    ("online", "Reactor"): "corrects `pid`, training reward `setpoint`",
    ("online", "Beer"): "training reward shaped",
    ("control", "Atropine"): "scenario, reward scale 1e5, starts",
    ("control", "MAb"): "scenario, reward",
    ("offline", "MAb"): "scenario, reward, corrects rules",
    ("online", "MAb"): "scenario, reward, corrects rules",
}


def plain(controller: str) -> str:
    """Name of an algorithm without the package or year that the benchmark adds."""
    return controller.removesuffix("-2022").removeprefix("RLlib-")


def lines(results: Sequence[Result]) -> list[list[str]]:
    """Every published figure with the rows of the same algorithm, by process and suite."""
    found = []
    for (suite, env, name), figures in sorted((CONTROL | LEARNED).items(), key=_order):
        mine: dict[tuple[str, str], list[Result]] = {}
        for one in results:
            if (one.run.suite, one.run.env, plain(one.run.controller)) == (suite, env, name):
                scenario = str(one.run.arguments.get("scenario", "default"))
                mine.setdefault((one.run.controller, scenario), []).append(one)
        cells = {scenario: _cells(mine, scenario) for scenario in ("legacy", "default")}
        differs = DIFFERS[suite, env]
        found.append(
            [
                env,
                suite,
                name,
                _figures(figures),
                cells["legacy"],
                cells["default"],
                f"yes: {differs}" if differs else "no",
            ]
        )
    return found


def _cells(mine: Mapping[tuple[str, str], list[Result]], scenario: str) -> str:
    parts = []
    for (controller, where), found in mine.items():
        if where == scenario:
            steps = sum(one.scores["steps"] for one in found)
            value = sum(one.scores["mean"] * one.scores["steps"] for one in found) / steps
            parts.append(f"{controller} {value:.5g} ({len(found)} seed{'s' * (len(found) > 1)})")
    return ", ".join(parts) or "not run"


def _figures(figures: Figures) -> str:
    return " ± ".join(f"{value:.5g}" for value in figures if value is not None)


def _order(item: tuple[Key, Any]) -> tuple[int, int, str]:
    suite, env, name = item[0]
    return list(SUBJECTS).index(env), ("control", "offline", "online").index(suite), name
