"""`python -m smpl.published --out DIR`: published figures and those of this package.

A row is a controller in an environment of the original implementation (`legacy`). Its episodes are
run in parts, each added to a file, so that what was stopped goes on; the table is made of the
files. A row reports missing requirements of this installation instead of its figures.

The figures are those of the SMPL paper and its data sets: mean and population standard deviation
over all steps.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from smpl._native import __version__
from smpl.collect import guarded
from smpl.controllers import Constant, baseline
from smpl.envs import Env
from smpl.evaluation import Episode, run_episode
from smpl.learning import Plan, Task
from smpl.learning.progress import Progress
from smpl.learning.reports import text_table
from smpl.learning.scores import Summary, score
from smpl.model import Model, compile
from smpl.support.arguments import FloatArray, as_count

# Seeds of a repetition are apart from those of the next.
_APART = 1_000_000
_PART = 100
Part = list[dict[str, Any]]


@dataclass(frozen=True)
class Row:
    """One published figure and what reproduces it.

    Attributes:
        name: of the row, for the command line.
        env: name of the environment.
        arguments: of the environment.
        controller: name of a baseline, or a function that makes the controller.
        mean, deviation: as published; deviation may be None.
        what: what they are and where they are from.
        episodes: in a repetition; repetitions: with other seeds.
        options: of the baseline.
        starts: where the episodes start, see `smpl.learning`.
        special: function that runs the episodes of a repetition.
        returns: whether the published figure is one of returns, not of steps.
    """

    name: str
    env: str
    arguments: dict[str, Any]
    controller: str | Callable[[], Any]
    mean: float
    deviation: float | None
    what: str
    episodes: int = 1
    repetitions: int = 1
    options: dict[str, Any] = field(default_factory=dict)
    starts: Any = None
    special: Callable[[Row, int], Iterable[Episode]] | None = None
    returns: bool = False

    def made(self) -> Any:
        """The controller."""
        return self.controller() if callable(self.controller) else baseline(self.env, self.controller, **self.options)


def original_seed() -> tuple[dict[str, float], dict[str, float], FloatArray]:
    """State, parameters and disturbances of the original PenSim's batch with seed 1."""

    def draw(offset: int) -> float:
        return float(np.random.RandomState(1 + offset).randn())

    biomass = 0.5 + 0.05 * draw(31)
    state = {
        "a0": biomass * 0.3333333333333333,
        "a1": biomass * 0.6666666666666666,
        "S": 1 + 0.1 * draw(33),
        "DO2": 15 + 0.5 * draw(34),
        "V": 58000 + 500 * draw(36),
        "Wt": 62000 + 500 * draw(37),
        "CO2out": 0.038 + 0.001 * draw(38),
        "O2": 0.2 + 0.05 * draw(39),
        "H": 10 ** -(6.5 + 0.1 * draw(40)),
        "T": 297 + 0.5 * draw(41),
        "PAA": 1400 + 50 * draw(43),
        "NH3": 1700 + 50 * draw(44),
    }
    parameters = {
        "mux_max": 0.41 + 0.025 * draw(31),
        "mu_p": 0.041 + 0.0025 * draw(32),
        "alpha_kla": 85 + 10 * draw(45),
        "PAA_c": 530000 + 20000 * draw(46),
        "N_conc_paa": 150000 + 2000 * draw(47),
    }
    noise = np.random.RandomState(1).randn(1151)
    z = np.zeros(1150)
    for k in range(1150):
        z[k] = (0.995 * z[k - 1] if k else 0.0) + 0.005 * noise[k]
    return state, parameters, z


def _nominal_start(row: Row, repetition: int) -> Iterable[Episode]:
    env = Env(Task.of(f"smpl/{row.env}-v0", **row.arguments).model, normalize=False)
    yield run_episode(env, row.made(), repetition, {"start": "nominal"})


def _seed_one(row: Row, repetition: int) -> Iterable[Episode]:
    env = Env(Task.of(f"smpl/{row.env}-v0", **row.arguments).model, normalize=False)
    state, parameters, z = original_seed()
    options = {"start": "nominal", "state": state, "parameters": parameters, "disturbances": {"z": z}}
    yield run_episode(env, row.made(), repetition, options)


