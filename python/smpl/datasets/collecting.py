"""Collection: the episodes of a plan into a data set, in parts, resumed where it was cut off."""

from __future__ import annotations

import errno
import importlib.metadata
import os
import platform
import tempfile
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from smpl._native import __version__
from smpl.controllers.identity import AnonymousError, differences
from smpl.datasets.loading import Dataset, load
from smpl.datasets.store import (
    MANIFEST,
    DatasetError,
    Manifest,
    alone,
    part_mark,
    part_path,
    place_part,
    pyarrow,
    write_part,
)
from smpl.envs import Env
from smpl.learning.agents import Agent, described
from smpl.learning.cluster import spread_on_ray
from smpl.learning.plan import Plan, Task
from smpl.learning.progress import Progress
from smpl.learning.running import batched, drawn_parameters, run
from smpl.learning.workers import spread
from smpl.loop import Settings
from smpl.support.arguments import as_count, check_names
from smpl.support.seeds import SEEDS, SeedError

# Bytes of a part before compression, and the most episodes that it may have.
PART_BYTES = 64 * 2**20
PART_EPISODES = 1024
# Entry of a controller that has no identity.
_ANONYMOUS = "anonymous"


def collect(
    env: Any,
    controller: Any,
    episodes: int,
    out: str | os.PathLike[str],
    *,
    seed: int = 0,
    workers: int | None = None,
    starts: Any = None,
    weights: Sequence[float] = (),
    noise: float = 0.0,
    epsilon: float = 0.0,
    randomize: Mapping[str, tuple[float, float]] | None = None,
    states: bool | Sequence[str] = False,
    part: int | None = None,
    progress: bool = False,
    ray: str | None = None,
    **arguments: Any,
) -> Dataset:
    """Run episodes and keep them; what the folder has already is not run again.

    Episode i is the same for any number of workers: it has the seed seed + i. Controllers that act
    on a whole batch run in the native one with `workers` threads, others in `workers` processes.

    Args:
        env: id, model's name, path, compiled model, or an environment without wrappers.
        controller: see `smpl.learning.agent`; a list is a mixture, from which each episode draws
            one.
        episodes: how many; where the folder has more, they stay, with a warning.
        out: folder of the data set; it is made if it is not there.
        seed: of the first episode.
        workers: threads or processes; all processors if none.
        starts: see `smpl.learning.Starts.of`.
        weights: shares of the controllers.
        noise: standard deviation of normal noise on actions, for actions scaled to [-1, 1].
        epsilon: probability that a step takes a uniformly random action.
        randomize: parameter -> (low, high): drawn uniformly in each episode.
        states: keep the states, all or those that are named.
        part: episodes a part; chosen by their size if none.
        progress: show a progress bar (extra `data`: tqdm).
        ray: address of a cluster of Ray that runs them, see `smpl.learning.cluster`; the files are
            the same to the bit.
        arguments: of the environment: `scenario`, `variants`, `settings`, `reward`, `observation`,
            `normalize`, `max_steps`.

    Raises:
        ValueError: an argument has an invalid value.
        DatasetError: the folder has another data set, another process is collecting into it, or an
            episode has a value that is not finite.
        RunError: an episode does not start, or its controller fails.
        ImportError: a package is missing.
    """
    pyarrow()
    plan = Plan.of(
        Task.of(env, **arguments), controller, episodes, seed=seed, weights=weights, starts=starts, noise=noise,
        epsilon=epsilon, randomize=randomize,
    )  # fmt: skip
    if plan.seed + plan.episodes > SEEDS:
        raise SeedError(f"seed is {plan.seed}, expected at most 2**64 - {plan.episodes} for {plan.episodes} episodes")
    count = as_count("workers", workers if workers is not None else os.cpu_count() or 1)
    folder, kept = Path(out), _state_names(plan.task, states)
    if folder.exists() and not folder.is_dir():
        raise DatasetError(f"{folder} is not a folder: give another place for the data set")
    folder.mkdir(parents=True, exist_ok=True)
    with alone(folder):
        _collected(plan, folder, _manifest(plan, folder, kept, part), count, ray, progress)
    return load(folder)


