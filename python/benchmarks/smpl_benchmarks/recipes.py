"""Recipes of the published data sets: arguments of `smpl.collect` by environment and quality."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

# Seeds of data sets differ from those of training, validation and test episodes.
SEED = 900_000_000


@dataclass(frozen=True)
class Recipe:
    """Arguments of the collection of a data set.

    Attributes:
        env: name of the environment.
        quality: `random`, `medium`, `expert`, `mixed`, or `paper`.
        controllers: names that `smpl.collect` takes; an episode draws one of them.
        episodes: number of episodes.
        noise, epsilon: noise on actions scaled to [-1, 1], and probability of a random action.
        starts: of the episodes; sampled if empty.
        arguments: of the environment.
        about: remarks for the data sheet.
    """

    env: str
    quality: str
    controllers: tuple[str, ...]
    episodes: int
    noise: float = 0.0
    epsilon: float = 0.0
    starts: str = ""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    about: str = ""

    @property
    def name(self) -> str:
        """Name of the data set, also that of Minari."""
        return f"smpl/{self.env.lower()}/{self.quality}-v0"

    def command(self, out: str) -> str:
        """The command that collects it."""
        words = ["python", "-m", "smpl.collect", f"smpl/{self.env}-v0"]
        for key, value in self.arguments.items():
            words += [f"--{key}", str(value)]
        for one in self.controllers:
            words += ["--controller", one]
        words += ["--episodes", str(self.episodes), "--seed", str(SEED)]
        for key, number in (("--noise", self.noise), ("--epsilon", self.epsilon)):
            words += [key, f"{number:g}"] if number else []
        words += ["--starts", self.starts] if self.starts else []
        return shlex.join([*words, "--out", out])


_REACTOR = {"scenario": "legacy", "reward": "setpoint_change"}
_BEER = {"scenario": "legacy"}
_NO_RANDOM = "random actions end an episode of this process in its first step: the set has small noise instead"


def _four(
    env: str, medium: str, expert: str, episodes: int, noise: float, arguments: Mapping[str, Any], about: str = ""
) -> list[Recipe]:
    """The four qualities: random actions, a baseline with noise, the best control, half of each."""
    if about:
        first = Recipe(env, "random", ("nominal",), episodes, noise / 2, 0.0, "", arguments, about)
    else:
        first = Recipe(env, "random", ("random",), episodes, arguments=arguments)
    return [
        first,
        Recipe(env, "medium", (medium,), episodes, noise, arguments=arguments),
        Recipe(env, "expert", (expert,), episodes, arguments=arguments),
        Recipe(env, "mixed", (medium, expert), episodes, noise / 2, arguments=arguments),
    ]


_EVERY = [
    *_four("Reactor", "pid", "lqr", 1000, 0.2, _REACTOR),
    *_four("Beer", "isothermal", "constant:14", 1000, 0.3, _BEER),
    *_four("PenSim", "recipe", "full_information", 100, 0.02, {}),
    *_four("Atropine", "nominal", "full_information", 200, 0.05, {}),
    *_four("MAb", "nominal", "empc", 50, 0.0005, {}, _NO_RANDOM),
    *_four("MAbPlant", "nominal", "full_information", 20, 0.0005, {}, _NO_RANDOM),
    # The sets of the paper of 2022.
    Recipe(
        "Reactor", "paper", ("mpc",), 125_000, 0.0, 0.0, "unclipped_grid:0.3:50",
        {"scenario": "legacy", "reward": "setpoint"}, "the grid of 50 points for each of three states",
    ),
    Recipe("Atropine", "paper", ("mpc",), 10_000, 0.0, 0.0, "", {"scenario": "legacy"}),
    Recipe(
        "PenSim", "paper", ("recipe",), 1000, 0.1, 0.0, "", {"scenario": "legacy"},
        "the paper has recipes of a search; `python -m smpl.published pensim-gpei` repeats that search",
    ),
    Recipe("MAb", "paper", ("mpc",), 1000, 0.0, 0.0, "spread:0.05", {"scenario": "legacy"}),
]  # fmt: skip
RECIPES = {(one.env, one.quality): one for one in _EVERY}
QUALITIES = tuple(dict.fromkeys(one.quality for one in _EVERY))