def _chained(row: Row, repetition: int) -> Iterable[Episode]:
    """Only the first episode starts from a sample; others start at the end of the last one."""
    env = Env(Task.of(f"smpl/{row.env}-v0", **row.arguments).model, normalize=False)
    options: dict[str, Any] | None = None
    for number in range(row.episodes):
        yield run_episode(env, row.made(), repetition * _APART + number, options)
        discrete = dict(zip(env.discrete_names, env.discrete.tolist(), strict=True))
        options = {"state": env.state, "discrete": {name: discrete[name] for name in ("xe1", "xe2")}}


def _cold() -> Constant:
    return Constant([9.0], actions=("T",))


_REACTOR = {"scenario": "legacy", "reward": "setpoint_change"}
_ATROPINE = {"scenario": "legacy", "settings": {"reward_scale": 1e5}}
_PENSIM = {"variants": ("long_step", "basic_branch"), "settings": {"visc_exp": 0}}
_MAB = {"scenario": "legacy"}
ROWS = (
    Row("reactor-pid", "Reactor", _REACTOR, "pid", -1.0823, 35.0924, "table 2: 1000 starts", 1000, 3),
    Row("reactor-mpc", "Reactor", _REACTOR, "mpc", -0.1912, 15.9328, "table 2: 1000 starts", 1000, 3),
    Row(
        "reactor-data", "Reactor", {"scenario": "legacy", "reward": "setpoint"}, "mpc", -3.7528, 60.4470,
        "table 1: the data set on the unclipped grid of 1000 starts", 1000, 1, starts="unclipped_grid:0.3:10",
    ),
    Row(
        "beer-profile", "Beer", {"scenario": "legacy"}, "profile", 55.0, None,
        "return of the industrial profile from the nominal start", special=_nominal_start, returns=True,
    ),
    Row(
        "beer-endless", "Beer", {"scenario": "legacy"}, _cold, -1.9900, 14.0014,
        "a batch that never ends (PG in table 2)", special=_nominal_start,
    ),
    Row(
        "pensim-recipe", "PenSim", _PENSIM, "recipe", 3640.12, None,
        "yield in kg of the recipe, seed 1 of the original", special=_seed_one, returns=True,
    ),
    Row(
        "pensim-gpei", "PenSim", _PENSIM, "gpei", 3.3071, 1.4673,
        "the data set: clipped rewards of 10 random recipes and 1000 searches",
    ),
    Row(
        "atropine-mpc", "Atropine", _ATROPINE, "mpc", -20.6094, 339.5105,
        "table 2, rewards times 1e5: 100 episodes of which the first starts from a sample", 100, 6, special=_chained,
    ),
    Row(
        "atropine-mpc-sampled", "Atropine", _ATROPINE, "mpc", -882.2, 1869.8,
        "the original, rewards times 1e5: every episode starts from a sample", 25, 3,
    ),
    Row(
        "atropine-zero-sampled", "Atropine", _ATROPINE, "zero", -790.6, None,
        "the original, rewards times 1e5: the same without control", 25, 3,
    ),
    Row("mab-nominal", "MAb", _MAB, "nominal", 1350.25, 32.46, "the original: 16 sampled starts", 16, 3),
    Row("mab-mpc", "MAb", _MAB, "mpc", 1332.86, 17.78, "the original: a feasible start", special=_nominal_start),
    Row(
        "mab-empc", "MAb", {"scenario": "legacy", "variants": ("wide_bounds",)}, "empc", 1350.02, 12.91,
        "the original: a feasible start, wide bounds", special=_nominal_start,
    ),
)  # fmt: skip


