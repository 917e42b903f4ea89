"""Search for hyperparameters of an algorithm on a process by Optuna (extra `tune`).

A study is a file (SQLite) that the same command goes on from. Trial 0 has the hyperparameters of
`benchmark.yaml`, whatever was tuned since. A tree-structured Parzen estimator (Bergstra et al.
2011) proposes the others. They are stopped early if they are behind the median of the others after
as many steps. What a trial proposes depends on the trials before it and on the seed alone, so that
a study that was cut off ends as one that was not. The score of a trial is the mean reward of a
step, of the best policy of each training, on episodes that neither the benchmark's validation nor
its scores have.
"""

from __future__ import annotations

import json
import os
import tempfile
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from smpl._native import __version__
from smpl.support.arguments import as_count
from smpl.support.clock import Clock
from smpl.support.optional import load
from smpl_benchmarks import configuration
from smpl_benchmarks.learned import as_observed, trainer_of, validator, versions
from smpl_benchmarks.subjects import Run, runs
from smpl_benchmarks.training import learn

# Seeds of the episodes that trials are scored on, and numbers of the trainings.
TUNING, _NUMBERS = 700_000_000, 1000
EARLY = "stopped early"
# Trials that are drawn at random; trials that are finished before one is stopped early, and
# segments that each has.
_RANDOM, _WHOLE, _SURE = 8, 4, 2
Objective = Callable[[Mapping[str, Any], Callable[[int, float], None]], float]


@dataclass(frozen=True)
class Search:
    """A search: all inputs that determine a study.

    Attributes:
        suite, env, algorithm, budget: of the benchmark.
        seed: of the proposals and the trainings.
        seeds: trainings a trial; its score is their mean.
        episodes: that a policy is scored on.
        settings: of the trainings, see `smpl_benchmarks.configuration`.
        space: name of a hyperparameter to its choices (a list) or its range (`low`, `high`, `log`).
        checksum: of the model.
        run: of the benchmark, whose environment it is; `described` leaves it out.
        configured: what the user's configuration says of all this, with which it is written; left
            out as well.
    """

    suite: str
    env: str
    algorithm: str
    budget: str
    seed: int
    seeds: int
    episodes: int
    settings: dict[str, Any] = field(default_factory=dict)
    space: dict[str, Any] = field(default_factory=dict)
    checksum: str = ""
    run: Run | None = None
    configured: dict[str, Any] = field(default_factory=dict)

    def described(self) -> dict[str, Any]:
        """Identity of the search."""
        return {key: value for key, value in asdict(self).items() if key not in ("run", "configured")}

    @classmethod
    def of(
        cls, env: str, algorithm: str, *, suite: str = "online", budget: str = "short", seed: int = 0, seeds: int = 1,
        steps: int | None = None, episodes: int | None = None, config: Any = None,
    ) -> Search:  # fmt: skip
        """The search of an algorithm on a process as the configuration has it.

        Args:
            env, algorithm, suite, budget: as of the benchmark.
            seed, seeds: see the attributes.
            steps: of a training instead of the budget's.
            episodes: that a policy is scored on, instead of the budget's validation.
            config: a YAML file over the configuration of the package.

        Raises:
            ValueError: a name that there is not, a wrong number, or an algorithm without a space.
            ImportError: PyYAML is missing.
        """
        if suite == "control":
            raise ValueError("suite is 'control', which has no hyperparameters; there are: offline, online")
        (run,) = runs(suite, budget, env, 1, [algorithm], config)
        given = configuration.read(config, tuned=False, own=[run.env] if run.model else ())
        space = space_of(given, suite, run.env, algorithm)
        settings = configuration.settings(given, suite, run.env, algorithm, budget)
        if steps is not None:
            settings["steps"] = as_count("steps", steps)
        count = settings["validation"] if episodes is None else as_count("episodes", episodes)
        return cls(
            suite, run.env, algorithm, budget, int(seed), as_count("seeds", seeds), count, settings, space,
            run.task().checksum, run, _configured(config, run, env),
        )  # fmt: skip


