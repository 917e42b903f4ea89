"""The best recipe or set-points for whole episodes, by simulation of many of them at once."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl import _native
from smpl.analysis.rollout import Rollout, rollout
from smpl.controllers.base import OpenLoop
from smpl.controllers.names import operating_action
from smpl.envs import Env
from smpl.model import Model
from smpl.optimize.search import Search
from smpl.support.arguments import FloatArray, as_count, as_mapping, as_number, as_numbers, check_names
from smpl.support.options import Options, takes
from smpl.support.seeds import check_seed

SHAPES = ("hold", "linear")
Make = Callable[[dict[str, FloatArray]], Any]


@dataclass(frozen=True)
class EpisodeOptimum:
    """The best recipe that was found.

    Attributes:
        inputs: what was varied, by name: the moves of an action, or one number; declared units.
        actions: of all steps, (H, actions), physical units.
        parameters: those that were varied.
        value: of the goal, the mean (or the worst) over the starts.
        each: of the goal from each start.
        points: (n, d), values: (n,), all evaluations in their order.
        names: of the numbers of a point.
    """

    inputs: dict[str, FloatArray]
    actions: FloatArray
    parameters: dict[str, float]
    value: float
    each: FloatArray
    points: FloatArray
    values: FloatArray
    names: tuple[str, ...]
    _model: Model = field(repr=False)
    _shown: tuple[str, ...] = field(default=(), repr=False)

    @property
    def controller(self) -> OpenLoop:
        """A controller that follows the recipe without feedback; its last action is held."""
        return OpenLoop(self.actions, hold=True)

    def save(self, path: str | Path) -> None:
        """Write the actions as a table for `smpl simulate --actions`."""
        with Path(path).open("w", newline="", encoding="utf-8") as text:
            writer = csv.writer(text, lineterminator="\n")
            writer.writerow(self._model.action_names)
            writer.writerows([repr(float(value)) for value in row] for row in self.actions)

    def figure(self) -> Any:
        """The search and the best recipe as a Matplotlib figure (extra `report`)."""
        from smpl.optimize.pictures import search_figure

        model = self._model
        instants = model.step * np.arange(len(self.actions) + 1, dtype=np.float64)
        profiles: list[tuple[str, FloatArray, FloatArray]] = []
        for name in self._shown:
            column = self.actions[:, model.action_names.index(name)]
            unit = model.action_units[model.action_names.index(name)]
            profiles.append((f"{name}, {unit}", instants, np.append(column, column[-1])))
        return search_figure(self.values, True, "episode of the search", "goal", profiles, f"time, {model.time_unit}")

    def __str__(self) -> str:
        inputs = ", ".join(f"{name} = {np.array2string(value, precision=5)}" for name, value in self.inputs.items())
        return f"{self.value:.8g} at {inputs} ({len(self.values)} evaluations)"


@dataclass(frozen=True, kw_only=True, repr=False)
class EpisodeOptions(Options):
    """Options of `episode`.

    Attributes:
        moves: number of values of each action, over equal parts of the horizon; or by name.
        shape: `hold` keeps each value over its part, `linear` interpolates between them.
        actions: function that returns the actions (H, actions) of an episode from the inputs by
            name, instead of moves.
        base: values of the other actions: the name of a policy of the model that needs no feedback,
            actions (H, actions) or (actions,); None for the operating action.
        horizon: number of control steps; None for the time limit.
        seeds: starts as `reset(seed=...)` draws them, with their parameters and disturbances. None
            for the expected episode: nominal start, random numbers at their means.
        options: options of `reset`, for every start.
        goal: function of a `Rollout` of N episodes that returns (N,); None for the return.
        penalty: subtracted for each unit of constraint violation.
        worst: optimise the worst start instead of the mean.
        method: `cma`, `differential_evolution` or `bayes`, see `Search`; None for
            `differential_evolution` with one number, else `cma`.
        evaluations: number of recipes in all, each from all starts.
        population, spread, seed, file: as for `Search`; with a file an interrupted search
            continues.
        start: initial guess of the inputs, one number or all moves; None for the middle of their
            ranges.
        progress: show a progress bar.
        threads: number of threads; None for all processors.
        seconds: time after which no batch begins, and the best recipe so far counts; None for no
            limit.
    """

    moves: int | Mapping[str, int] = 1
    shape: str = "hold"
    actions: Make | None = None
    base: str | npt.ArrayLike | None = None
    horizon: int | None = None
    seeds: Sequence[int] | None = None
    options: Mapping[str, Any] | None = None
    goal: Callable[[Rollout], Any] | None = None
    penalty: float = 0.0
    worst: bool = False
    method: str | None = None
    evaluations: int = 1000
    population: int | None = None
    spread: float = 0.25
    seed: int = 0
    file: str | Path | None = None
    start: Mapping[str, npt.ArrayLike] | None = None
    progress: bool = False
    threads: int | None = None
    seconds: float | None = None


@takes(EpisodeOptions)
def episode(
    env: Env | Model | str, vary: Mapping[str, tuple[float, float] | None] | Iterable[str], options: EpisodeOptions
) -> EpisodeOptimum:
    """The recipe with the largest goal; the recipes of a batch are simulated on all cores.

    Args:
        env: an `smpl.Env`, a model, or the name or path of one. Its reward counts, and its time
            limit.
        vary: names of actions and parameters with (low, high), the declared bounds if missing. With
            `actions`, any names.
        options: `EpisodeOptions`, and options as keyword arguments.

    Raises:
        ValueError: an unknown name, an empty range, a wrong shape, or a file of another search.
        ImportError: the package of the method is missing.
    """
    plant = env if isinstance(env, Env) else Env(env, normalize=False)
    task = _Task(plant, vary, options)
    method = options.method or ("cma" if len(task.names) > 1 else "differential_evolution")
    search = Search(
        task.low, task.high, names=task.names, method=method, start=task.start(options.start), spread=options.spread,
        population=options.population, seed=options.seed, file=options.file,
    )  # fmt: skip
    search.run(task.values, options.evaluations, options.progress, seconds=options.seconds)
    point, value = search.best
    inputs = task.inputs(point)
    return EpisodeOptimum(
        inputs=inputs,
        actions=task.actions(point),
        parameters={name: float(inputs[name][0]) for name in task.parameters},
        value=value,
        each=task.each(point[None])[0],
        points=search.points,
        values=search.values,
        names=task.names,
        _model=task.model,
        _shown=tuple(name for name in task.model.action_names if name in inputs or options.actions is not None),
    )


class _Task:
    """Points to values: what is varied, the starts, the goal."""

    def __init__(
        self, env: Env, vary: Mapping[str, tuple[float, float] | None] | Iterable[str], options: EpisodeOptions
    ) -> None:
        if options.shape not in SHAPES:
            raise ValueError(f"shape is {options.shape!r}; there are: {', '.join(SHAPES)}")
        self.env, self.model, self.shape, self.make = env, env.model, options.shape, options.actions
        self.goal, self.penalty, self.worst = options.goal, float(options.penalty), options.worst
        self.threads, horizon = options.threads, options.horizon
        self.horizon = env.max_steps if horizon is None else min(as_count("horizon", horizon), env.max_steps)
        self.ranges = dict(vary) if isinstance(vary, Mapping) else {str(name): None for name in vary}
        known = (*self.model.action_names, *self.model.parameter_names)
        if not self.ranges:
            raise ValueError("vary names nothing: give actions or parameters")
        if self.make is None:
            check_names("vary", self.ranges, known)
        self.parameters = [
            n for n in self.ranges if n in self.model.parameter_names and n not in self.model.action_names
        ]
        self.count = {name: self._moves(name, options.moves) for name in self.ranges}
        self._box()
        self.base = self._base(options.base)
        self.starts = list(self._starts(options.seeds, dict(as_mapping("options", options.options))))
        self.snapshots = [] if self.parameters else [self._begun(*start) for start in self.starts]

    def _moves(self, name: str, moves: int | Mapping[str, int]) -> int:
        if isinstance(moves, Mapping):
            check_names("moves", moves, self.ranges)
            return as_count(f"moves[{name!r}]", moves.get(name, 1))
        return as_count("moves", moves) if name in self.model.action_names and self.make is None else 1

    def _box(self) -> None:
        low: list[float] = []
        high: list[float] = []
        names: list[str] = []
        for name, given in self.ranges.items():
            bottom, top = self._declared(name)
            if given is not None:
                if np.shape(given) != (2,):
                    raise ValueError(f"vary[{name!r}] is {given!r}, expected (low, high)")
                bottom = max(bottom, as_number(f"vary[{name!r}]", given[0]))
                top = min(top, as_number(f"vary[{name!r}]", given[1]))
            if not (np.isfinite([bottom, top]).all() and bottom < top):
                raise ValueError(f"vary[{name!r}] is {bottom:g} to {top:g}, expected a finite range: give (low, high)")
            count = self.count[name]
            low += [bottom] * count
            high += [top] * count
            names += [name] if count == 1 else [f"{name}[{i}]" for i in range(1, count + 1)]
        self.low, self.high, self.names = np.array(low), np.array(high), tuple(names)

    def _declared(self, name: str) -> tuple[float, float]:
        for role, known in (("action", self.model.action_names), ("parameter", self.model.parameter_names)):
            if name in known:
                low, high = self.model.native.bounds(role)
                return float(low[known.index(name)]), float(high[known.index(name)])
        return -np.inf, np.inf

    def _base(self, base: str | npt.ArrayLike | None) -> FloatArray:
        shape = (self.horizon, len(self.model.action_names))
        if base is None:
            self.env.reset(seed=0, options={"start": "nominal"})
            return np.broadcast_to(operating_action(self.env), shape)
        if isinstance(base, str):
            return self._followed(base)
        given = as_numbers("base", base, f"{shape} or ({shape[1]},)")
        if given.shape not in (shape, shape[1:]):
            raise ValueError(f"base has shape {given.shape}, expected {shape} or ({shape[1]},)")
        return np.broadcast_to(given, shape)

    def _followed(self, policy: str) -> FloatArray:
        """The actions that a policy chooses in the nominal episode."""
        self.env.reset(seed=0, options={"start": "nominal"})
        actions = []
        for _ in range(self.horizon):
            actions.append(self.env.policy(policy))
            _, _, terminated, truncated, _ = self.env.step(self.env.from_physical(actions[-1]))
            if terminated or truncated:
                break
        return np.array(actions + [actions[-1]] * (self.horizon - len(actions)))

    def _begun(self, seed: int, options: dict[str, Any]) -> _native.Snapshot:
        self.env.reset(seed=seed, options=options or None)
        return self.env.snapshot()

    def _starts(self, seeds: Sequence[int] | None, options: dict[str, Any]) -> Iterable[tuple[int, dict[str, Any]]]:
        """Seed and options of the reset of each start."""
        if seeds is None:
            yield 0, {"start": "nominal", **options}
            return
        if not len(seeds):
            raise ValueError("seeds is empty, expected seeds of episodes")
        for one in seeds:
            given = dict(options)
            recorded = self._disturbances(check_seed(int(one)), options)
            if recorded:
                given["disturbances"] = {**recorded, **dict(options.get("disturbances") or {})}
                given["hold_disturbances"] = True
            yield int(one), given

    def _disturbances(self, seed: int | None, options: dict[str, Any]) -> dict[str, FloatArray]:
        """Disturbances of an episode, independent of the actions."""
        names = self.model.disturbance_names
        if not names:
            return {}
        self.env.reset(seed=seed, options=options or None)
        rows = []
        for action in self.base:
            _, _, terminated, truncated, _ = self.env.step(self.env.from_physical(action))
            rows.append(self.env._native.values("disturbance"))
            if terminated or truncated:
                break
        return dict(zip(names, np.array(rows).T, strict=True))

    def start(self, given: Mapping[str, npt.ArrayLike] | None) -> FloatArray | None:
        if given is None:
            return None
        check_names("start", given, self.ranges)
        middle = (self.low + self.high) / 2
        at = 0
        for name, count in self.count.items():
            if name in given:
                value = as_numbers(f"start[{name!r}]", given[name], f"({count},)")
                if value.ndim and value.shape != (count,):
                    raise ValueError(f"start[{name!r}] has shape {value.shape}, expected ({count},) or one number")
                middle[at : at + count] = value
            at += count
        return middle

    def inputs(self, point: FloatArray) -> dict[str, FloatArray]:
        """The numbers of a point by name."""
        ends = np.cumsum([0, *self.count.values()])
        return {name: point[ends[i] : ends[i + 1]].copy() for i, name in enumerate(self.count)}

    def actions(self, point: FloatArray) -> FloatArray:
        """Actions of all steps, (H, actions)."""
        inputs = self.inputs(point)
        width = len(self.model.action_names)
        if self.make is not None:
            made = as_numbers("actions", self.make(inputs), f"({self.horizon}, {width})")
            if made.shape != (self.horizon, width):
                raise ValueError(f"actions has shape {made.shape}, expected ({self.horizon}, {width})")
            return made
        chosen = self.base.copy()
        steps = np.arange(self.horizon)
        for name, values in inputs.items():
            if name not in self.model.action_names:
                continue
            column = self.model.action_names.index(name)
            if self.shape == "linear" and len(values) > 1:
                knots = np.linspace(0, self.horizon - 1, len(values))
                chosen[:, column] = np.interp(steps, knots, values)
            else:
                chosen[:, column] = values[np.minimum(steps * len(values) // self.horizon, len(values) - 1)]
        return chosen

    def each(self, points: FloatArray) -> FloatArray:
        """The goal of each point from each start, (n, starts)."""
        plans = np.stack([self.actions(point) for point in points])
        *_, limit, method = self.env._options
        columns = []
        for start in self.snapshots or self.starts:
            begin, given = (start, {}) if isinstance(start, _native.Snapshot) else self._reset(points, *start)
            found = rollout(self.model, begin, plans, method=method, threads=self.threads, max_steps=limit, **given)
            values = found.returns if self.goal is None else as_numbers("goal", self.goal(found), f"({len(points)},)")
            if values.shape != (len(points),):
                raise ValueError(f"goal has shape {values.shape}, expected ({len(points)},)")
            columns.append(values - self.penalty * found.cost.sum(axis=1))
        return np.stack(columns, axis=1)

    def _reset(self, points: FloatArray, seed: int, options: dict[str, Any]) -> tuple[FloatArray, dict[str, Any]]:
        """Initial states, and arguments of the episode with the parameters of each point."""
        model, states, discrete, parameters = self.model, [], [], []
        for point in points:
            inputs = self.inputs(point)
            own = {**(options.get("parameters") or {}), **{name: float(inputs[name][0]) for name in self.parameters}}
            self.env.reset(seed=seed, options={**options, "parameters": own})
            states.append(self.env.state)
            discrete.append(self.env.discrete)
            parameters.append(list(self.env.parameters.values()))
        given: dict[str, Any] = {
            "parameters": dict(zip(model.parameter_names, np.array(parameters).T, strict=True)),
            "discrete": dict(zip(model.discrete_names, np.array(discrete).reshape(len(points), -1).T, strict=True)),
        }
        recorded = {}
        for name, values in (options.get("disturbances") or {}).items():
            series = np.atleast_1d(as_numbers(f"disturbances[{name!r}]", values, "(steps,)"))[: self.horizon]
            recorded[name] = np.append(series, [series[-1]] * (self.horizon - len(series)))
        return np.array(states), {**given, "disturbances": recorded}

    def values(self, points: FloatArray) -> FloatArray:
        """The goal of each point over the starts, (n,)."""
        each = self.each(points)
        return each.min(axis=1) if self.worst else each.mean(axis=1)
