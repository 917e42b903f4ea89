"""Runs of the benchmark that train a policy: what is trained, where it is kept, and its scores."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import platform
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from smpl.learning.agents import Agent
from smpl.learning.formulation import Exploration, Form, Formulation
from smpl.learning.plan import Plan, Task
from smpl.learning.scores import score
from smpl_benchmarks.historical import trainer as historical
from smpl_benchmarks.training import Trainer, Validate, curve, diverged, learn

# Seeds of validation and of data sets are apart from those of the scores, which begin at 0.
_VALIDATION, _DATA = 500_000_000, 600_000_000
_PACKAGES = ("numpy", "gymnasium", "torch", "d3rlpy", "stable-baselines3", "sb3-contrib", "ray")


def versions(*more: str) -> dict[str, str]:
    """Versions of Python and of the packages that are there, of `more` too."""
    found = {"python": platform.python_version()}
    for name in (*_PACKAGES, *more):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def train_and_score(
    suite: str,
    task: Task,
    algorithm: str,
    number: int,
    plan_of: Mapping[str, int],
    settings: Mapping[str, Any],
    folder: Path,
    data: Path,
    workers: int | None,
) -> dict[str, Any]:
    """Train a policy and score it, or go on where that stopped.

    Args:
        suite: `offline` or `online`.
        task: the environment of the scores.
        algorithm: its name.
        number: of the seed.
        plan_of: `seed` and `episodes` of the scores.
        settings: see `smpl_benchmarks.configuration`.
        folder: of the run.
        data: where data sets are kept, which runs share.
        workers: threads or processes.

    Returns:
        What `scores.json` holds.

    Raises:
        ImportError: a package is missing.
    """
    trainer = trainer_of(suite, task, algorithm, settings, data, workers)
    folder.mkdir(parents=True, exist_ok=True)
    task = as_observed(task, settings["train"])
    validate = validator(task, settings["validation"], workers)
    spec = learn(trainer, folder, settings["steps"], settings["segments"], number, validate)
    # Of all segments, whichever process ran them.
    trained = sum(row["seconds"] for row in curve(folder))
    begin = time.perf_counter()
    prefix, _, name = spec.rpartition(":")
    policy = f"{prefix}:{folder / name}" if prefix else str(folder / name)
    plan = Plan.of(task, policy, plan_of["episodes"], seed=plan_of["seed"], randomize=settings.get("randomize"))
    report = score(plan, workers, kept=0).report()
    ended = {"policy": spec, "training_seconds": trained, "seconds": trained + time.perf_counter() - begin}
    segment = diverged(folder)
    return {**report, **ended, **({} if segment is None else {"diverged": segment})}


def trainer_of(
    suite: str, task: Task, algorithm: str, settings: Mapping[str, Any], data: Path, workers: int | None
) -> Trainer:
    """The trainer of an algorithm; arguments as of `train_and_score`.

    Raises:
        ImportError: a package is missing.
        ValueError: an unknown hyperparameter.
    """
    formulation = Formulation.of(settings["formulation"])
    arguments = {**_arguments(task), **settings["train"]}
    learned = Task.of(task.name, **arguments)
    hyper = settings["hyperparameters"]
    if algorithm in historical.OFFLINE:
        historical.python("offline")
        data_set = _data_set(learned, arguments, settings, data, workers)
        return historical.offline_trainer(algorithm, data_set, formulation, hyper, _form(learned, settings))
    if algorithm in historical.ONLINE:
        return historical.online_trainer(algorithm, learned, formulation, hyper)
    if suite == "offline":
        from smpl_benchmarks.offline import D3rlpyTrainer, needs

        needs("d3rlpy")
        scalers = settings.get("scalers", {})
        data_set = _data_set(learned, arguments, settings, data, workers)
        return D3rlpyTrainer(algorithm, data_set, formulation, hyper, scalers, _form(learned, settings))
    if algorithm.startswith("RLlib-"):
        from smpl_benchmarks.rllib import RLlibTrainer

        return RLlibTrainer(algorithm, learned, formulation, hyper, settings["num_envs"])
    if algorithm in ("SHAC", "DiffNMPC"):
        return _by_derivatives(algorithm, task, arguments, formulation, settings)
    from smpl_benchmarks.online import StableBaselinesTrainer

    curriculum = settings["curriculum"]
    return StableBaselinesTrainer(algorithm, learned, formulation, hyper, settings["num_envs"], curriculum)


def _by_derivatives(
    algorithm: str, task: Task, arguments: dict[str, Any], formulation: Formulation, settings: Mapping[str, Any]
) -> Trainer:
    """The trainer of an algorithm on the process with the statements that it adds for training."""
    from smpl_benchmarks.predictive import PredictiveTrainer
    from smpl_benchmarks.short_horizon import ShortHorizonTrainer

    hyper = dict(settings["hyperparameters"])
    own = {name: hyper.pop(name) for name in ("extra", "reward") if name in hyper}
    learned, curriculum = Task.of(task.name, **{**arguments, **own}), settings["curriculum"]
    if algorithm == "DiffNMPC":
        if curriculum:
            raise NotImplementedError("DiffNMPC does not train with parameters that are drawn in each episode")
        return PredictiveTrainer(learned, formulation, hyper)
    return ShortHorizonTrainer(learned, formulation, hyper, settings["num_envs"], curriculum)


def _arguments(task: Task) -> dict[str, Any]:
    """Arguments that make the task again."""
    kept = {key: value for key, value in task.model._arguments.items() if key not in ("path", "source") and value}
    return {**kept, **task.arguments}


def as_observed(task: Task, train: Mapping[str, Any]) -> Task:
    """The task with the observations that the policy was trained on; its rewards stay."""
    if "observation" not in train:
        return task
    return Task.of(task.name, **{**_arguments(task), "observation": train["observation"]})


def _form(task: Task, settings: Mapping[str, Any]) -> Form | None:
    """Formulation of the data set and its policy; None if they have the environment's actions."""
    return Form(Formulation.of(settings["formulation"]), task.env()) if inside_formulation(settings) else None