@dataclass(frozen=True)
class Trial:
    """A trial that is finished.

    Attributes:
        number: in the order in which they were begun; 0 changes nothing.
        hyperparameters: what it changed.
        score: mean reward of a step; none where it was stopped early or failed.
        ended: `complete`, `stopped early`, or why it failed.
    """

    number: int
    hyperparameters: dict[str, Any]
    score: float | None
    ended: str


class _StoppedEarlyError(Exception):
    """A trial is behind the others."""


def space_of(given: Mapping[str, Any], suite: str, env: str, algorithm: str) -> dict[str, Any]:
    """Search space of an algorithm: the entry `spaces` of the configuration and of the process.

    Raises:
        ValueError: it is missing or invalid.
    """
    own = given["processes"].get(env, {}).get("spaces", {}).get(suite, {}).get(algorithm, {})
    space = {**given["spaces"].get(suite, {}).get(algorithm, {}), **own}
    if not space:
        known = ", ".join(given["spaces"].get(suite, {}))
        raise ValueError(f"{algorithm} has no space to search; there are: {known} (give one by spaces in --config)")
    for name, one in space.items():
        _check(f"spaces.{suite}.{algorithm}.{name}", one)
    return space


def _check(what: str, one: Any) -> None:
    if isinstance(one, list) and one:
        return
    if isinstance(one, Mapping) and set(one) <= {"low", "high", "log"} and {"low", "high"} <= set(one):
        low, high = one["low"], one["high"]
        numbers = all(isinstance(end, (int, float)) and not isinstance(end, bool) for end in (low, high))
        if numbers and low < high and (low > 0 or not one.get("log", False)):
            return
    raise ValueError(f"{what} is {one!r}, expected a list of choices, or low < high (above 0 with log: true)")


def tune(
    search: Search,
    study: Path,
    trials: int,
    *,
    objective: Objective | None = None,
    workers: int | None = None,
    on_trial: Callable[[Trial], None] | None = None,
    seconds: float | None = None,
) -> list[Trial]:
    """Run trials until the study has as many, those of earlier calls included.

    Args:
        search: what is searched.
        study: file of the study; made if it is not there. Data sets to learn from are kept in
            `data` next to it.
        trials: in all, the one that changes nothing included.
        objective: instead of training: score of hyperparameters, and a function to call with
            intermediate steps and scores.
        workers: threads or processes of validations.
        on_trial: function that is called with each finished trial.
        seconds: no trial begins after so many; no limit if None.

    Returns:
        All trials, the oldest first.

    Raises:
        ImportError: a package is missing.
        ValueError: the file is of another search.
    """
    optuna = _optuna()
    as_count("trials", trials)
    run = objective if objective is not None else _training(search, study.parent / "data", workers)
    opened = _open(optuna, search, study)
    _bury(optuna, opened)
    clock = Clock(seconds)
    while len(_finished(opened)) < trials and not clock.over():
        number = len(_finished(opened))
        opened.sampler = optuna.samplers.TPESampler(seed=_seed(search.seed, number), n_startup_trials=_RANDOM)
        trial = opened.ask()
        changed = {} if number == 0 else {name: _propose(trial, name, one) for name, one in search.space.items()}
        trial.set_user_attr("hyperparameters", changed)
        _try(optuna, opened, trial, changed, run)
        if on_trial is not None:
            on_trial(_finished(opened)[-1])
    return _finished(opened)


def best(trials: Sequence[Trial]) -> Trial:
    """The trial with the highest score, the earliest of equals.

    Raises:
        ValueError: none has a score.
    """
    scored = [one for one in trials if one.score is not None]
    if not scored:
        raise ValueError(f"no trial has a score: {trials[-1].ended if trials else 'no trials'}")
    return max(scored, key=lambda one: (one.score, -one.number))


