"""Configuration of the suites of learned policies: `benchmark.yaml` and a user's file."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from smpl.learning.environments import Curriculum
from smpl.learning.formulation import Formulation
from smpl.support.arguments import as_count, as_number, check_names
from smpl.support.optional import load

OWN = Path(__file__).with_name("benchmark.yaml")
# Hyperparameters that `python -m smpl.benchmark tune` has found, with its commands; they lie over
# the others.
TUNED = Path(__file__).with_name("tuned.yaml")
SUITES = ("offline", "online")
# Algorithms that learn from what the present policy has done, and those that search without
# gradients.
_ON_POLICY, _SEARCH = ("PPO", "A2C", "RecurrentPPO"), ("ARS",)
# Algorithms that need the derivatives of each step, which cost more than the step; and those that
# solve a programme in each step too.
_GRADIENT, _PREDICTIVE = ("SHAC",), ("DiffNMPC",)
# These update after each step, as those of Stable-Baselines3 do.
_OFF_POLICY_2022 = ("DDPG-2022", "SAC-2022")
_PROCESS = (
    "train",
    "formulation",
    "data",
    "scalers",
    "curriculum",
    "steps",
    "segments",
    "sizes",
    "num_envs",
    "algorithms",
    "spaces",
)
# Keys that describe a user's process, and the runs in addition to its declared policies.
_OF_ONES_OWN, _BESIDE = ("model", "arguments"), "controllers"
_SIZES = ("validation", "data")
# What a number of steps is of, see `_kind`; what a data set is made by.
_KINDS = ("offline", "on_policy", "off_policy", "search", "rllib", "gradient", "predictive")
_DATA = ("controller", "noise", "episodes")
# Classes of d3rlpy that scale what a network sees, by the statistics of a data set.
SCALERS = {
    "observation": {"standard": "StandardObservationScaler", "min_max": "MinMaxObservationScaler"},
    "action": {"min_max": "MinMaxActionScaler"},
    "reward": {"standard": "StandardRewardScaler", "min_max": "MinMaxRewardScaler"},
}
_PARTS = ("budgets", "algorithms", "spaces", "processes", "tuned")
_BUDGET = ("segments", "validation", "data", "num_envs", "steps", "hyperparameters")


def read(path: str | os.PathLike[str] | None = None, tuned: bool = True, own: Iterable[str] = ()) -> dict[str, Any]:
    """The configuration.

    Args:
        path: a file over the one of this package.
        tuned: with the hyperparameters that were tuned for the package.
        own: processes that are not in the package, for which the file need not name the model.

    Raises:
        ImportError: PyYAML is missing.
        ValueError: the file is not a configuration, or has unknown names.
    """
    yaml = load("yaml", "this suite")
    package, found = (yaml.safe_load(file.read_text(encoding="utf-8")) for file in (OWN, TUNED))
    base: dict[str, Any] = over(package, found if tuned else {"tuned": {}})
    if path is None:
        return base
    given = of_file(path)
    _check(given, base, tuple(own))
    return over(base, given)


def of_file(path: str | os.PathLike[str]) -> Mapping[str, Any]:
    """Content of a user's file, without the configuration of this package beneath.

    Raises:
        ValueError: the file is not a configuration.
    """
    import yaml

    try:
        given = yaml.safe_load(Path(path).read_text(encoding="utf-8")) or {}
    except (OSError, yaml.YAMLError) as error:
        raise ValueError(f"configuration {str(path)!r}: {error}") from error
    if not isinstance(given, Mapping):
        raise ValueError(f"configuration {str(path)!r}: expected a mapping with {', '.join(_PARTS)}")
    return given


def algorithms(configuration: Mapping[str, Any], suite: str) -> tuple[str, ...]:
    """Names of the algorithms of a suite."""
    return tuple(configuration["algorithms"][suite])


def settings(configuration: Mapping[str, Any], suite: str, env: str, algorithm: str, budget: str) -> dict[str, Any]:
    """All that a run is trained with, as JSON has it.

    Raises:
        ValueError: an invalid number or formulation.
    """
    sizes, process = configuration["budgets"][budget], configuration["processes"].get(env, {})
    own = process.get("algorithms", {}).get(suite, {}).get(algorithm, {})
    kind = _kind(suite, algorithm)
    sized = sizes.get("hyperparameters", {}).get(suite, {}).get(algorithm, {})
    # `smoke` only shortens runs; in other budgets the entries of a process come first.
    ordered = (own, sized) if budget == "smoke" else (sized, own)
    hyper = {**configuration["algorithms"][suite][algorithm], **ordered[0], **ordered[1]}
    steps = {**sizes["steps"], **process.get("steps", {}).get(budget, {})}
    whole = {**sizes, **process.get("sizes", {}).get(budget, {})}
    chosen = {
        "train": process.get("train", {}),
        "formulation": process.get("formulation", {}),
        "curriculum": process.get("curriculum", {}),
        "hyperparameters": hyper,
        "steps": as_count("steps", steps[kind]),
        "segments": as_count("segments", process.get("segments", {}).get(budget, sizes["segments"])),
        "validation": as_count("validation", whole["validation"]),
        "num_envs": as_count("num_envs", sizes["num_envs"] if budget == "smoke" else process.get("num_envs", 32)),
    }
    if suite == "offline":
        collected = {"controller": "nominal", "noise": 0.1, "episodes": whole["data"]}
        chosen["data"] = {**collected, **process.get("data", {})}
        as_count("data.episodes", chosen["data"]["episodes"])
        noise = as_number("data.noise", chosen["data"]["noise"])
        if not 0 <= noise < float("inf"):
            raise ValueError(f"data.noise is {noise}, expected a number that is not negative")
        if process.get("scalers"):
            chosen["scalers"] = process["scalers"]
            check_scalers(chosen["scalers"])
    if kind == "search":
        # Each of these runs the same policy, and the ones beyond the episodes that are counted
        # would run for nothing.
        chosen["num_envs"] = min(chosen["num_envs"], as_count("n_eval_episodes", hyper.get("n_eval_episodes", 1)))
    Formulation.of(chosen["formulation"])
    Curriculum(chosen["curriculum"])
    return chosen


def check_scalers(given: Mapping[str, str]) -> None:
    """Refuse scalers that there are not.

    Raises:
        ValueError: one is not; the message lists those that are.
    """
    check_names("scalers", given, SCALERS)
    for what, kind in given.items():
        if kind not in SCALERS[what]:
            raise ValueError(f"scalers[{what!r}] is {kind!r}; there are: {', '.join(SCALERS[what])}")


def _kind(suite: str, algorithm: str) -> str:
    if suite == "offline":
        return "offline"
    if algorithm in _OFF_POLICY_2022:
        return "off_policy"
    if algorithm.startswith("RLlib-") or algorithm.endswith("-2022"):
        return "rllib"
    if algorithm in _SEARCH:
        return "search"
    if algorithm in _GRADIENT:
        return "gradient"
    if algorithm in _PREDICTIVE:
        return "predictive"
    return "on_policy" if algorithm in _ON_POLICY else "off_policy"


def _check(given: Mapping[str, Any], base: Mapping[str, Any], own: Sequence[str]) -> None:
    check_names("configuration", given, tuple(base))
    for name, one in _section("budgets", given.get("budgets", {}), tuple(base["budgets"])).items():
        sizes = _section(f"budgets.{name}", one, _BUDGET)
        _section(f"budgets.{name}.steps", sizes.get("steps", {}), _KINDS)
        _check_algorithms(f"budgets.{name}.hyperparameters", sizes.get("hyperparameters", {}), base)
    for name, one in _section("processes", given.get("processes", {})).items():
        _check_process(name, _section(f"processes.{name}", one), base, own)
    _check_algorithms("algorithms", given.get("algorithms", {}), base)
    _check_algorithms("spaces", given.get("spaces", {}), base)


def _check_process(name: str, one: Mapping[str, Any], base: Mapping[str, Any], own: Sequence[str]) -> None:
    known, what = name in base["processes"], f"processes.{name}"
    if not (known or name in own or "model" in one):
        listed = ", ".join(base["processes"])
        raise ValueError(f"processes: unknown {name!r}; there are: {listed}; one of your own has `model: PATH`")
    check_names(what, one, (*_PROCESS, *(() if known else (_BESIDE, *_OF_ONES_OWN))))
    if not isinstance(one.get(_BESIDE, {}), Mapping):
        raise ValueError(f"{what}.{_BESIDE} is {one[_BESIDE]!r}, expected NAME: CONTROLLER")
    for folder in (name, *one.get(_BESIDE, {})):
        if not re.fullmatch(r"[A-Za-z0-9_-]+", str(folder)):
            raise ValueError(f"{folder!r} in processes: expected letters, digits, - and _, as names of folders")
    for key in ("train", "formulation", "curriculum", "scalers", "arguments"):
        _section(f"{what}.{key}", one.get(key, {}))
    try:
        Formulation.of(one.get("formulation"))
    except ValueError as error:
        raise ValueError(f"{what}.formulation: {error}") from error
    _section(f"{what}.data", one.get("data", {}), _DATA)
    budgets = tuple(base["budgets"])
    for key, inner in (("steps", _KINDS), ("sizes", _SIZES)):
        for budget, sizes in _section(f"{what}.{key}", one.get(key, {}), budgets).items():
            _section(f"{what}.{key}.{budget}", sizes, inner)
    _section(f"{what}.segments", one.get("segments", {}), budgets)
    _check_algorithms(f"{what}.algorithms", one.get("algorithms", {}), base)
    _check_algorithms(f"{what}.spaces", one.get("spaces", {}), base)


def _check_algorithms(what: str, given: Any, base: Mapping[str, Any]) -> None:
    """Refuses everything but a mapping from suites to algorithms to names."""
    for suite, one in _section(what, given, SUITES).items():
        for algorithm, named in _section(f"{what}.{suite}", one, tuple(base["algorithms"][suite])).items():
            _section(f"{what}.{suite}.{algorithm}", named)


def _section(what: str, given: Any, known: Sequence[str] | None = None) -> Mapping[str, Any]:
    """A part of the file, which is a mapping, of these names if there are any.

    Raises:
        ValueError: it is not a mapping, or has other names; the message lists the valid ones.
    """
    if not isinstance(given, Mapping):
        raise ValueError(f"{what} is {given!r}, expected a mapping" + (f" of {', '.join(known)}" if known else ""))
    if known is not None:
        check_names(what, given, known)
    return given


def over(base: Any, given: Any) -> Any:
    """`given` laid over `base`, mapping by mapping."""
    if not (isinstance(base, Mapping) and isinstance(given, Mapping)):
        return given
    return {**base, **{key: over(base.get(key), value) for key, value in given.items()}}
