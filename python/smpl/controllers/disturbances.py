"""Declared disturbances for estimators: their evolution by their rules, and their variance."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from statistics import NormalDist
from typing import Any

import numpy as np

from smpl.envs import Env
from smpl.model import Model
from smpl.support.arguments import FloatArray, check_names, check_once

# Steps and samples by which it is found which disturbances must be estimated.
_STEPS, _SAMPLES = 120, 3
# Samples of the random numbers of a step where a rule is not linear in them.
_NODES = 64
# Seeds of which drawn parameters are taken.
_SEEDS = 200
Named = Mapping[str, Any]


class Disturbances:
    """Disturbances of a model that an estimator carries along with the states.

    After them follow the constant numbers drawn at a reset (`random`) that the rules or readings
    depend on. They are numbers of standard distributions: uniform from 0 to 1, or normal.

    Args:
        model: the model.
        names: disturbances to estimate; if none, all that are random or that depend on the value
            before, from their declared values on.
        fixed: values of parameters.
        uncertain: names that occur in deviations of an estimator, which are estimated as well if
            they are disturbances.

    Attributes:
        names: the estimated disturbances, then the drawn numbers.
        moving: number of the disturbances.
        size: magnitude of each.
        low, high: bounds of each.
        deviation: standard deviations of the drawn numbers.
        still: names of estimated disturbances that keep their declared values by their rules.

    Raises:
        ValueError: an unknown name, or one that occurs twice.
    """

    def __init__(self, model: Model, names: Iterable[str] | None, fixed: Named, uncertain: Iterable[str] = ()) -> None:
        self._model, self._fixed = model, dict(fixed)
        self._defaults = np.nan_to_num(model.native.defaults("disturbance"))
        draws = model.native.draws()
        self._normal = np.array([normal for _, normal, _ in draws], dtype=np.bool_)
        self._at_steps = np.array([step for _, _, step in draws], dtype=np.bool_)
        self._wide = np.where(self._normal, 1.0, 12**-0.5)
        given: tuple[str, ...] | None = None
        if names is not None:
            given = (names,) if isinstance(names, str) else tuple(names)
        check_names("disturbances", given or (), model.disturbance_names)
        check_once("disturbances", given or ())
        self._also = [name for name in model.disturbance_names if name in set(uncertain)]
        if given is not None:
            given = (*given, *[name for name in self._also if name not in given])
        self._places: list[int] = []
        self._drawn_places: list[int] = []
        self.still: set[str] = set()
        sizes = np.zeros(0)
        if (model.disturbance_names or draws) and given != ():
            sizes = self._find(given)
        self.moving = len(self._places)
        low, high = model.native.bounds("disturbance")
        self.deviation = self._wide[self._drawn_places]
        normal = self._normal[self._drawn_places]
        self.names = (*[model.disturbance_names[i] for i in self._places], *self._titles(draws))
        self.size = np.concatenate([sizes, np.ones(len(normal))])
        self.low = np.concatenate([low[self._places], np.where(normal, -np.inf, 0.0)])
        self.high = np.concatenate([high[self._places], np.where(normal, np.inf, 1.0)])
        self._nodes = self._hypercube()

    def _titles(self, draws: list[tuple[str, bool, bool]]) -> list[str]:
        """Names of the drawn numbers; several of one stream are numbered."""
        streams = [draws[i][0] for i in self._drawn_places]
        return [
            name if streams.count(name) == 1 else f"{name}#{streams[:i].count(name) + 1}"
            for i, name in enumerate(streams)
        ]

    def _find(self, given: tuple[str, ...] | None) -> FloatArray:
        """Finds disturbances that are random or have a memory, from samples at the nominal start.

        Returns:
            Their magnitudes.
        """
        model = self._model
        env = Env(model, normalize=False)
        env.reset(seed=0, options={"start": "nominal", "parameters": self._known()})
        generator, count = np.random.default_rng(0), len(self._defaults)
        states, action = np.tile(env.state, (2 * _SAMPLES, 1)), model.native.defaults("action")
        discrete = dict(zip(env.discrete_names, env.discrete.tolist(), strict=True))
        present = np.tile(self._defaults, (_SAMPLES, 1))
        kept, reach = np.array([name in self._also for name in model.disturbance_names]), np.abs(self._defaults)
        moved = np.zeros(count, dtype=np.bool_)
        fixed = self._drawn(generator.uniform(size=(_SAMPLES, len(self._normal))))
        for step in range(min(model.max_steps, _STEPS) if count else 0):
            fresh = self._drawn(generator.uniform(size=(_SAMPLES, len(self._normal))))
            drawn = np.where(self._at_steps, fresh, fixed)
            both = np.vstack([present, np.tile(self._defaults, (_SAMPLES, 1))])
            found, _ = self._evaluate(states, both, action, step, discrete, {}, np.vstack([drawn, drawn]))
            later, plain = found[:_SAMPLES], found[_SAMPLES:]
            kept |= (later != plain).any(axis=0) | (later != later[0]).any(axis=0)
            moved |= (later != self._defaults).any(axis=0)
            present, reach = later, np.maximum(reach, np.abs(later).max(axis=0))
        known = model.disturbance_names
        self._places = [i for i in range(count) if kept[i]] if given is None else [known.index(one) for one in given]
        self.still = {known[i] for i in self._places if not moved[i]}
        self._drawn_places = self._acting(env.state, action, discrete)
        return np.where(reach > 0, reach, 1.0)[self._places]

    def _acting(self, state: FloatArray, action: FloatArray, discrete: Named) -> list[int]:
        """Numbers drawn at a reset that change a rule or a reading."""
        found = []
        middle = self._drawn(np.full(len(self._normal), 0.5))
        for i in np.flatnonzero(~self._at_steps).tolist():
            draws = np.tile(middle, (2, 1))
            draws[:, i] += self._wide[i] * np.array([-1.0, 1.0])
            both = np.tile(state, (2, 1)), np.tile(self._defaults, (2, 1))
            later, read = self._evaluate(*both, action, 0, discrete, {}, draws)
            if (later[0, self._places] != later[1, self._places]).any() or (read[0] != read[1]).any():
                found.append(i)
        return found

    def parameters(self) -> dict[str, float]:
        """Parameters drawn at a reset that affect the rules: names and standard deviations."""
        if not self.moving:
            return {}
        model = self._model
        env = Env(model, normalize=False)
        env.reset(seed=0, options={"start": "nominal", "parameters": self._known()})
        means, action = env.parameters, model.native.defaults("action")
        discrete = dict(zip(env.discrete_names, env.discrete.tolist(), strict=True))
        deviations = drawn_parameters(model, self._known())
        found = {}
        for name, deviation in deviations.items():
            values = means[name] + deviation * np.array([-1.0, 1.0])
            later, _ = self._evaluate(
                np.tile(env.state, (2, 1)), np.tile(self._defaults, (2, 1)), action, 0, discrete, {name: values}
            )
            if (later[0, self._places] != later[1, self._places]).any():
                found[name] = deviation
        for name in list(found):
            # A parameter computed from another one is not drawn itself.
            shifted = {**self._known(), name: means[name] + found[name]}
            env.reset(seed=0, options={"start": "nominal", "parameters": shifted})
            found = {one: size for one, size in found.items() if one == name or env.parameters[one] == means[one]}
        return found

    def start(self) -> FloatArray:
        """Values before the first step, the drawn numbers at their means."""
        middle = self._drawn(np.full(len(self._normal), 0.5))
        return np.concatenate([self._defaults[self._places], middle[self._drawn_places]])

    def spread_at_start(self, begins: bool) -> FloatArray:
        """Standard deviations at the start, where disturbances have their declared values."""
        moving = np.zeros(self.moving) if begins else self.size[: self.moving]
        return np.concatenate([moving, self.deviation])

    def next(
        self, states: FloatArray, present: FloatArray, action: FloatArray, at: int, discrete: Named, parameters: Named,
        nodes: FloatArray | None = None,
    ) -> FloatArray:  # fmt: skip
        """Mean values (N, disturbances) of the coming step at N points.

        Args:
            states, present: (N, states) and (N, disturbances).
            action, at, discrete: for all points.
            parameters: values by name, (N,).
            nodes: random numbers over which the mean is taken, see `spread`; their means if none.
        """
        if nodes is None:
            return self._at(states, present, action, at, discrete, parameters)[0]
        count, many = len(states), len(nodes)
        repeated = {name: np.repeat(np.broadcast_to(values, count), many) for name, values in parameters.items()}
        found, _ = self._at(
            np.repeat(states, many, axis=0), np.repeat(present, many, axis=0), action, at, discrete, repeated,
            np.tile(nodes, (count, 1)),
        )  # fmt: skip
        mean: FloatArray = found.reshape(count, many, -1).mean(axis=1)
        return mean

    def read(
        self, states: FloatArray, present: FloatArray, action: FloatArray, at: int, discrete: Named, parameters: Named
    ) -> FloatArray:
        """Measurements (N, observations) at the points, without noise."""
        return self._at(states, present, action, at, discrete, parameters)[1]

    def spread(
        self, state: FloatArray, present: FloatArray, action: FloatArray, at: int, discrete: Named, parameters: Named
    ) -> tuple[FloatArray, FloatArray | None]:
        """Covariance that the random numbers of a step give the disturbances, and nodes for `next`.

        A rule that is linear in its random numbers has the covariance of its derivatives, and needs
        no nodes. Of another one mean and covariance are those of a Latin hypercube of samples.
        """
        count, chosen = len(self.names), np.flatnonzero(self._at_steps)
        size = len(chosen)
        if not size:
            return np.zeros((count, count)), None
        middle, steps = self._drawn(np.full(len(self._normal), 0.5)), np.zeros((size, len(self._normal)))
        steps[range(size), chosen] = self._wide[chosen]
        points = np.vstack([middle[None], middle + steps, middle - steps, self._nodes])
        many = len(points)
        alike = {name: np.repeat(np.broadcast_to(values, 1), many) for name, values in parameters.items()}
        found = self._at(
            np.tile(state, (many, 1)), np.tile(present, (many, 1)), action, at, discrete, alike, points
        )[0]  # fmt: skip
        base, above, below, samples = np.split(found, [1, size + 1, 2 * size + 1])
        slopes = (above - below) / 2
        expected = base + (self._nodes - middle)[:, chosen] / self._wide[chosen] @ slopes
        if (np.abs(samples - expected) <= 1e-9 * (self.size + np.abs(base))).all():
            return slopes.T @ slopes, None
        away = samples - samples.mean(axis=0)
        return away.T @ away / len(samples), self._nodes

    def ahead(
        self, state: FloatArray, present: FloatArray, action: FloatArray, at: int, discrete: Named, parameters: Named,
        steps: int = 1,
    ) -> dict[str, FloatArray]:  # fmt: skip
        """Values (steps,) of all disturbances in the coming steps by name, at mean random numbers.

        Rules that read the state see the present one. Disturbances that are not estimated begin at
        their declared values.
        """
        count, found = len(self._defaults), np.zeros((steps, len(self._defaults)))
        every, numbers = self._defaults.copy(), self._drawn(np.full(len(self._normal), 0.5))
        every[self._places], numbers[self._drawn_places] = present[: self.moving], present[self.moving :]
        for step in range(steps if count else 0):
            later, _ = self._evaluate(state[None], every[None], action, at + step, discrete, parameters, numbers[None])
            every = later[0]
            found[step] = every
        return dict(zip(self._model.disturbance_names, found.T, strict=True))

    def _at(
        self, states: FloatArray, present: FloatArray, action: FloatArray, at: int, discrete: Named, parameters: Named,
        draws: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        count = len(states)
        every = np.tile(self._defaults, (count, 1))
        every[:, self._places] = present[:, : self.moving]
        numbers = np.tile(self._drawn(np.full(len(self._normal), 0.5)), (count, 1)) if draws is None else draws.copy()
        numbers[:, self._drawn_places] = present[:, self.moving :]
        later, read = self._evaluate(states, every, action, at, discrete, parameters, numbers)
        return np.concatenate([later[:, self._places], present[:, self.moving :]], axis=1), read

    def _evaluate(
        self, states: FloatArray, present: FloatArray, action: FloatArray, at: int, discrete: Named, parameters: Named,
        draws: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        count = len(states)
        if draws is None:
            draws = np.tile(self._drawn(np.full(len(self._normal), 0.5)), (count, 1))
        given = {**self._known(), **parameters}
        return self._model.native.disturbed(
            (np.ascontiguousarray(states), np.tile(action, (count, 1)), present, draws),
            [(name, np.atleast_1d(np.asarray(value, dtype=np.float64))) for name, value in given.items()],
            [(name, np.array([value])) for name, value in discrete.items()],
            at,
        )

    def _known(self) -> dict[str, float]:
        return {name: value for name, value in self._fixed.items() if name in self._model.parameter_names}

    def _drawn(self, shares: FloatArray) -> FloatArray:
        """Random numbers of a step from uniform ones."""
        quantile = np.vectorize(NormalDist().inv_cdf, otypes=[np.float64])
        return np.where(self._normal, quantile(shares), shares) if shares.size else shares

    def _hypercube(self) -> FloatArray:
        """Samples of the random numbers of a step, with exact variances if they are normal."""
        generator, size = np.random.default_rng(0), len(self._normal)
        columns = [generator.permutation(_NODES) for _ in range(size)]
        shares = (np.stack(columns, axis=1) + 0.5) / _NODES if size else np.zeros((_NODES, 0))
        nodes = self._drawn(shares)
        middle = self._drawn(np.full((1, size), 0.5))
        scaled = middle + (nodes - middle) / np.std(nodes, axis=0) if size else nodes
        return np.where(self._at_steps, np.where(self._normal, scaled, nodes), middle)


def drawn_parameters(model: Model, given: Mapping[str, float]) -> dict[str, float]:
    """Standard deviations of the parameters that are drawn at a reset, from many seeds."""
    env = Env(model, normalize=False)
    rows = []
    for seed in range(_SEEDS):
        env.reset(seed=seed, options={"parameters": dict(given)})
        rows.append(list(env.parameters.values()))
    deviations = np.std(rows, axis=0)
    return {name: float(value) for name, value in zip(env.parameters, deviations, strict=True) if value > 0}
