"""Bayesian optimisation of recipes and set-points: a Gaussian process with expected improvement.

D. R. Jones, M. Schonlau, W. J. Welch, Journal of Global Optimization 13 (1998) 455-492; batches by
the constant liar of D. Ginsbourger, R. Le Riche, L. Carraro (2010). The Gaussian process is
scikit-learn's.
"""

from __future__ import annotations

import csv
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.analysis.rollout import Rollout
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_count, as_numbers
from smpl.support.clock import Clock
from smpl.support.optional import load
from smpl.support.options import Options, takes
from smpl.support.searches import read_search

Objective = Callable[[FloatArray], Any]


@dataclass(frozen=True, kw_only=True, repr=False)
class BayesianOptions(Options):
    """Options of `BayesianOptimization`.

    Attributes:
        names: names of the numbers, for the file.
        initial: points drawn at random before the Gaussian process is used.
        batch: points in each call of the objective.
        seed: of the random numbers.
        file: a CSV file to continue from, and to write to.
        decimals: points are rounded to so many decimals; None for no rounding.
        candidates: random points, of which the one with the highest expected improvement is
            improved further.
        exploration: xi, by which the best value must be improved, over the deviation of the values.
        refit: hyperparameters of the Gaussian process are fitted again when the evaluations have
            grown by this share; 0 fits them before every batch. New values count in any case: only
            lengths and variances wait.
    """

    names: Iterable[str] | None = None
    initial: int = 10
    batch: int = 1
    seed: int = 0
    file: str | Path | None = None
    decimals: int | None = None
    candidates: int = 2000
    exploration: float = 0.01
    refit: float = 0.1


