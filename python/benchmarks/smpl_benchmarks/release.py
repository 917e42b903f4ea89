"""`python -m smpl.benchmark release --env ENV --quality QUALITY --out DIR`: release of a data set.

The folder gets the episodes (Parquet, `smpl.collect`), a Minari data set in `minari/`, Croissant
metadata (`croissant.json`), a data sheet (`DATASHEET.md`), the licence (`LICENSE`) and checksums
(`SHA256SUMS`).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from smpl._native import __version__
from smpl.collect import guarded, once
from smpl.datasets import Dataset, collect, to_minari
from smpl.support.optional import load
from smpl_benchmarks.recipes import QUALITIES, RECIPES, SEED, Recipe
from smpl_benchmarks.subjects import one_of

# Names of Croissant 1.0 in JSON-LD.
_CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "conformsTo": "dct:conformsTo",
    **{name: {"@id": f"cr:{name}", "@type": "@json"} for name in ("data", "examples")},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    **{
        name: f"cr:{name}"
        for name in (
            *("citeAs", "column", "equivalentProperty", "extract", "field", "fileObject", "fileProperty", "fileSet"),
            *("format", "includes", "isLiveDataset", "jsonPath", "key", "md5", "parentField", "path", "recordSet"),
            *("references", "regex", "repeated", "replace", "samplingRate", "separator", "source", "subField"),
            "transform",
        )
    },
}
LICENCE = "MIT OR Apache-2.0"
_LICENCE_URLS = ["https://spdx.org/licenses/MIT.html", "https://spdx.org/licenses/Apache-2.0.html"]
_AUTHOR = {"author": "the authors of smpl", "author_email": "smpl@example.org", "code_permalink": "smpl"}
_CITATION = "smpl: data sets of simulated industrial processes, collected by `python -m smpl.benchmark release`"
_TYPES = {"int64": "sc:Integer", "double": "sc:Float", "float": "sc:Float", "bool": "sc:Boolean", "string": "sc:Text"}
_SUMS = "SHA256SUMS"


def release(recipe: Recipe, out: str | os.PathLike[str], workers: int | None = None) -> Path:
    """Collect a data set and write metadata, data sheet, licence and checksums next to it.

    Args:
        recipe: which data set.
        out: folder; episodes that it has are not run again.
        workers: threads or processes.

    Raises:
        ImportError: pyarrow, Minari or h5py is missing.
    """
    # Minari resolves a relative folder twice.
    folder = Path(out).resolve()
    episodes = folder / "episodes"
    dataset = collect(
        f"smpl/{recipe.env}-v0", list(recipe.controllers), recipe.episodes, episodes, seed=SEED, noise=recipe.noise,
        epsilon=recipe.epsilon, starts=recipe.starts or None, workers=workers, **recipe.arguments,
    )  # fmt: skip
    _minari(recipe, dataset, folder)
    (folder / "DATASHEET.md").write_text(datasheet(recipe, dataset), encoding="utf-8")
    (folder / "LICENSE").write_text(f"SPDX-License-Identifier: {LICENCE}\n", encoding="utf-8")
    metadata = json.dumps(croissant(recipe, dataset, folder), indent=1)
    (folder / "croissant.json").write_text(metadata + "\n", encoding="utf-8")
    _write_sums(folder)
    return folder


def check(folder: str | os.PathLike[str]) -> None:
    """Compare the files of a release with its checksums.

    Raises:
        ValueError: a file is missing or has another checksum.
    """
    place = Path(folder)
    for line in (place / _SUMS).read_text(encoding="utf-8").splitlines():
        digest, _, name = line.partition("  ")
        file = place / name
        if not file.is_file() or _sha256(file) != digest:
            raise ValueError(f"{file} is {'another file' if file.is_file() else 'missing'}: download the release again")


def _minari(recipe: Recipe, dataset: Dataset, folder: Path) -> None:
    """Write the Minari data set, unless it is there."""
    minari = load("minari", "this release")
    with _datasets_path(folder / "minari"):
        if recipe.name in minari.list_local_datasets():
            return
        registered = gymnasium.spec(f"smpl/{recipe.env}-v0")
        spec = replace(registered, kwargs={**registered.kwargs, **recipe.arguments})
        texts = {"description": _purpose(recipe), "algorithm_name": ", ".join(recipe.controllers)}
        to_minari(recipe.name, dataset, spec, requirements=[f"smpl-process=={__version__}"], **texts, **_AUTHOR)


@contextmanager
def _datasets_path(path: Path) -> Iterator[None]:
    """Let Minari keep its data sets in a folder."""
    before = os.environ.get("MINARI_DATASETS_PATH")
    os.environ["MINARI_DATASETS_PATH"] = str(path)
    try:
        yield
    finally:
        if before is None:
            del os.environ["MINARI_DATASETS_PATH"]
        else:
            os.environ["MINARI_DATASETS_PATH"] = before


def croissant(recipe: Recipe, dataset: Dataset, folder: Path) -> dict[str, Any]:
    """Croissant 1.0 metadata: the Parquet files with checksums, and a field for each column."""
    parquet = load("pyarrow.parquet", "this release")
    parts = sorted(dataset.folder.glob("*.parquet"))
    files = [
        {
            "@type": "cr:FileObject",
            "@id": part.name,
            "name": part.name,
            "contentUrl": part.relative_to(folder).as_posix(),
            "encodingFormat": "application/x-parquet",
            "sha256": _sha256(part),
        }
        for part in parts
    ]
    everything = {
        "@type": "cr:FileSet",
        "@id": "parts",
        "name": "parts",
        "encodingFormat": "application/x-parquet",
        "includes": f"{dataset.folder.relative_to(folder).as_posix()}/*.parquet",
    }
    fields = [
        {
            "@type": "cr:Field",
            "@id": f"steps/{column.name}",
            "name": column.name,
            "description": _column(column.name, dataset),
            "dataType": _TYPES[str(column.type)],
            "source": {"fileSet": {"@id": "parts"}, "extract": {"column": column.name}},
        }
        for column in parquet.read_schema(parts[0])
    ]
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "name": recipe.name,
        "description": _purpose(recipe),
        "conformsTo": "http://mlcommons.org/croissant/1.0",
        "license": _LICENCE_URLS,
        "creator": {"@type": "sc:Organization", "name": _AUTHOR["author"]},
        "keywords": ["process control", "reinforcement learning", "offline learning", recipe.env],
        "version": "1.0.0",
        "citeAs": _CITATION,
        "distribution": [*files, everything],
        "recordSet": [{"@type": "cr:RecordSet", "@id": "steps", "name": "steps", "field": fields}],
    }


_COLUMNS = {
    "episode": "number of the episode in the data set",
    "step": "number of the step in its episode, from 0; the last row has the final observation and no action",
    "time": "time of the process at the observation",
    "reward": "reward of the step",
    "cost": "summed constraint violations at the observation",
    "terminated": "the process ended in this step",
    "truncated": "the time limit ended the episode in this step",
    "seed": "seed of the reset",
    "controller": "name of the controller",
    "failure": "identifier of the failure; empty without one",
    "success": "a success condition ended the episode",
    "options": "options of the reset as JSON",
}
_GROUPS = {
    "observation": "observation, scaled to [-1, 1]",
    "action": "action, scaled to [-1, 1]",
    "physical": "action in physical units",
    "rewards": "declared reward",
    "violation": "violation of a constraint, relative to its range",
}


def _column(name: str, dataset: Dataset) -> str:
    """Description of a column, with unit and range."""
    group, _, inner = name.partition(".")
    about, named = dataset.manifest.about, dataset.manifest.names
    if name == "time":
        return f"{_COLUMNS[name]}, in {about['time_unit']}"
    text = _COLUMNS.get(name) or f"{_GROUPS.get(group, group)}: {inner}"
    kind = "action" if group == "physical" else group
    if kind not in ("action", "observation") or inner not in named[f"{kind}s"]:
        return text
    place = list(named[f"{kind}s"]).index(inner)
    low, high, unit = (about[f"{kind}_{key}"][place] for key in ("low", "high", "units"))
    ends = f"{low} to {high} {unit}"
    return f"{text}, {ends}" if group == "physical" else f"{text}; -1 to 1 is {ends}"


def _purpose(recipe: Recipe) -> str:
    return (
        f"Episodes of the simulated process smpl/{recipe.env}-v0, quality {recipe.quality}, for offline reinforcement "
        f"learning and process control"
    )


def datasheet(recipe: Recipe, dataset: Dataset) -> str:
    """Data sheet (Markdown): motivation, composition, collection, uses, distribution, upkeep."""
    steps = np.array([one.steps for one in dataset])
    returns = np.array([one.total for one in dataset])
    failures = sum(bool(one.failure) for one in dataset)
    about = dataset.manifest.about
    versions = ", ".join(f"{name} {version}" for name, version in about["versions"].items())
    noise = f"noise {recipe.noise:g} on actions in [-1, 1]" if recipe.noise else "no noise on actions"
    sections = {
        "Motivation": [
            f"{_purpose(recipe)}.",
            "The process is a model; no plant, person or company is described by the data.",
        ],
        "Composition": [
            f"{len(dataset)} episodes, {int(steps.sum())} steps of {about['step']:g} {about['time_unit']}; "
            f"{int(steps.min())} to {int(steps.max())} steps per episode.",
            f"Return of an episode: mean {returns.mean():.6g}, standard deviation {returns.std():.6g}, "
            f"{returns.min():.6g} to {returns.max():.6g}.",
            f"{failures} episodes end in a failure.",
            f"Observations: {len(about['observation_units'])}, actions: {len(about['action_units'])}; "
            "names, units and limits are in `episodes/dataset.json`.",
        ],
        "Collection": [
            f"Controllers: {', '.join(recipe.controllers)}; {noise}.",
            *([f"Remark: {recipe.about}."] if recipe.about else []),
            f"Command: `{recipe.command('episodes')}`.",
            f"Seeds {SEED} to {SEED + len(dataset) - 1}; an episode is repeated exactly by its seed and its actions.",
            f"Versions: smpl {__version__}, {versions}; SHA-256 of the model: {dataset.manifest.identity['checksum']}.",
        ],
        "Uses": [
            "Score policies on the test episodes of the benchmark, not on these seeds.",
            "The data are deterministic simulations; they contain the model's errors and no measurement errors "
            "beyond those that the observation level declares.",
            "Minari: `minari.load_dataset`; d3rlpy: `d3rlpy.datasets.get_minari` or `smpl.datasets.to_d3rlpy`.",
            "`get_minari` of d3rlpy 2.8 does not remove the last observation of an episode, so that observations and "
            "actions of later episodes are misaligned; `to_d3rlpy` is not affected.",
        ],
        "Distribution": [f"Licence: {LICENCE}.", f"Checksums: `{_SUMS}`, checked by `sha256sum -c {_SUMS}`."],
        "Maintenance": ["A change of the data is a new version of the name; this version does not change."],
    }
    parts = [f"# {recipe.name}\n"]
    parts += [f"\n## {title}\n\n" + "\n".join(lines) + "\n" for title, lines in sections.items()]
    return "".join(parts)


def _write_sums(folder: Path) -> None:
    """Checksums of all files of a release, in the format of `sha256sum`."""
    files = sorted(one for one in folder.rglob("*") if one.is_file() and one.name != _SUMS and one.suffix != ".lock")
    lines = [f"{_sha256(one)}  {one.relative_to(folder).as_posix()}\n" for one in files]
    (folder / _SUMS).write_text("".join(lines), encoding="utf-8")


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(2**20):
            digest.update(block)
    return digest.hexdigest()


def main(arguments: Sequence[str]) -> int:
    """Make releases as the command line says; the exit status is 1 if that is impossible."""
    parser = argparse.ArgumentParser("python -m smpl.benchmark release", description="Make data sets for a release.")
    once(parser)
    parser.add_argument("--env", metavar="ENV", help="one process; all if missing")
    parser.add_argument("--quality", metavar="NAME", help=f"one of {', '.join(QUALITIES)}; all if missing")
    parser.add_argument("--episodes", type=int, metavar="N", help="other number of episodes than that of the recipe")
    parser.add_argument("--out", default="release", metavar="DIR", help="folder of the releases")
    parser.add_argument("--list", action="store_true", help="print the commands of the recipes and make nothing")
    parser.add_argument("--check", action="store_true", help="compare the files in --out with their checksums")
    parser.add_argument("--workers", type=int, metavar="W", help="threads or processes; default: all processors")
    given = parser.parse_args(arguments)
    return guarded(lambda: _work(given))


def _work(given: argparse.Namespace) -> int:
    if given.env is not None:
        one_of("env", given.env, tuple(dict.fromkeys(env for env, _ in RECIPES)))
    if given.quality is not None:
        one_of("quality", given.quality, QUALITIES)
    chosen = [
        replace(one, episodes=given.episodes or one.episodes)
        for (env, quality), one in RECIPES.items()
        if given.env in (None, env) and given.quality in (None, quality)
    ]
    for one in chosen:
        folder = Path(given.out) / one.name.removeprefix("smpl/")
        if given.list:
            print(one.command(str(folder / "episodes")))
        elif given.check:
            check(folder)
            print(f"{folder}: unchanged")
        else:
            print(f"{release(one, folder, given.workers)}: {one.episodes} episodes")
    return 0