def published(
    out: str | Path,
    names: Sequence[str] = (),
    *,
    scale: float = 1.0,
    searches: int = 1000,
    workers: int | None = None,
    progress: bool = False,
    run: bool = True,
) -> list[dict[str, Any]]:
    """Run what is not there yet and make the table.

    Args:
        out: folder of the parts; the table goes to `table.md` and `table.json`.
        names: rows; all if empty.
        scale: share of the episodes.
        searches: of the row `pensim-gpei`.
        workers: threads or processes; all processors if none.
        progress: show a bar.
        run: false makes the table of what is there.

    Raises:
        ValueError: an unknown row, or an invalid share.
    """
    known = [row.name for row in ROWS]
    wrong = [name for name in names if name not in known]
    if wrong:
        raise ValueError(f"no rows {', '.join(wrong)}; there are: {', '.join(known)}")
    if not 0 < scale <= 1:
        raise ValueError(f"scale is {scale}, expected a share of the episodes above 0")
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    table = []
    for row in [row for row in ROWS if not names or row.name in names]:
        try:
            if row.controller == "gpei":
                figures = _searched(folder / row.name, as_count("searches", searches), row, progress, run)
            else:
                figures = _measured(folder / row.name, row, scale, workers, progress, run)
        except (ImportError, NotImplementedError) as error:
            figures = {"skipped": str(error)}
        told = {"row": row.name, "what": row.what, "published": [row.mean, row.deviation]}
        table.append({**told, **figures})
    _write(folder / "table.json", json.dumps({"smpl": __version__, "rows": table}, indent=1))
    _write(folder / "table.md", _markdown(table))
    return table


def _measured(folder: Path, row: Row, scale: float, workers: int | None, progress: bool, run: bool) -> dict[str, Any]:
    """Figures of a row over its repetitions, of the parts that are there."""
    count = max(1, round(row.episodes * scale)) if row.special is None else row.episodes
    size = _PART if row.special is None else count
    begin = time.perf_counter()
    repetitions = []
    with Progress(progress, row.name, count * row.repetitions) as bar:
        for repetition in range(row.repetitions):
            file = folder / f"repetition-{repetition}.csv"
            found = _read_part(file)[:count]
            first = len(found) if len(found) == count or row.special is None else 0
            bar.add(first)
            while first < count and run:
                fresh = _part(row, repetition, first, min(size, count - first), workers)
                folder.mkdir(parents=True, exist_ok=True)
                _write(file, _as_text(found[:first] + fresh))
                found, first = _read_part(file), first + len(fresh)
                bar.add(len(fresh))
            if found:
                repetitions.append(found)
    if not repetitions:
        return {"skipped": "not run yet"}
    return {**_figures(repetitions), "of_returns": row.returns, "seconds": time.perf_counter() - begin}


_COLUMNS = ("steps", "return", "squares", "failure")


def _as_text(part: Part) -> str:
    """Episodes as a table; numbers that do not come out whole have twelve digits."""
    rows = (f"{one['steps']},{one['mean'] * one['steps']:.12g},{one['squares']:.12g},{one['failure']}" for one in part)
    return "\n".join([",".join(_COLUMNS), *rows])


def _read_part(file: Path) -> Part:
    """Episodes of a table; none where it is not there."""
    if not file.is_file():
        return []
    lines = [line.split(",", 3) for line in file.read_text(encoding="utf-8").splitlines()[1:]]
    return [
        {"steps": int(steps), "mean": float(total) / int(steps), "squares": float(squares), "failure": failure}
        for steps, total, squares, failure in lines
    ]


def _part(row: Row, repetition: int, first: int, count: int, workers: int | None) -> Part:
    """Episodes of a repetition in few numbers."""
    if row.special is not None:
        return [_numbers(episode) for episode in row.special(row, repetition)]
    task = Task.of(f"smpl/{row.env}-v0", **row.arguments)
    seed = repetition * _APART + first
    # By its name every process makes its own: a predictive controller that was used cannot be sent.
    controller = row.made() if callable(row.controller) or row.options else row.controller
    if row.starts is None:
        plan = Plan.of(task, controller, count, seed=seed)
        return [_of_summary(one) for one in score(plan, workers, kept=0).summaries]
    whole = Plan.of(task, controller, first + count, seed=repetition * _APART, starts=row.starts)
    states = whole.starts.states
    assert states is not None
    plan = Plan.of(task, controller, count, seed=seed, starts=states[first : first + count])
    return [_of_summary(one) for one in score(plan, workers, kept=0).summaries]


def _of_summary(one: Summary) -> dict[str, Any]:
    return {"steps": one.steps, "mean": one.mean, "squares": one.squares, "failure": one.failure}


def _numbers(episode: Episode) -> dict[str, Any]:
    squares = float(((episode.rewards - episode.rewards.mean()) ** 2).sum())
    return {
        "steps": episode.steps,
        "mean": float(episode.rewards.mean()),
        "squares": squares,
        "failure": episode.failure,
    }


