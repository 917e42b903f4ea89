"""Environments of the benchmark with their controllers, and runs by suite, budget and seed."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import gymnasium

from smpl.learning.agents import agent, described
from smpl.learning.names import names
from smpl.learning.plan import Task
from smpl.registry import ENVIRONMENTS
from smpl.support.arguments import as_count
from smpl_benchmarks import configuration, controls, tracks

SUITES, BUDGETS = ("control", "offline", "online"), ("smoke", "short", "paper")
# Seeds of a run are apart from those of the next by more episodes than any budget has.
_APART = 1_000_000
# Steps of an episode of the budget `smoke`, which shows only that everything runs.
_SMOKE_STEPS = 20


@dataclass(frozen=True)
class Subject:
    """An environment as the benchmark runs it.

    Attributes:
        arguments: of the environment.
        controllers: names; the published mean and deviation over steps, where the paper has them.
        episodes: a run of each budget.
        few: episodes of slow controllers in the budget `short`; they are the first of the others'.
        validation: episodes on which rows are selected.
        steps: of a whole episode, where these are fewer than those of `smoke`.
    """

    arguments: dict[str, Any]
    controllers: dict[str, tuple[float, float] | None]
    episodes: dict[str, int]
    few: dict[str, int] = field(default_factory=dict)
    steps: int = _SMOKE_STEPS
    validation: int = 0

    def count(self, controller: str, budget: str) -> int:
        """Episodes of a run."""
        return self.few.get(controller, self.episodes[budget]) if budget == "short" else self.episodes[budget]


_LONG = {"smoke": 1, "short": 5, "paper": 100}
_QUICK = {"smoke": 8, "short": 200, "paper": 1000}
SUBJECTS = {
    # Table 2 of the paper, whose figures belong to `setpoint_change` and `legacy`.
    "Reactor": Subject(
        {"scenario": "legacy", "reward": "setpoint_change"},
        {
            "pid": (-1.0823, 35.0924),
            "mpc": (-0.1912, 15.9328),
            "full_information": None,
            "nominal": None,
            "random": None,
        },
        _QUICK,
        {"full_information": 50, "sampling": 50},
        validation=50,
    ),
    "Beer": Subject(
        {"scenario": "legacy"},
        {"profile": None, "isothermal": None, "full_information": None, "nominal": None, "random": None},
        _QUICK,
        {"full_information": 10},
        validation=50,
    ),
    "PenSim": Subject(
        {},
        {"recipe": None, "full_information": None, "nominal": None, "random": None},
        _LONG,
        {"full_information": 2, "sampling": 2},
        validation=5,
    ),
    "Atropine": Subject(
        {},
        {"mpc": None, "zero": None, "full_information": None, "nominal": None},
        _LONG,
        {"full_information": 2},
        validation=20,
    ),
    "MAb": Subject(
        {},
        {"mpc": None, "empc": None, "full_information": None, "nominal": None},
        _LONG,
        {"mpc": 1, "empc": 1, "full_information": 1},
        validation=4,
    ),
    "MAbPlant": Subject({}, {"full_information": None, "nominal": None}, _LONG, {"full_information": 1}, validation=1),
}
# Episodes of a user's model.
_OWN = {"smoke": 4, "short": 50, "paper": 500}


@dataclass(frozen=True)
class Run:
    """One run: all that its scores are a function of.

    Attributes:
        model: path or id if `env` is not a process of the package; `described` leaves it out.
        track: see `smpl_benchmarks.tracks`.
    """

    suite: str
    budget: str
    env: str
    controller: str
    number: int
    seed: int
    episodes: int
    arguments: dict[str, Any]
    settings: dict[str, Any] = field(default_factory=dict)
    model: str = ""
    track: str = tracks.RESIDUAL

    def task(self) -> Task:
        """The environment that its scores are of."""
        return Task.of(self.model or f"smpl/{self.env}-v0", **self.arguments)

    def described(self) -> dict[str, Any]:
        """Description that identifies the run, independent of the place of its files."""
        apart = ("model", "track") if self.track == tracks.RESIDUAL else ("model",)
        return {key: value for key, value in asdict(self).items() if key not in apart}

    @property
    def part(self) -> str:
        """The suite, with the track if it is not the residual one."""
        return self.suite if self.track == tracks.RESIDUAL else f"{self.suite}-{self.track}"

    @property
    def name(self) -> str:
        """Suite, environment, controller and number."""
        return f"{self.part}/{self.env}/{self.controller}/seed-{self.number}"

    def folder(self, out: Path) -> Path:
        """Its folder."""
        return out / self.name


def runs(
    suite: str,
    budget: str,
    env: str | Sequence[str] | None,
    seeds: int,
    algorithms: Sequence[str] = (),
    config: str | os.PathLike[str] | None = None,
    track: str = tracks.RESIDUAL,
) -> list[Run]:
    """All runs of a suite, with `algorithms` only those of these controllers and algorithms.

    Args:
        suite, budget, seeds: see `smpl.benchmark`.
        env: a process of the package or of `config`, the path of a model, an id, or several; all
            processes if none.
        algorithms: names of controllers and algorithms; all if empty.
        config: a YAML file over the configuration of the package.
        track: see `smpl_benchmarks.tracks`; controls of a track with the task and the episodes of
            the residual one are those of that track.

    Raises:
        ValueError: no such suite, budget, environment or algorithm.
        ImportError: the suite needs PyYAML.
    """
    one_of("suite", suite, (*SUITES, "all"))
    one_of("budget", budget, BUDGETS)
    count = as_count("seeds", seeds)
    chosen = SUITES if suite == "all" else (suite,)
    given, places = _places(env, config, chosen != ("control",))
    known, found = set(), []
    if config is not None and "offline" in chosen:
        for name, (place, arguments) in places.items():
            _check_collecting(given["processes"].get(name, {}), place or f"smpl/{name}-v0", arguments)
    for part in chosen:
        way = tracks.of_controls(track) if part == "control" else track
        for name, (place, arguments) in places.items():
            further = given["processes"].get(name, {}).get("controllers", {})
            subject = SUBJECTS[name] if not place else _subject(place, arguments, further)
            rivals = controls.known(name) if not place and budget != "smoke" else {}
            listed = [*subject.controllers, *rivals] if part == "control" else configuration.algorithms(given, part)
            if part == "control" and way != tracks.RESIDUAL and not place:
                listed = [one for one in listed if one in tracks.TRACKS[way].controls]
            known |= set(listed)
            for one in listed:
                if not algorithms or one in algorithms:
                    if part != "control":
                        settings = configuration.settings(given, part, name, one, budget)
                    elif one in rivals:
                        settings = controls.settings(name, one)
                    else:
                        settings = _of_ones_own(str(further[one]), place, arguments) if one in further else {}
                    if way != tracks.RESIDUAL:
                        settings = tracks.in_track(way, name, settings, learned=part != "control")
                    about = (part, budget, name, one)
                    found += [_run(about, subject, number, settings, place, way) for number in range(count)]
    for one in algorithms:
        one_of("algorithm", one, sorted(known))
    return found


Place = tuple[str, dict[str, Any]]


def _places(
    env: str | Sequence[str] | None, config: str | os.PathLike[str] | None, learned: bool
) -> tuple[dict[str, Any], dict[str, Place]]:
    """The configuration; and by process the model's path (empty: package) and arguments."""
    wanted = [_plain(one) for one in ([env] if isinstance(env, str) else env or ())]
    files = {one: Task.of(one).model.name for one in wanted if one not in SUBJECTS and _is_place(one)}
    given = configuration.read(config, own=files.values()) if learned or config is not None else {"processes": {}}
    known: dict[str, Place] = dict.fromkeys(SUBJECTS, ("", {}))
    folder = Path() if config is None else Path(config).parent
    for name, process in given["processes"].items():
        if "model" in process:
            known[name] = _absolute(str(process["model"]), folder), dict(process.get("arguments", {}))
    if not wanted:
        return given, known
    chosen: dict[str, Place] = {}
    for one in wanted:
        name = files.get(one, one)
        place = _place_of(one, name, known) if one in files else known.get(name)
        if place is None:
            raise ValueError(f"env is {one!r}; there are: {', '.join(known)}, and the path of a model")
        if chosen.setdefault(name, place) != place:
            raise ValueError(f"{one!r} and {chosen[name][0]!r} are both called {name}: run one after the other")
    return given, chosen


