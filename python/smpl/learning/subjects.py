"""What the benchmark runs: environments with their controllers, and runs by suite, budget and seed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from smpl._registry import ENVIRONMENTS
from smpl.learning import configuration
from smpl.model import as_count

SUITES, BUDGETS = ("control", "offline", "online"), ("smoke", "short", "paper")
# Seeds of a run are apart from those of the next by more episodes than any budget has.
_APART = 1_000_000


@dataclass(frozen=True)
class Subject:
    """An environment as the benchmark runs it.

    Attributes:
        arguments: of the environment.
        controllers: names; the published mean and deviation over steps, where the paper has them.
        episodes: a run of each budget.
        few: episodes of the budget `short` of controllers whose decisions take long; they are the first of the others'.
    """

    arguments: dict[str, Any]
    controllers: dict[str, tuple[float, float] | None]
    episodes: dict[str, int]
    few: dict[str, int] = field(default_factory=dict)

    def count(self, controller: str, budget: str) -> int:
        """Episodes of a run."""
        return self.few.get(controller, self.episodes[budget]) if budget == "short" else self.episodes[budget]


_LONG = {"smoke": 1, "short": 5, "paper": 100}
_QUICK = {"smoke": 8, "short": 200, "paper": 1000}
SUBJECTS = {
    # Table 2 of the paper, whose figures belong to `setpoint_change` and `legacy`.
    "Reactor": Subject(
        {"scenario": "legacy", "reward": "setpoint_change"},
        {"pid": (-1.0823, 35.0924), "mpc": (-0.1912, 15.9328), "oracle": None, "nominal": None, "random": None},
        _QUICK,
        {"mpc": 50, "oracle": 50},
    ),
    "Beer": Subject(
        {"scenario": "legacy"},
        {"profile": None, "isothermal": None, "oracle": None, "nominal": None, "random": None},
        _QUICK,
        {"oracle": 10},
    ),
    "PenSim": Subject({}, {"recipe": None, "oracle": None, "nominal": None, "random": None}, _LONG, {"oracle": 2}),
    "Atropine": Subject({}, {"mpc": None, "zero": None, "oracle": None, "nominal": None}, _LONG, {"oracle": 2}),
    "MAb": Subject(
        {}, {"mpc": None, "empc": None, "oracle": None, "nominal": None}, _LONG, {"mpc": 1, "empc": 1, "oracle": 1}
    ),
    "MAbPlant": Subject({}, {"oracle": None, "nominal": None}, _LONG, {"oracle": 1}),
}
# Steps of an episode of the budget `smoke`, which shows only that everything runs.
_SMOKE_STEPS = 20


@dataclass(frozen=True)
class Run:
    """One run: all that its scores are a function of."""

    suite: str
    budget: str
    env: str
    controller: str
    number: int
    seed: int
    episodes: int
    arguments: dict[str, Any]
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Suite, environment, controller and number."""
        return f"{self.suite}/{self.env}/{self.controller}/seed-{self.number}"

    def folder(self, out: Path) -> Path:
        """Where it is kept."""
        return out / self.name


def runs(
    suite: str,
    budget: str,
    env: str | None,
    seeds: int,
    algorithms: Sequence[str] = (),
    config: str | os.PathLike[str] | None = None,
) -> list[Run]:
    """All runs of a suite, with `algorithms` only those of these controllers and algorithms.

    Raises:
        ValueError: no such suite, budget, environment or algorithm.
        ImportError: the suite needs PyYAML.
    """
    one_of("suite", suite, (*SUITES, "all"))
    one_of("budget", budget, BUDGETS)
    if env is not None:
        env = env.removeprefix("smpl/").removesuffix("-v0")
        one_of("env", env, tuple(ENVIRONMENTS))
    count = as_count("seeds", seeds)
    chosen = SUITES if suite == "all" else (suite,)
    given = configuration.read(config) if chosen != ("control",) else {}
    known, found = set(), []
    for part in chosen:
        for name in SUBJECTS if env is None else (env,):
            listed = SUBJECTS[name].controllers if part == "control" else configuration.algorithms(given, part)
            known |= set(listed)
            for one in listed:
                if not algorithms or one in algorithms:
                    settings = configuration.settings(given, part, name, one, budget) if part != "control" else {}
                    found += [_run(part, budget, name, one, number, settings) for number in range(count)]
    for one in algorithms:
        one_of("algorithm", one, sorted(known))
    return found


def _run(suite: str, budget: str, env: str, controller: str, number: int, settings: dict[str, Any]) -> Run:
    subject = SUBJECTS[env]
    arguments = {**subject.arguments, **({"max_steps": _SMOKE_STEPS} if budget == "smoke" else {})}
    return Run(
        suite, budget, env, controller, number, number * _APART, subject.count(controller, budget), arguments, settings
    )


def one_of(what: str, value: str, known: Sequence[str]) -> None:
    """Refuse a value that is none of those that are known."""
    if value not in known:
        raise ValueError(f"{what} is {value!r}; there are: {', '.join(known)}")
