"""The full-information controller of every environment compared with its nominal policy.

    python python/examples/full_information.py --out full_information --seeds 3
    python python/examples/full_information.py --out full_information --table  # prints the table

The controller knows the state, the parameters of the episode and the model of the plant
(`baseline(env, "full_information")`). Every episode is a row of `full_information.csv`, so that a
stopped run resumes.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import smpl
from smpl.controllers import Nominal, baseline
from smpl.evaluation import run_episode

ENVIRONMENTS = ("reactor", "beer", "pensim", "atropine", "mab", "mab_plant")
CONTROLLERS = ("nominal", "full_information")
COLUMNS = ("environment", "controller", "seed", "return", "steps", "violations", "failure", "seconds")
# Seeds that no controller was tuned with.
FIRST_SEED = 2000
Row = dict[str, str]


def played(environment: str, controller: str, seed: int, steps: int | None) -> Row:
    """An episode as a row; seconds are those of the processor."""
    env = smpl.Env(environment, normalize=False, max_steps=steps)
    begin = time.process_time()
    made = Nominal() if controller == "nominal" else baseline(environment, "full_information")
    episode = run_episode(env, made, seed)
    values = (
        environment, controller, seed, f"{episode.total:.12g}", episode.steps, f"{episode.costs.sum():.6g}",
        episode.failure, f"{time.process_time() - begin:.1f}",
    )  # fmt: skip
    return dict(zip(COLUMNS, map(str, values), strict=True))


def read(file: Path) -> list[Row]:
    """Rows that are there."""
    if not file.is_file():
        return []
    with file.open(newline="", encoding="utf-8") as text:
        return list(csv.DictReader(text))


def write(file: Path, rows: Sequence[Row]) -> None:
    """All rows, whole or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    temporary = file.with_suffix(".tmp")
    with temporary.open("w", newline="", encoding="utf-8") as text:
        writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    temporary.replace(file)


def table(rows: Sequence[Row]) -> str:
    """The table of what is there, in Markdown: means over the seeds that both have played."""
    heads = ["environment", "seeds"]
    heads += [f"{one.replace('_', ' ')}: {what}" for one in CONTROLLERS for what in ("return", "failures, violations")]
    lines = [
        f"| {' | '.join([*heads, 'full information better in', 'an episode'])} |",
        "|" + " --- |" * (len(heads) + 2),
    ]
    for name in ENVIRONMENTS:
        found: dict[str, dict[int, Row]] = {one: {} for one in CONTROLLERS}
        for row in rows:
            if row["environment"] == name:
                found[row["controller"]][int(row["seed"])] = row
        seeds = sorted(found["nominal"].keys() & found["full_information"].keys())
        if not seeds:
            continue
        returns = {one: [float(found[one][seed]["return"]) for seed in seeds] for one in CONTROLLERS}
        cells = [name, str(len(seeds))]
        for one in CONTROLLERS:
            failures = sum(bool(found[one][seed]["failure"]) for seed in seeds)
            broken = sum(float(found[one][seed]["violations"]) for seed in seeds)
            cells += [f"{np.mean(returns[one]):.5g}", f"{failures}, {broken:.3g}"]
        better = sum(a > b for a, b in zip(returns["full_information"], returns["nominal"], strict=True))
        seconds = np.mean([float(found["full_information"][seed]["seconds"]) for seed in seeds])
        lines.append(f"| {' | '.join([*cells, f'{better} of {len(seeds)}', f'{seconds:.0f} s'])} |")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is not there yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("environments", nargs="*", default=ENVIRONMENTS, metavar="ENVIRONMENT", help="instead of all")
    parser.add_argument(
        "--out", type=Path, default=Path("full_information"), metavar="DIR", help="folder of full_information.csv"
    )
    parser.add_argument("--seeds", type=int, default=3, metavar="N", help=f"{FIRST_SEED}, {FIRST_SEED + 1} and so on")
    parser.add_argument("--steps", type=int, metavar="N", help="of an episode; those of the environment if none")
    parser.add_argument("--table", action="store_true", help="run nothing")
    given = parser.parse_args(arguments)
    unknown = [name for name in given.environments if name not in ENVIRONMENTS]
    if unknown:
        parser.error(f"no environments {', '.join(unknown)}; there are: {', '.join(ENVIRONMENTS)}")
    file = given.out / "full_information.csv"
    rows = read(file)
    for seed in range(FIRST_SEED, FIRST_SEED + (0 if given.table else given.seeds)):
        for name in given.environments:
            for one in CONTROLLERS:
                if not any((r["environment"], r["controller"], r["seed"]) == (name, one, str(seed)) for r in rows):
                    rows.append(played(name, one, seed, given.steps))
                    write(file, rows)
    print(table(rows))


if __name__ == "__main__":
    main()
