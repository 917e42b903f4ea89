"""The search over recipes of the penicillin fermentation (`gpei`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from smpl.controllers.base import TakesWrapped, require
from smpl.controllers.bayesian import BayesianOptimization
from smpl.envs import Env
from smpl.model import Model
from smpl.support.arguments import FloatArray

# Times in hours until which each value of the recipe holds.
UNTIL = {
    "discharge": (100, 102, 130, 132, 150, 152, 170, 172, 190, 192, 210, 212, 230),
    "Fs": (3, 12, 16, 20, 24, 28, 32, 36, 40, 44, 48, 52, 56, 60, 64, 68, 72, 76, 80, 160, 230),
    "Foil": (4, 16, 56, 60, 64, 68, 72, 76, 80, 230),
    "Fg": (8, 20, 40, 90, 200, 230),
    "pressure": (12.4, 25, 30, 40, 100, 150, 200, 230),
    "Fw": (50, 75, 150, 160, 170, 200, 230),
}
FEED = "Fpaa_start"
_WIDTH = 0.1


class Recipe:
    """The recipe as numbers: nonzero values, and the feed of phenylacetic acid in 25 steps.

    Args:
        model: the fermentation, schedule `hours` for the last number to have an effect.

    Attributes:
        names: `Fs until 3 h` and so on.
        nominal: the recipe's own numbers, (57,).
        low, high: nominal times 0.9 and 1.1, cut to the action box.
        start: expected state at the start of a batch.
    """

    def __init__(self, model: Model) -> None:
        self.model = model
        env = Env(model, normalize=False)
        require(env, "the search over recipes", tuple(UNTIL))
        env.reset(seed=0, options={"start": "nominal"})
        self.start, self._steps = env.state, model.max_steps
        self._base = self._followed(env)
        self._segments, nominal, names = self._cut(env)
        self.nominal, self.names = np.array([*nominal, env.parameters[FEED]]), (*names, FEED)
        columns = [column for column, _, _ in self._segments]
        low, high = env.action_low[columns], env.action_high[columns]
        self.low = np.append(np.maximum(low, (1 - _WIDTH) * self.nominal[:-1]), (1 - _WIDTH) * self.nominal[-1])
        self.high = np.append(np.minimum(high, (1 + _WIDTH) * self.nominal[:-1]), (1 + _WIDTH) * self.nominal[-1])

    @property
    def actions_of_steps(self) -> FloatArray:
        """The recipe's own actions of all steps, (steps, actions)."""
        return self._base.copy()

    def actions(self, point: FloatArray) -> FloatArray:
        """Actions of all steps, (steps, actions)."""
        chosen = self._base.copy()
        for value, (column, first, last) in zip(point[:-1], self._segments, strict=True):
            chosen[first:last, column] = value
        return chosen

    def returns(self, points: FloatArray, seed: int | None = None) -> FloatArray:
        """Penicillin of batches in kg: expected, or with the random numbers of a seed."""
        plans = np.stack([self.actions(point) for point in points])
        feed = {FEED: points[:, -1]}
        if seed is None:
            return self.model.rollout(self.start, plans, parameters=feed).returns
        found = [
            self.model.rollout(self.start, plan, parameters={FEED: point[-1]}, seed=seed).returns[0]
            for plan, point in zip(plans, points, strict=True)
        ]
        return np.array(found)

    def _followed(self, env: Env) -> FloatArray:
        """The nominal policy's actions: a function of the time alone, read off one batch."""
        actions = []
        for _ in range(self._steps):
            action = env.policy("nominal")
            actions.append(action)
            _, _, terminated, truncated, info = env.step(action)
            if (terminated or truncated) and len(actions) < self._steps:
                raise ValueError(f"the recipe itself failed in step {len(actions)}: {info['failure']}")
        return np.array(actions)

    def _cut(self, env: Env) -> tuple[list[tuple[int, int, int]], list[float], list[str]]:
        """Places (action, first step, last step), values and names of what is not zero."""
        segments, values, names = [], [], []
        for name, times in UNTIL.items():
            column, first = env.action_names.index(name), 0
            for until in times:
                last = round(until / self.model.step)
                value = float(self._base[first, column])
                if value != 0:
                    segments.append((column, first, last))
                    values.append(value)
                    names.append(f"{name} until {until} h")
                first = last
        return segments, values, names


class RecipeSearch(TakesWrapped):
    """`gpei` of the paper: the best recipe that a Gaussian process with expected improvement finds.

    The search runs at the first reset, or goes on from its file, and is then followed without
    feedback. Its last number is a parameter of the episode, `controller.parameters`, to be given as
    `options={"parameters": ...}`.

    Args:
        searches: after the `initial` random recipes.
        initial: random recipes.
        file: where the search is kept, a CSV file.
        seed: of the search.
        batch: recipes that are simulated at once.
        batch_seed: random numbers of the batch that is optimised; the expected batch if none.
    """

    def __init__(
        self,
        searches: int = 100,
        *,
        initial: int = 10,
        file: str | Path | None = None,
        seed: int = 0,
        batch: int = 2,
        batch_seed: int | None = None,
    ) -> None:
        self._evaluations, self._batch_seed = initial + searches, batch_seed
        self._options: dict[str, Any] = {"initial": initial, "file": file, "seed": seed, "batch": batch, "decimals": 3}
        self.search: BayesianOptimization | None = None
        self.parameters: dict[str, float] = {}
        self._plan = np.zeros((0, 0))

    def reset(self, env: Env) -> None:
        """Search, at the first time."""
        require(env, "the search over recipes", tuple(UNTIL))
        if self.search is not None:
            return
        recipe = Recipe(env.model)
        search = BayesianOptimization(recipe.low, recipe.high, names=recipe.names, **self._options)
        search.run(lambda points: recipe.returns(points, self._batch_seed), self._evaluations)
        self.search, best = search, search.best[0]
        self._plan, self.parameters = recipe.actions(best), {FEED: float(best[-1])}

    def action(self, env: Env) -> FloatArray:
        """The recipe's action of the step; the last one beyond its end."""
        return self._plan[min(env.steps, len(self._plan) - 1)].copy()