def _configured(config: Any, run: Run, env: str) -> dict[str, Any]:
    """A run in the user's configuration: process, hyperparameters, budget.

    The process of a user's model has its `model`, absolute or relative as given.
    """
    given = {} if config is None else configuration.of_file(config)
    process = dict(given.get("processes", {}).get(run.env, {}))
    if run.model:
        named = str(process.get("model", env))
        # `Run` has the path as workers find it.
        process["model"] = named if Path(named).is_absolute() else run.model
        process["relative"] = not Path(named).is_absolute() and Path(run.model).is_file()
    both = (given.get("algorithms", {}), process.get("algorithms", {}))
    general, own = (one.get(run.suite, {}).get(run.controller, {}) for one in both)
    if general or own:
        inner = {run.controller: {**general, **own}}
        process["algorithms"] = configuration.over(process.get("algorithms", {}), {run.suite: inner})
    budget = given.get("budgets", {}).get(run.budget)
    return {"processes": {run.env: process}, **({"budgets": {run.budget: budget}} if budget else {})}


def write(search: Search, trials: Sequence[Trial], command: str, path: Path) -> None:
    """Writes the result as a configuration for the benchmark; other entries of the file stay.

    It includes the search's part of the user's configuration. The next command has the same
    settings by this file alone, and finds a user's model by it.

    Raises:
        ValueError: the file that is there is no configuration, or no trial has a score.
    """
    import yaml

    found = best(trials)
    there = yaml.safe_load(path.read_text(encoding="utf-8")) or {} if path.is_file() else {}
    if not isinstance(there, Mapping):
        raise ValueError(f"{path} is not a configuration: remove it, or give another file")
    about = {
        "command": command, "trials": len(trials), "stopped_early": sum(one.ended == EARLY for one in trials),
        "score": found.score, "score_before": trials[0].score, "steps": search.settings["steps"],
        "smpl": __version__, "model": search.checksum[:12], "versions": versions("optuna"),
    }  # fmt: skip
    content: dict[str, Any] = dict(json.loads(json.dumps(configuration.over(there, search.configured))))
    process = content.setdefault("processes", {}).setdefault(search.env, {})
    if process.pop("relative", False):
        process["model"] = os.path.relpath(process["model"], path.resolve().parent)
    own = search.configured.get("processes", {}).get(search.env, {}).get("algorithms", {})
    before = own.get(search.suite, {}).get(search.algorithm, {})
    for keys, value in (
        (("processes", search.env, "algorithms", search.suite), {**before, **found.hyperparameters}),
        (("tuned", search.env, search.suite), about),
    ):
        inner = content
        for key in keys:
            inner[key] = inner.get(key) or {}
            inner = inner[key]
        inner[search.algorithm] = value
    head = "# Written by `python -m smpl.benchmark tune`; the commands are below.\n"
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(head + yaml.safe_dump(content, sort_keys=False, width=120), encoding="utf-8")
    temporary.replace(path)


def _training(search: Search, data: Path, workers: int | None) -> Objective:
    """The score of hyperparameters by trainings; data sets are kept in the folder `data`."""
    if search.run is None:
        raise ValueError("a search of no run of the benchmark needs an objective")
    task = search.run.task()
    validate = validator(as_observed(task, search.settings["train"]), search.episodes, workers, TUNING)

    def objective(changed: Mapping[str, Any], report: Callable[[int, float], None]) -> float:
        hyper = {**search.settings["hyperparameters"], **changed}
        settings = {**search.settings, "hyperparameters": hyper}
        scores: list[float] = []
        for number in range(search.seeds):
            with tempfile.TemporaryDirectory() as place:
                trainer = trainer_of(search.suite, task, search.algorithm, settings, data, workers)
                seen: list[float] = []

                def follow(policy: str, seen: list[float] = seen) -> tuple[float, float, int]:
                    result = validate(policy)
                    seen.append(result[0])
                    report(len(scores) * settings["segments"] + len(seen), float(np.mean([*scores, max(seen)])))
                    return result

                seed = _NUMBERS * (search.seed + 1) + number
                learn(trainer, Path(place), settings["steps"], settings["segments"], seed, follow)
                scores.append(max(seen))
        return float(np.mean(scores))

    return objective