def _plain(env: str) -> str:
    """The name of a process of the package, of its id or file too; other text is unchanged."""
    env = env.removeprefix("smpl/").removesuffix("-v0")
    return {file: name for name, file in ENVIRONMENTS.items()}.get(env, env)


def _place_of(env: str, label: str, known: Mapping[str, Place]) -> Place:
    """The place of a model that is given by its path or id.

    Raises:
        ValueError: another model has its name.
    """
    place = _absolute(env, Path())
    if label not in known:
        return place, {}
    if known[label][0] != place:
        raise ValueError(
            f"{env!r} is called {label}, as a process of the benchmark is: "
            "give it another name by `processes: {NAME: {model: PATH}}` in --config"
        )
    return known[label]


def _is_place(env: str) -> bool:
    """True for a path or an id, false for the name of a process."""
    return Path(env).exists() or bool(Path(env).suffix) or "/" in env or ":" in env or env in gymnasium.registry


def _absolute(model: str, folder: Path) -> str:
    """The path of a model as workers find it; an id or a name is unchanged."""
    return str((folder / model).resolve()) if (folder / model).exists() else model


def _subject(model: str, arguments: Mapping[str, Any], further: Mapping[str, Any]) -> Subject:
    """A user's model, with general controllers, its declared policies and further controllers."""
    task = Task.of(model, **arguments)
    own = names(task.model)
    for one in further:
        if one in own:
            raise ValueError(
                f"controllers: {one!r} is of {task.model.name} already ({', '.join(own)}): give yours another name"
            )
    known = dict.fromkeys([*own, *further])
    return Subject(dict(arguments), known, _OWN, steps=task.env().max_steps)


def _check_collecting(process: Mapping[str, Any], model: str, arguments: Mapping[str, Any]) -> None:
    """Refuse an unknown controller of a data set; the one of a formulation is made with it."""
    controller = process.get("data", {}).get("controller", "centre")
    if controller != "centre":
        agent(controller, Task.of(model, **arguments).model)


def _of_ones_own(controller: str, model: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
    """A controller of a configuration: its name there, and its identity, its code included."""
    chosen = agent(controller, Task.of(model, **arguments).model)
    text = json.dumps(described(chosen), sort_keys=True)
    return {"controller": controller, "identity": hashlib.sha256(text.encode()).hexdigest()[:16]}


def _run(
    about: tuple[str, str, str, str], subject: Subject, number: int, settings: dict[str, Any], model: str, track: str
) -> Run:
    """A run of suite, budget, environment and controller."""
    budget, controller = about[1], about[3]
    few = {"max_steps": min(_SMOKE_STEPS, subject.steps)} if budget == "smoke" else {}
    arguments = {**subject.arguments, **tracks.TRACKS[track].arguments, **few}
    return Run(*about, number, number * _APART, subject.count(controller, budget), arguments, settings, model, track)


def one_of(what: str, value: str, known: Sequence[str]) -> None:
    """Refuse a value that is not one of the known values."""
    if value not in known:
        raise ValueError(f"{what} is {value!r}; there are: {', '.join(known)}")