class BayesianOptimization:
    """Maximises a function of some numbers within a box, that is dear to evaluate.

    `run(objective, evaluations)` does all; `ask` and `tell` are for what is evaluated elsewhere.
    With a file every evaluation is written at once, and an interrupted search continues from it
    with the points that an uninterrupted one has.

    Args:
        low, high: the box, (d,); or a mapping from names to (low, high) as `low`.
        options: `BayesianOptions`, and options as keyword arguments.

    Attributes:
        fallbacks: points that were drawn at random because the Gaussian process could not be
            computed.
        last_status: reason of the last fallback.

    Raises:
        ValueError: an invalid box, or a file of another search.
        ImportError: scikit-learn is missing.
    """

    @takes(BayesianOptions)
    def __init__(
        self,
        low: npt.ArrayLike | Mapping[str, tuple[float, float]],
        high: npt.ArrayLike | None = None,
        *,
        options: BayesianOptions,
    ) -> None:
        names, decimals, file, refit = options.names, options.decimals, options.file, options.refit
        if isinstance(low, Mapping):
            names, pairs = tuple(low), list(low.values())
            low, high = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
        if high is None:
            raise ValueError("high is None, expected (d,), or a mapping from names to (low, high) as low")
        self.low, self.high = as_numbers("low", low, "(d,)"), as_numbers("high", high, "(d,)")
        if self.low.shape != self.high.shape or self.low.ndim != 1 or not (self.low < self.high).all():
            raise ValueError(f"low {self.low.tolist()} and high {self.high.tolist()}, expected (d,) and low below high")
        self.names = tuple(names) if names is not None else tuple(f"x{i}" for i in range(len(self.low)))
        if len(self.names) != len(self.low):
            raise ValueError(f"{len(self.names)} names for {len(self.low)} numbers")
        self._initial, self._batch = as_count("initial", options.initial), as_count("batch", options.batch)
        self._seed, self._decimals = as_count("seed", options.seed, 0, "an integer that is not negative"), decimals
        self._candidates, self._exploration = as_count("candidates", options.candidates), float(options.exploration)
        if not 0 <= refit <= 1:
            raise ValueError(f"refit is {refit}, expected a share from 0 to 1")
        self._refit, self._prior = float(refit), (0, _Prior(0.0, 1.0, None))
        self._file = None if file is None else Path(file)
        self.points, self.values = np.zeros((0, len(self.low))), np.zeros(0)
        self.fallbacks, self.last_status = 0, ""
        _library()
        self._read()

    @property
    def best(self) -> tuple[FloatArray, float]:
        """The best point and its value.

        Raises:
            ValueError: nothing was evaluated yet.
        """
        if not np.isfinite(self.values).any():
            raise ValueError("nothing was evaluated yet, or every value was not finite")
        place = int(np.nanargmax(np.where(np.isfinite(self.values), self.values, np.nan)))
        return self.points[place].copy(), float(self.values[place])

    def run(
        self,
        objective: Objective,
        evaluations: int,
        progress: Callable[[int, float], Any] | None = None,
        *,
        seconds: float | None = None,
    ) -> None:
        """Go on until so many evaluations are there, those of the file included.

        Args:
            objective: of points (n, d), returns values (n,); a value that is not finite is taken as
                the worst one.
            evaluations: in all.
            progress: called with the number of evaluations and the best value.
            seconds: no batch begins after so many; no limit if None.
        """
        clock = Clock(seconds)
        while len(self.values) < evaluations and not clock.over():
            points = self.ask(min(self._batch, evaluations - len(self.values)))
            self.tell(points, objective(points))
            if progress is not None:
                progress(len(self.values), self.best[1] if np.isfinite(self.values).any() else float("nan"))

    def ask(self, count: int | None = None) -> FloatArray:
        """The next points, (count, d). The same until `tell` is called."""
        count = self._batch if count is None else as_count("count", count)
        # Of the number of evaluations alone, so that a search from a file goes on as one that was
        # not stopped.
        generator = np.random.default_rng([self._seed, len(self.values)])
        fixed = self._initial - len(self.values)
        chosen: list[FloatArray] = []
        points, values = self.points, _usable(self.values)
        for place in range(count):
            if place < fixed or len(self.values) < 2:
                point = generator.uniform(self.low, self.high)
            else:
                point = self._proposed(points, values, generator)
            point = self._rounded(point)
            chosen.append(point)
            # The constant liar: as if the point had brought the mean.
            points, values = np.vstack([points, point]), np.append(values, values.mean() if len(values) else 0.0)
        return np.array(chosen)

    def tell(self, points: npt.ArrayLike, values: npt.ArrayLike) -> None:
        """Take in evaluations, and write them to the file."""
        given = np.atleast_2d(as_numbers("points", points, "(n, d)"))
        found = np.atleast_1d(as_numbers("values", values, "(n,)"))
        if given.shape != (len(found), len(self.low)) or found.ndim != 1:
            expected = f"(n, {len(self.low)}) and (n,)"
            raise ValueError(f"points has shape {given.shape}, values {found.shape}, expected {expected}")
        self.points, self.values = np.vstack([self.points, given]), np.concatenate([self.values, found])
        self._write(given, found)

    def _rounded(self, point: FloatArray) -> FloatArray:
        if self._decimals is None:
            return point
        return np.clip(np.round(point, self._decimals), self.low, self.high)

    def _proposed(self, points: FloatArray, values: FloatArray, generator: np.random.Generator) -> FloatArray:
        """The most promising point, or a random one if the Gaussian process cannot be computed."""
        try:
            with _one_thread():
                return self._most_promising(points, values, generator)
        except (np.linalg.LinAlgError, ValueError) as error:
            self.fallbacks += 1
            self.last_status = str(error).splitlines()[0] if str(error) else type(error).__name__
            return np.asarray(generator.uniform(self.low, self.high))

    def _most_promising(self, points: FloatArray, values: FloatArray, generator: np.random.Generator) -> FloatArray:
        scaled, prior = self._scaled(points), self._fitted()
        targets = (values - prior.mean) / prior.deviation
        process = prior.process(scaled, targets, self._seed)
        best = targets.max()
        dimension = len(self.low)
        drawn = generator.uniform(size=(self._candidates, dimension))
        # Near the best point too: in many dimensions random points are far from everything.
        near = scaled[int(np.argmax(targets))] + 0.1 * generator.standard_normal((self._candidates // 4, dimension))
        tried = np.vstack([drawn, np.clip(near, 0, 1)])

        def gains(points: FloatArray) -> FloatArray:
            mean, spread = process.predict(points, return_std=True)
            return expected_improvement(mean, spread, best, self._exploration)

        found = gains(tried)
        order = np.argsort(-found)[:2]
        top, most = tried[order[0]], float(found[order[0]])
        if dimension <= 20:  # differences in many dimensions cost more than they bring
            for i in order:
                better, gain = _climbed(gains, tried[i])
                if gain > most:
                    top, most = better, gain
        return self.low + np.clip(top, 0, 1) * (self.high - self.low)

    def _scaled(self, points: FloatArray) -> FloatArray:
        return (points - self.low) / (self.high - self.low)

    def _fitted(self) -> _Prior:
        """Prior from the first evaluations, so that a search from a file has the same one."""
        count = last = max(self._initial, 2)
        while count <= len(self.values):
            last, count = count, max(count + 1, int(np.ceil(count * (1 + self._refit))))
        last = min(last, len(self.values))
        if self._prior[0] != last:
            values = _usable(self.values[:last])
            self._prior = last, _Prior.fitted(self._scaled(self.points[:last]), values, self._seed)
        return self._prior[1]

    def _read(self) -> None:
        if self._file is None or not self._file.is_file():
            return
        numbers = read_search(self._file, self.names)
        self.points, self.values = numbers[:, :-1], numbers[:, -1]

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


@dataclass(frozen=True)
class _Prior:
    """Prior of the values: mean, deviation, and the kernel of what is over them."""

    mean: float
    deviation: float
    kernel: Any

    @classmethod
    def fitted(cls, points: FloatArray, values: FloatArray, seed: int) -> _Prior:
        """Of the largest marginal likelihood."""
        regressor, kernels = _library()
        mean, deviation = float(values.mean()), float(values.std()) or 1.0
        dimension = points.shape[1]
        # One length for each direction in few dimensions, one for all in many.
        lengths = np.ones(dimension) * 0.5 if dimension <= 10 else 0.5 * np.sqrt(dimension)
        kernel = kernels.ConstantKernel(1.0, (1e-2, 1e2)) * kernels.Matern(lengths, (1e-2, 1e2), nu=2.5)
        kernel = kernel + kernels.WhiteKernel(1e-4, (1e-8, 1e0))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # lengths at their bounds
            process = regressor(kernel, random_state=seed).fit(points, (values - mean) / deviation)
        return cls(mean, deviation, process.kernel_)

    def process(self, points: FloatArray, targets: FloatArray, seed: int) -> Any:
        """The Gaussian process given what is known: one factorisation."""
        regressor, _ = _library()
        return regressor(self.kernel, optimizer=None, random_state=seed).fit(points, targets)


def _usable(values: FloatArray) -> FloatArray:
    """Values, those that are not finite as the worst one."""
    finite = np.isfinite(values)
    worst = values[finite].min() if finite.any() else 0.0
    return np.where(finite, values, worst)


def _climbed(gains: Callable[[FloatArray], FloatArray], start: FloatArray) -> tuple[FloatArray, float]:
    """Local maximum of the gain in the unit box from a start, and the gain there."""
    from scipy.optimize import minimize

    steps = 1e-6 * np.eye(len(start))

    def loss(point: FloatArray) -> tuple[float, FloatArray]:
        signs = np.where(point > 0.5, -1.0, 1.0)  # within the box
        values = gains(np.vstack([point, point + signs[:, None] * steps]))
        return -float(values[0]), -(values[1:] - values[0]) / (signs * 1e-6)

    found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=[(0.0, 1.0)] * len(start))
    return found.x, -float(found.fun)


def expected_improvement(mean: FloatArray, spread: FloatArray, best: float, exploration: float = 0.0) -> FloatArray:
    """Expected improvement over `best` for normal values with means and standard deviations."""
    from scipy.special import ndtr

    gain = mean - best - exploration
    wide = np.maximum(spread, 1e-12)
    z = gain / wide
    return np.where(spread > 0, gain * ndtr(z) + wide * np.exp(-z * z / 2) / np.sqrt(2 * np.pi), np.maximum(gain, 0.0))


def recipe_return(
    model: Model, state: npt.ArrayLike, actions: Callable[[FloatArray], FloatArray], **options: Any
) -> Objective:
    """Objective: the return of a point's recipe; one rollout on all cores simulates a batch.

    Args:
        model: the model, with the reward that counts.
        state: where each batch starts.
        actions: makes actions (H, actions) of a point (d,).
        options: further arguments of `Model.rollout`.
    """

    def objective(points: FloatArray) -> FloatArray:
        found: Rollout = model.rollout(state, np.stack([actions(point) for point in points]), **options)
        return found.returns

    return objective


def _library() -> tuple[Any, Any]:
    library = load("sklearn.gaussian_process", "Bayesian optimisation")
    return library.GaussianProcessRegressor, library.kernels


def _one_thread() -> Any:
    """Linear algebra on one thread: for small matrices more threads are ten times slower."""
    from threadpoolctl import threadpool_limits  # scikit-learn depends on it

    return threadpool_limits(limits=1)