def _figures(repetitions: list[Part]) -> dict[str, Any]:
    """Pooled mean and deviation over all steps, and the same of each repetition."""
    pooled = [_pooled(part) for part in repetitions]
    every = [one for part in repetitions for one in part]
    mean, deviation = _pooled(every)
    totals = [one["mean"] * one["steps"] for one in every]
    return {
        "mean": mean,
        "std": deviation,
        "return": float(np.mean(totals)),
        "means": [one[0] for one in pooled],
        "stds": [one[1] for one in pooled],
        "returns": [float(np.mean([one["mean"] * one["steps"] for one in part])) for part in repetitions],
        "episodes": len(every),
        "failures": sum(bool(one["failure"]) for one in every),
    }


def _pooled(part: Part) -> tuple[float, float]:
    steps = np.array([one["steps"] for one in part], dtype=np.float64)
    means = np.array([one["mean"] for one in part])
    mean = float((steps * means).sum() / steps.sum())
    squares = sum(one["squares"] for one in part) + float((steps * (means - mean) ** 2).sum())
    return mean, float(np.sqrt(squares / steps.sum()))


def _searched(folder: Path, searches: int, row: Row, progress: bool, run: bool) -> dict[str, Any]:
    """The search over recipes, with points in `search.csv`; figures of clipped rewards."""
    from smpl.controllers.bayesian import BayesianOptimization
    from smpl.controllers.pensim import FEED, Recipe

    folder.mkdir(parents=True, exist_ok=True)
    model = compile("pensim", **row.arguments)
    recipe = Recipe(model)
    batches = _Batches(model, recipe, FEED, folder / "batches.csv")
    search = BayesianOptimization(
        recipe.low, recipe.high, names=recipe.names, initial=10, batch=4, decimals=3, file=folder / "search.csv"
    )
    begin = time.perf_counter()
    # Of a finished search the batches say all; its points need not be there.
    finished = not len(search.values) and len(batches.there()) >= 10 + searches
    if run and not finished and len(search.values) < 10 + searches:
        batches.keep(len(search.values))
        with Progress(progress, row.name, 10 + searches, len(search.values)) as bar:
            done = [len(search.values)]

            def told(count: int, best: float) -> None:
                bar.add(count - done[0])
                done[0] = count

            search.run(lambda points: batches.run(points)[:, 0], 10 + searches, told)
    rows = batches.of(search.points) if len(search.values) else batches.there()
    if not len(rows):
        return {"skipped": "not run yet"}
    values = rows[:, 0]
    count = rows[:, 2].sum()
    mean = float(rows[:, 0].sum() / count)
    deviation = float(np.sqrt(rows[:, 1].sum() / count - mean**2))
    found = values[10:] if len(values) > 10 else values
    figures = {"mean": mean, "std": deviation, "return": float(found.mean()), "of_returns": False}
    repeated = {"means": [mean], "stds": [deviation], "returns": [float(found.mean())]}
    counts = {"episodes": len(rows), "failures": int((rows[:, 2] < model.max_steps).sum())}
    best = {"best": float(values.max()), "searches": len(values) - 10}
    return {**figures, **repeated, **counts, **best, "seconds": time.perf_counter() - begin}