def inside_formulation(settings: Mapping[str, Any]) -> bool:
    """True for a data set of the centre of its formulation.

    Policies then have the actions and observations of the formulation.
    """
    return bool(settings["data"]["controller"] == "centre")


def _data_set(
    task: Task, arguments: Mapping[str, Any], settings: Mapping[str, Any], data: Path, workers: int | None
) -> Any:
    """The data set of the offline suite; `centre` is the formulation's controller, with noise."""
    from smpl.datasets import collect

    chosen = {key: settings["data"][key] for key in ("controller", "noise", "episodes")}
    controller, noise, known = chosen["controller"], chosen["noise"], [chosen, task.checksum]
    inside = inside_formulation(settings)
    if inside:
        formulation = Formulation.of(settings["formulation"])
        controller, noise = Agent("centre", Exploration(formulation, noise)), 0.0
        known.append(asdict(formulation))
    text = json.dumps(known, sort_keys=True, default=str)
    folder = data / f"{task.model.name}-{hashlib.sha256(text.encode()).hexdigest()[:12]}"
    folder.parent.mkdir(parents=True, exist_ok=True)
    return collect(
        task.name, controller, chosen["episodes"], folder, seed=_DATA, noise=noise, states=inside, workers=workers,
        **arguments,
    )  # fmt: skip


def validator(task: Task, episodes: int, workers: int | None, seed: int = _VALIDATION) -> Validate:
    """A function that scores a policy on the episodes from `seed` on."""

    def validate(policy: Any) -> tuple[float, float, int]:
        found = score(Plan.of(task, policy, episodes, seed=seed), workers, kept=0)
        return found.pooled()[0], float(found.returns.mean()), sum(bool(one.failure) for one in found.summaries)

    return validate