def _try(optuna: Any, opened: Any, trial: Any, changed: Mapping[str, Any], run: Objective) -> None:
    """Run a trial, and tell the study how it ended."""
    states = optuna.trial.TrialState

    def report(step: int, score: float) -> None:
        trial.report(score, step)
        if changed and trial.should_prune():
            raise _StoppedEarlyError

    try:
        score = run(changed, report)
    except _StoppedEarlyError:
        opened.tell(trial, state=states.PRUNED)
        return
    except (ValueError, RuntimeError, ArithmeticError) as error:
        # What cannot be trained so: the study goes on without it.
        trial.set_user_attr("error", str(error).splitlines()[0][:200] if str(error) else type(error).__name__)
        opened.tell(trial, state=states.FAIL)
        return
    opened.tell(trial, score)


def _optuna() -> Any:
    optuna = load("optuna", "tuning")
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    return optuna


def _open(optuna: Any, search: Search, study: Path) -> Any:
    """The study of a file.

    Raises:
        ValueError: it is of another search, or no study.
    """
    study.parent.mkdir(parents=True, exist_ok=True)
    about = json.loads(json.dumps(search.described()))
    with _told(study):
        opened = optuna.create_study(
            storage=f"sqlite:///{study.resolve()}", study_name="study", direction="maximize", load_if_exists=True,
            pruner=optuna.pruners.MedianPruner(n_startup_trials=_WHOLE, n_warmup_steps=_SURE),
        )  # fmt: skip
    there = opened.user_attrs.get("search")
    if there is None:
        opened.set_user_attr("search", about)
    elif there != about:
        differing = ", ".join(sorted(key for key in about if there.get(key) != about[key]))
        raise ValueError(f"{study} is another study (it differs in: {differing}): give another file")
    return opened


@contextmanager
def _told(study: Path) -> Any:
    """Converts the database's error about an invalid file into our own."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except Exception as error:
        if type(error).__module__.partition(".")[0] not in ("sqlalchemy", "sqlite3", "optuna"):
            raise
        raise ValueError(f"{study} is not a study ({str(error).splitlines()[0]}): give another file") from error


def _bury(optuna: Any, opened: Any) -> None:
    """Interrupted trials end as failures that do not count; they are proposed again."""
    states = optuna.trial.TrialState
    for one in opened.get_trials(deepcopy=False, states=(states.RUNNING,)):
        opened.tell(one.number, state=states.FAIL)


def _finished(opened: Any) -> list[Trial]:
    """The trials that count."""
    found: list[Trial] = []
    for one in opened.get_trials(deepcopy=False):
        state, error = one.state.name, one.user_attrs.get("error")
        if state in ("COMPLETE", "PRUNED") or error is not None:
            ended = {"COMPLETE": "complete", "PRUNED": EARLY}.get(state, f"failed: {error}")
            score = float(one.value) if state == "COMPLETE" else None
            found.append(Trial(len(found), one.user_attrs["hyperparameters"], score, ended))
    return found


def _propose(trial: Any, name: str, one: Any) -> Any:
    """A value of a hyperparameter."""
    if isinstance(one, list):
        # Choices other than numbers or words go by their text.
        return json.loads(trial.suggest_categorical(name, [json.dumps(choice) for choice in one]))
    low, high, log = one["low"], one["high"], bool(one.get("log", False))
    if isinstance(low, int) and isinstance(high, int):
        return int(trial.suggest_int(name, low, high, log=log))
    # Four digits are more than a search can tell apart.
    return float(f"{trial.suggest_float(name, low, high, log=log):.4g}")


def _seed(seed: int, number: int) -> int:
    return int(np.random.SeedSequence([seed, number, 11]).generate_state(1)[0])