class _Batches:
    """Batches of PenSim with the original's seed 1: sums, squares and steps of clipped rewards."""

    def __init__(self, model: Model, recipe: Any, feed: str, file: Path) -> None:
        self._model, self._recipe, self._feed, self._file = model, recipe, feed, file
        state, self._parameters, self._z = original_seed()
        nominal = dict(zip(model.state_names, recipe.start.tolist(), strict=True))
        self._start = np.array([state.get(name, nominal[name]) for name in model.state_names])

    def run(self, points: FloatArray) -> FloatArray:
        """Rows (sum, squares, steps) of points, written to the file."""
        plans = np.stack([self._recipe.actions(point) for point in points])
        parameters: dict[str, Any] = {**self._parameters, self._feed: points[:, -1]}
        found = self._model.rollout(self._start, plans, parameters=parameters, disturbances={"z": self._z})
        clipped = np.maximum(found.rewards, 0)
        rows = np.stack([clipped.sum(axis=1), (clipped**2).sum(axis=1), found.steps.astype(np.float64)], axis=1)
        with self._file.open("a", encoding="utf-8") as text:
            text.writelines(",".join(map(repr, row)) + "\n" for row in rows.tolist())
        return rows

    def there(self) -> FloatArray:
        """Rows of the file, (n, 3)."""
        if not self._file.is_file():
            return np.zeros((0, 3))
        text = self._file.read_text(encoding="utf-8")
        lines = [line.split(",") for line in text[: text.rfind("\n") + 1].splitlines()]
        return np.array(lines, dtype=np.float64).reshape(-1, 3)

    def keep(self, count: int) -> None:
        """Removes rows of the file without a point of the search, which was stopped before."""
        if self._file.is_file():
            rows = self._file.read_text(encoding="utf-8").splitlines(keepends=True)[:count]
            self._file.write_text("".join(rows), encoding="utf-8")

    def of(self, points: FloatArray) -> FloatArray:
        """Rows of all points of a search; those that the file has are not run again."""
        there = self.there()[: len(points)]
        rest = points[len(there) :]
        if len(rest):
            self.keep(len(there))
        pieces = [self.run(rest[first : first + 64]) for first in range(0, len(rest), 64)]
        return np.vstack([there, *pieces])


_HEADINGS = ("row", "what", "published", "measured", "over repetitions", "failures", "episodes")


def _rows(table: Sequence[dict[str, Any]]) -> list[list[str]]:
    lines = [list(_HEADINGS)]
    for row in table:
        mean, deviation = row["published"]
        told = f"{mean:.6g}" if deviation is None else f"{mean:.6g} / {deviation:.6g}"
        if "skipped" in row:
            lines.append([row["row"], row["what"], told, f"skipped: {row['skipped']}", "", "", ""])
            continue
        returned = row["of_returns"]
        measured = f"{row['return']:.6g}" if returned else f"{row['mean']:.6g} / {row['std']:.6g}"
        if "best" in row:
            measured += f"; best {row['best']:.6g} kg, mean of {row['searches']} searches {row['return']:.6g} kg"
        lines.append(
            [
                row["row"],
                row["what"],
                told,
                measured,
                _spread(row, returned),
                str(row["failures"]),
                str(row["episodes"]),
            ]
        )
    return lines


def _spread(row: dict[str, Any], returned: bool) -> str:
    """Range of the repetitions."""
    if len(row["means"]) < 2:
        return ""
    parts = [row["returns"]] if returned else [row["means"], row["stds"]]
    return " / ".join(f"{min(values):.5g} to {max(values):.5g}" for values in parts)


def _markdown(table: Sequence[dict[str, Any]]) -> str:
    head, *body = [f"| {' | '.join(row)} |" for row in _rows(table)]
    return "\n".join([head, "|" + " --- |" * len(_HEADINGS), *body]) + "\n"


def _write(path: Path, text: str) -> None:
    """Write a file, whole or not at all."""
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(text + ("" if text.endswith("\n") else "\n"), encoding="utf-8")
    temporary.replace(path)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the exit status is 1 where it cannot be done."""
    parser = argparse.ArgumentParser("python -m smpl.published", description="The published figures and ours.")
    parser.add_argument(
        "rows", nargs="*", metavar="ROW", help=f"rows instead of all: {', '.join(r.name for r in ROWS)}"
    )
    parser.add_argument("--out", default="published", metavar="DIR", help="folder of the parts and of the table")
    parser.add_argument("--scale", type=float, default=1.0, metavar="S", help="share of the episodes")
    parser.add_argument("--searches", type=int, default=1000, metavar="N", help="searches of pensim-gpei")
    parser.add_argument("--workers", type=int, metavar="W", help="threads or processes; default: all processors")
    parser.add_argument("--table", action="store_true", help="run nothing: make the table of what is there")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    given = parser.parse_args(arguments)

    def work() -> int:
        table = published(
            given.out, given.rows, scale=given.scale, searches=given.searches, workers=given.workers,
            progress=not given.quiet, run=not given.table,
        )  # fmt: skip
        print(text_table(_rows(table)))
        return 0

    return guarded(work)


if __name__ == "__main__":
    raise SystemExit(main())