def _collected(plan: Plan, folder: Path, manifest: Manifest, workers: int, ray: str | None, progress: bool) -> None:
    """Run what the folder has not yet."""
    if manifest.episodes > plan.episodes:
        text = f"{folder} is a data set of {manifest.episodes} episodes, which stay: {plan.episodes} were asked for"
        warnings.warn(text, stacklevel=3)
    parts = -(-plan.episodes // manifest.part)
    missing, whole = _missing(folder, manifest, parts), manifest.range(parts - 1)[1]
    with Progress(progress, "collect", whole, whole - _episodes_in(manifest, missing)) as bar:
        try:
            for first, last in _run_parts(plan, folder, manifest, missing, workers, ray):
                bar.add(last - first)
        except OSError as error:
            if error.errno != errno.ENOSPC:
                raise
            done = manifest.parts - len(_missing(folder, manifest, manifest.parts))
            raise DatasetError(
                f"the disk is full: {folder} has {done} of {manifest.parts} parts, which are whole; free some room and "
                "run the same command to go on"
            ) from error


def _run_parts(
    plan: Plan, folder: Path, manifest: Manifest, missing: Sequence[int], workers: int, ray: str | None
) -> Iterator[tuple[int, int]]:
    """Make the parts; yields the range of each when it is there."""
    if ray is not None:
        for number, content in spread_on_ray(_sent_part, (plan, manifest), missing, ray):
            place_part(folder, number, content)
            yield manifest.range(number)
        return
    if batched(plan) or workers == 1 or len(missing) < 2:
        for number in missing:
            _make_part(plan, folder, manifest, number, workers if batched(plan) else 1)
            yield manifest.range(number)
        return
    for number, _ in spread(_work, (plan, folder, manifest), missing, workers):
        yield manifest.range(number)


def _work(shared: tuple[Plan, Path, Manifest], number: int) -> None:
    _make_part(*shared, number, 1)


def _sent_part(shared: tuple[Plan, Manifest], number: int) -> bytes:
    """A part as the bytes of its file, made on another machine."""
    with tempfile.TemporaryDirectory() as place:
        _make_part(shared[0], Path(place), shared[1], number, 1)
        return part_path(Path(place), number).read_bytes()


def _make_part(plan: Plan, folder: Path, manifest: Manifest, number: int, threads: int) -> None:
    """Run the episodes of a part and write it."""
    names = manifest.names
    settings = Settings(bool(names["states"]), tuple(names["parameters"]), threads)
    found = [(job.index, one) for job, one in run(plan, plan.jobs(*manifest.range(number)), settings)]
    chosen = [plan.task.model.state_names.index(name) for name in names["states"]]
    if chosen and len(chosen) < len(plan.task.model.state_names):
        found = [(index, replace(one, states=one.states[:, chosen])) for index, one in found]
    write_part(folder, number, manifest, sorted(found, key=lambda pair: pair[0]))


def _state_names(task: Task, states: bool | Sequence[str]) -> tuple[str, ...]:
    if isinstance(states, (bool, np.bool_)):
        return task.model.state_names if states else ()
    check_names("states", states, task.model.state_names)
    return tuple(states)


def _manifest(plan: Plan, folder: Path, states: tuple[str, ...], part: int | None) -> Manifest:
    """The manifest of the folder: the one that is there, if it is of the same plan, else a new one.

    Raises:
        DatasetError: the folder has another data set.
    """
    env = plan.task.env()
    identity, names = _identity(plan, states), _names(plan, env, states)
    if not (folder / MANIFEST).exists():
        if any(folder.glob("part-*.parquet")):
            raise DatasetError(f"{folder} has parts but no {MANIFEST}: give another folder")
        size = _part_size(plan, names) if part is None else as_count("part", part)
        manifest = Manifest(identity, names, _about(plan, env), size, plan.episodes)
    else:
        before = Manifest.read(folder)
        nameless = [one[_ANONYMOUS] for one in identity["settings"] if _ANONYMOUS in one]
        if nameless:
            raise DatasetError(
                f"{folder} has episodes already, and whether they are of this controller is unknown: {nameless[0]}"
            )
        manifest = replace(before, episodes=max(before.episodes, plan.episodes))
        there = {**manifest.identity, "states": list(manifest.names["states"])}
        here = {**identity, "states": list(states)}
        differing = [key for key in here if there.get(key) != here[key]]
        if differing:
            told = "; ".join(_told(key, there.get(key), here[key]) for key in differing)
            raise DatasetError(f"{folder} has another data set ({told}): give another folder, or remove it")
    for left in folder.glob(".*.tmp"):
        left.unlink(missing_ok=True)
    manifest.write(folder)
    return manifest


def _told(key: str, there: Any, here: Any) -> str:
    """Difference of an entry of the identity; of controllers only their differences."""
    if key == "settings" and isinstance(there, list) and len(there) == len(here):
        found = [one for pair in zip(there, here, strict=True) for one in differences(*pair)]
        more = [f"and {len(found) - 3} more"] if len(found) > 3 else []
        return f"settings: {'; '.join([*found[:3], *more])}"
    return f"{key}: {_brief(there)} there, {_brief(here)} here"


def _brief(value: Any) -> str:
    """A value as an error shows it: of many names the count."""
    return f"{len(value)} names" if isinstance(value, list) and len(value) > 8 else repr(value)


def _identity(plan: Plan, states: tuple[str, ...]) -> dict[str, Any]:
    """Inputs that determine the episodes, as JSON."""
    return {
        "model": plan.task.model.name,
        "checksum": plan.task.checksum,
        "smpl": __version__,
        "arguments": {key: str(value) for key, value in sorted(plan.task.arguments.items())},
        "seed": plan.seed,
        "controllers": [one.name for one in plan.agents],
        "settings": [_controller(one) for one in plan.agents],
        "weights": list(plan.weights),
        "starts": plan.starts.identity,
        "noise": plan.noise,
        "epsilon": plan.epsilon,
        "randomize": {name: list(ends) for name, ends in sorted(plan.randomize.items())},
        "states": len(states),
    }


def _controller(one: Agent) -> dict[str, str]:
    """Identity of a controller; one that cannot be compared is noted."""
    try:
        return described(one)
    except AnonymousError as error:
        return {_ANONYMOUS: f"{one.name}: {error}"}


def _names(plan: Plan, env: Env, states: tuple[str, ...]) -> dict[str, list[str]]:
    model = plan.task.model
    return {
        "observations": list(model.observation_names),
        "actions": list(model.action_names),
        "rewards": list(model.reward_names),
        "constraints": list(env.constraint_names),
        "states": list(states),
        "discrete": list(model.discrete_names),
        "disturbances": list(model.disturbance_names),
        "parameters": list(drawn_parameters(plan)),
        "phases": list(model.phases),
    }


def _about(plan: Plan, env: Env) -> dict[str, Any]:
    model = plan.task.model
    return {
        "env": plan.task.name,
        "reward": model.reward,
        "normalize": env.normalize,
        "step": model.step,
        "time_unit": model.time_unit,
        "max_steps": env.max_steps,
        "observation_units": list(model.observation_units),
        "action_units": list(model.action_units),
        "state_units": list(model.state_units),
        "observation_low": env.observation_low.tolist(),
        "observation_high": env.observation_high.tolist(),
        "action_low": env.action_low.tolist(),
        "action_high": env.action_high.tolist(),
        "compiled": {key: str(value) for key, value in model._arguments.items() if key not in ("path", "source")},
        "versions": {
            "python": platform.python_version(),
            **{name: importlib.metadata.version(name) for name in ("numpy", "gymnasium", "pyarrow")},
        },
    }


def _part_size(plan: Plan, names: Mapping[str, Sequence[str]]) -> int:
    """Episodes a part: sixteen parts, if each is then of a good size."""
    steps = plan.task.env().max_steps + 1
    row = 80 + sum(8 * len(columns) for columns in names.values())
    return max(1, min(-(-plan.episodes // 16), PART_BYTES // (row * steps), PART_EPISODES))


def _missing(folder: Path, manifest: Manifest, parts: int) -> list[int]:
    """Of the first parts those that are not there, or have fewer episodes than they shall have now.

    Raises:
        DatasetError: a part is damaged, or of another model.
    """
    missing = []
    for number in range(parts):
        mark = part_mark(folder, number)
        first, last = manifest.range(number)
        if mark is not None and mark["checksum"] != manifest.identity["checksum"]:
            raise DatasetError(f"{part_path(folder, number)} is of another version of the model: remove it")
        if mark is not None and mark.get("of", manifest.mark) != manifest.mark:
            raise DatasetError(f"{part_path(folder, number)} is of another collection: remove it")
        if mark is None or mark["episodes"] < last - first:
            missing.append(number)
    return missing


def _episodes_in(manifest: Manifest, numbers: Sequence[int]) -> int:
    return sum(last - first for first, last in map(manifest.range, numbers))
