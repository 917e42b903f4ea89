"""Searches without derivatives for the largest value of a function that is evaluated in batches.

Covariance matrix adaptation: N. Hansen, A. Ostermeier, Evolutionary Computation 9 (2001) 159-195,
by the package `cma`, restarted with twice the population where it has converged (A. Auger, N.
Hansen, CEC 2005). Differential evolution: R. Storn, K. Price, Journal of Global Optimization 11
(1997) 341-359, by SciPy. Bayesian optimisation: see `smpl.controllers.BayesianOptimization`.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.controllers.bayesian import BayesianOptimization
from smpl.learning.progress import Progress
from smpl.support.arguments import FloatArray, as_count, as_numbers
from smpl.support.clock import Clock
from smpl.support.optional import load
from smpl.support.searches import read_search

METHODS = ("cma", "differential_evolution", "bayes")
Objective = Callable[[FloatArray], Any]


class _DoneError(Exception):
    """The evaluations or the seconds are used up."""


class _CarriedError(Exception):
    """An error of the objective, past a method that would say something else of it."""


class Search:
    """Maximises a function in a box; a search with a file keeps its evaluations and continues.

    A search that was stopped and begun again with the same arguments gives the same points as one
    that was not: what the file has is not evaluated again.

    Args:
        low, high: the box, (d,).
        names: of the numbers, for the file.
        method: `cma`, `differential_evolution` or `bayes`.
        start: where `cma` begins, the middle of the box if none; `bayes` evaluates it first.
        spread: standard deviation of the first points of `cma`, over the width of the box.
        population: points of a batch; the method's own number if none.
        seed: of the random numbers.
        file: a CSV file.

    Attributes:
        points: (n, d), values: (n,), in the order of the evaluations.

    Raises:
        ValueError: no such method, an invalid box, or a file of another search.
    """

    def __init__(
        self,
        low: npt.ArrayLike,
        high: npt.ArrayLike,
        *,
        names: Iterable[str] | None = None,
        method: str = "cma",
        start: npt.ArrayLike | None = None,
        spread: float = 0.25,
        population: int | None = None,
        seed: int = 0,
        file: str | Path | None = None,
    ) -> None:
        if method not in METHODS:
            raise ValueError(f"method is {method!r}; there are: {', '.join(METHODS)}")
        self.low, self.high = as_numbers("low", low, "(d,)"), as_numbers("high", high, "(d,)")
        if self.low.shape != self.high.shape or self.low.ndim != 1 or not (self.low < self.high).all():
            raise ValueError(f"low {self.low.tolist()} and high {self.high.tolist()}, expected (d,) and low below high")
        self.names = tuple(names) if names is not None else tuple(f"x{i}" for i in range(len(self.low)))
        if len(self.names) != len(self.low):
            raise ValueError(f"{len(self.names)} names for {len(self.low)} numbers")
        middle = (self.low + self.high) / 2 if start is None else as_numbers("start", start, f"({len(self.low)},)")
        if middle.shape != self.low.shape or (middle < self.low).any() or (middle > self.high).any():
            raise ValueError(f"start is {middle.tolist()}, expected ({len(self.low)},) within the box")
        if not 0 < spread <= 1:
            raise ValueError(f"spread is {spread}, expected a share of the box above 0")
        self._start, self._given, self._spread = middle, start is not None, float(spread)
        self.method = method
        self._population = None if population is None else as_count("population", population, 4, "at least 4")
        self._seed = as_count("seed", seed, 0, "an integer that is not negative")
        self._file = None if file is None else Path(file)
        self.points, self.values = np.zeros((0, len(self.low))), np.zeros(0)
        self._there = self._read()

    @property
    def best(self) -> tuple[FloatArray, float]:
        """The best point and its value.

        Raises:
            ValueError: nothing was evaluated yet, or nothing had a finite value.
        """
        if not np.isfinite(self.values).any():
            raise ValueError("nothing was evaluated yet, or every value was not finite")
        place = int(np.argmax(np.where(np.isfinite(self.values), self.values, -np.inf)))
        return self.points[place].copy(), float(self.values[place])

    def run(
        self, objective: Objective, evaluations: int, progress: bool = False, *, seconds: float | None = None
    ) -> None:
        """Search until so many evaluations are there, those of the file included.

        Args:
            objective: of points (n, d), returns values (n,); one that is not finite counts as the
                worst.
            evaluations: in all.
            progress: show a bar.
            seconds: no batch begins after so many; no limit if None.

        Raises:
            ImportError: the package of the method is missing.
            ValueError: values of a wrong shape, or the file has other points than this search
                makes.
        """
        count, clock = as_count("evaluations", evaluations), Clock(seconds)
        self.points, self.values = self.points[:0], self.values[:0]
        with Progress(progress, self.method, count) as bar:

            def evaluate(points: FloatArray) -> FloatArray:
                if clock.over():
                    raise _DoneError
                room = count - len(self.values)
                values = self._evaluate(points[:room], objective)
                bar.add(len(values))
                if len(values) < len(points) or len(self.values) >= count:
                    raise _DoneError
                return values

            try:
                {"cma": self._cma, "differential_evolution": self._evolve, "bayes": self._bayes}[self.method](evaluate)
            except _DoneError:
                return
            except _CarriedError as carried:
                raise (carried.__cause__ or carried) from None

    def _cma(self, evaluate: Objective) -> None:
        cma = _cma_package()
        generator = np.random.default_rng(self._seed)
        dimension = len(self.low)
        if dimension == 1:
            raise ValueError("cma needs two numbers or more: take differential_evolution or bayes")
        start = (self._start - self.low) / (self.high - self.low)
        population = self._population or 4 + int(3 * np.log(dimension))
        while True:
            options = {
                "bounds": [0, 1],
                "popsize": population,
                "verbose": -9,
                "seed": np.nan,  # the state of NumPy's own generator is not touched
                "randn": lambda *shape: generator.standard_normal(shape),
            }
            strategy = cma.CMAEvolutionStrategy(start, self._spread, options)
            while not strategy.stop():
                scaled = np.clip(np.array(strategy.ask()), 0, 1)
                values = evaluate(self.low + scaled * (self.high - self.low))
                strategy.tell(list(scaled), list(-self._ranked(values)))
            start, population = generator.uniform(size=dimension), 2 * population

    def _evolve(self, evaluate: Objective) -> None:
        from scipy.optimize import differential_evolution

        dimension = len(self.low)
        size = self._population or max(8, min(10 * dimension, 64))
        generator = np.random.default_rng(self._seed)
        first = generator.uniform(size=(max(size, 5), dimension))
        first[0] = (self._start - self.low) / (self.high - self.low)

        def loss(scaled: FloatArray) -> FloatArray:
            try:
                return -self._ranked(evaluate(self.low + np.clip(scaled.T, 0, 1) * (self.high - self.low)))
            except (TypeError, ValueError) as error:
                raise _CarriedError from error

        seeds = np.random.RandomState(self._seed)  # under a name that every SciPy takes
        differential_evolution(
            loss, [(0.0, 1.0)] * dimension, init=first, maxiter=10**9, tol=0.0, atol=0.0, polish=False, seed=seeds,
            updating="deferred", vectorized=True,
        )  # fmt: skip

    def _bayes(self, evaluate: Objective) -> None:
        batch = self._population or 2
        search = BayesianOptimization(self.low, self.high, names=self.names, batch=batch, seed=self._seed)
        if self._given:
            search.tell(self._start[None], evaluate(self._start[None]))
        # What is there is taken in as it is: a Gaussian process for each point of the past would
        # cost hours. A batch that was not finished is asked for again: its points depend on what
        # was known before it.
        known = 0 if self._there is None else (len(self._there) - len(self.values)) // batch * batch
        if self._there is not None and known > 0:
            points = self._there[len(self.values) : len(self.values) + known, :-1]
            search.tell(points, evaluate(points))
        while True:
            points = search.ask()
            search.tell(points, evaluate(points))

    def _ranked(self, values: FloatArray) -> FloatArray:
        """Values with those that are not finite below the worst one."""
        finite = self.values[np.isfinite(self.values)]
        worst = float(finite.min()) if len(finite) else 0.0
        width = float(np.ptp(finite)) if len(finite) else 1.0
        return np.where(np.isfinite(values), values, worst - 0.1 * (width or 1.0))

    def _evaluate(self, points: FloatArray, objective: Objective) -> FloatArray:
        """Values of points: of the file as far as it goes, then of the objective."""
        known = np.zeros(0)
        if self._there is not None:
            rows = self._there[len(self.values) : len(self.values) + len(points)]
            if not np.array_equal(rows[:, :-1], points[: len(rows)]):
                raise ValueError(
                    f"{self._file} is of another search: evaluation {len(self.values) + 1} is of another point; "
                    "give the same arguments, or another file"
                )
            known = rows[:, -1]
        fresh = points[len(known) :]
        found = np.zeros(0)
        if len(fresh):
            found = as_numbers("the objective's values", objective(fresh), f"({len(fresh)},)")
            if found.shape != (len(fresh),):
                raise ValueError(f"the objective's values have shape {found.shape}, expected ({len(fresh)},)")
            self._write(fresh, found)
        values = np.concatenate([known, found])
        self.points, self.values = np.vstack([self.points, points]), np.concatenate([self.values, values])
        return values

    def _read(self) -> FloatArray | None:
        if self._file is None or not self._file.is_file():
            return None
        numbers = read_search(self._file, self.names)
        self.points, self.values = numbers[:, :-1], numbers[:, -1]
        return numbers

    def _write(self, points: FloatArray, values: FloatArray) -> None:
        if self._file is None:
            return
        fresh = not self._file.is_file()
        with self._file.open("a", newline="", encoding="utf-8") as text:
            writer = csv.writer(text, lineterminator="\n")
            if fresh:
                writer.writerow([*self.names, "value"])
            for point, value in zip(points, values, strict=True):
                writer.writerow([*map(repr, point.tolist()), repr(float(value))])


def _cma_package() -> Any:
    return load("cma", "covariance matrix adaptation")
