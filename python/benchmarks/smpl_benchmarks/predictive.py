"""Predictive control whose weights and model are learned by gradients, `DiffNMPC` (extra `mpc`).

B. Amos, I. Jimenez, J. Sacks, B. Boots, J. Z. Kolter, Differentiable MPC for end-to-end planning
and control, NeurIPS 2018. The return of an episode is differentiated through all its decisions
(`NMPC.derivatives`) and through the plant (`linearize_step`), forwards in time.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from smpl.analysis.sensitivity import StepDerivatives, linearize_step
from smpl.controllers import NMPC
from smpl.envs import Env
from smpl.learning.formulation import Formulation
from smpl.learning.plan import Task
from smpl.support.arguments import FloatArray
from smpl.support.optional import load
from smpl_benchmarks.hyperparameters import Checked

NAME = "DiffNMPC"
# Difference of an episode and its derivation, relative to the largest value.
_SAME = 1e-3
# Decay rates and the least denominator of Adam.
_ADAM = (0.9, 0.99, 1e-8)


@dataclass(frozen=True)
class Hyperparameters(Checked):
    """Hyperparameters of `DiffNMPC`.

    Attributes:
        nmpc: options of `smpl.controllers.NMPC`; the weights and parameters are where it begins.
        tuned: names of what is learned, see `NMPC.adjust`: positive numbers, by their logarithm.
        rate: learning rate of the logarithms.
        episodes: episodes of an update.
        most: largest derivative of an episode's return that counts, by its norm.
    """

    NAME: ClassVar[str] = NAME
    COUNTS: ClassVar[tuple[str, ...]] = ("episodes",)

    nmpc: Mapping[str, Any] = field(default_factory=dict)
    tuned: tuple[str, ...] = ()
    rate: float = 0.1
    episodes: int = 4
    most: float = 10.0

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Hyperparameters:
        """From a mapping.

        Raises:
            ValueError: an unknown name or an invalid number.
            NotImplementedError: there is no controller to tune.
        """
        made = super().of({**given, "tuned": tuple(given.get("tuned", ()))})
        if not made.nmpc or not made.tuned:
            raise NotImplementedError(f"{NAME} has no controller for this process: give `nmpc` and `tuned`")
        return made


@dataclass(frozen=True)
class Gradient:
    """The return of an episode, its derivatives by the tuned values, and its steps."""

    value: float
    by: FloatArray
    steps: int


class PredictiveTrainer:
    """The algorithm `DiffNMPC`.

    Args:
        task: the environment.
        formulation: scale, range and reward of a failure of the training.
        hyperparameters: see `Hyperparameters`.

    Raises:
        ImportError: CasADi is missing.
        ValueError: an unknown hyperparameter or value.
    """

    def __init__(self, task: Task, formulation: Formulation, hyperparameters: Mapping[str, Any]) -> None:
        load("casadi", NAME)
        self.hyper, self._formulation = Hyperparameters.of(hyperparameters), formulation
        self.env = Env(task.model, **{**task.arguments, "normalize": False})
        self.controller = NMPC(self.env, tunable=True, **self.hyper.nmpc)
        self.begin(0)

    def begin(self, seed: int) -> None:
        """Make a new learner, which begins with the given weights and parameters."""
        values = np.array([self._first(name) for name in self.hyper.tuned])
        if not (values > 0).all():
            wrong = self.hyper.tuned[int(np.argmin(values))]
            raise ValueError(f"tuned: {wrong} is {values.min():g}, expected a positive number")
        zeros = [0.0] * len(values)
        self._state: dict[str, Any] = {
            "logarithms": np.log(values).tolist(),
            "first": zeros,
            "second": zeros,
            "count": 0,
        }

    def _first(self, name: str) -> float:
        kind, _, what = name.partition(":")
        options = self.hyper.nmpc
        if not what:
            own = options.get("p")
            return float(own[name] if isinstance(own, Mapping) and name in own else self.env.parameters[name])
        group = {"cost": "cost", "terminal": "terminal", "rate": "rate_weight", "target": "set_point"}.get(kind, "")
        given = options.get(group)
        if not isinstance(given, Mapping) or what not in given:
            raise ValueError(f"tuned has {name!r}, which `nmpc` does not give")
        return float(given[what])

    @property
    def values(self) -> dict[str, float]:
        """The present values of what is tuned."""
        return dict(zip(self.hyper.tuned, np.exp(self._state["logarithms"]).tolist(), strict=True))

    def load(self, folder: Path) -> None:
        """Make the learner of a checkpoint."""
        self._state = json.loads((folder / "learner.json").read_text(encoding="utf-8"))

    def save(self, folder: Path) -> None:
        """Write the values and the state of the optimiser."""
        (folder / "learner.json").write_text(json.dumps(self._state), encoding="utf-8")

    def export(self, folder: Path) -> str:
        """Write the options of the controller and the values that were learned."""
        content = {"nmpc": {**self.hyper.nmpc, "tunable": True}, "values": self.values}
        (folder / "policy.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        return "policy.json"

    def train(self, steps: int, seed: int, progress: float) -> None:
        """Go on by about so many steps of the process, with new episodes."""
        done, number = 0, 0
        while done < steps:
            found = [self.gradient(seed + number + i) for i in range(self.hyper.episodes)]
            number += self.hyper.episodes
            done += sum(one.steps for one in found)
            self._ascend(np.mean([_limited(one.by, self.hyper.most) for one in found], axis=0))

    def _ascend(self, by: FloatArray) -> None:
        """A step of Adam on the logarithms."""
        state, (first, second, least) = self._state, _ADAM
        state["count"] += 1
        logarithms, means, squares = (np.array(state[key]) for key in ("logarithms", "first", "second"))
        means = first * means + (1 - first) * by
        squares = second * squares + (1 - second) * by**2
        unbiased = means / (1 - first ** state["count"]), squares / (1 - second ** state["count"])
        logarithms += self.hyper.rate * unbiased[0] / (np.sqrt(unbiased[1]) + least)
        state |= {"logarithms": logarithms.tolist(), "first": means.tolist(), "second": squares.tolist()}

    def gradient(self, seed: int) -> Gradient:
        """The return of the episode of a seed, with derivatives by the logarithms.

        A failure ends the derivation: its reward jumps. A decision without a solution that has
        converged counts as constant.

        Raises:
            NotImplementedError: the episode is not a function of states, given values and actions.
            SimulationError: a step has no derivative.
        """
        env, controller, values = self.env, self.controller, self.values
        controller.adjust(values)
        env.reset(seed=seed)
        controller.reset(env)
        sizes = np.array(list(values.values()))
        by_state, by_previous = np.zeros((len(env.state), len(sizes))), np.zeros((len(env.action_names), len(sizes)))
        total, by, ended = 0.0, np.zeros(len(sizes)), False
        while not ended:
            state, step, given = env.state, env.steps, _given(env)
            action = controller.action(env)
            moved = self._moved(by_state, by_previous, sizes)
            _, reward, terminated, truncated, info = env.step(action)
            failed = terminated and bool(info["failure"])
            total += float(self._formulation.reward(np.array(reward), np.array(failed)))
            ended = terminated or truncated
            if failed:
                break
            given |= dict(zip(env.disturbance_names, env.native.values("disturbance").tolist(), strict=True))
            found = linearize_step(env.model, state, action, given, first_step=step)
            gain = self._slope(found, env, reward, ended)
            by += gain[0] @ by_state + gain[1] @ moved
            by_state, by_previous = found.dx_dx @ by_state + found.dx_du @ moved, moved
        return Gradient(total, by, env.steps)

    def _moved(self, by_state: FloatArray, by_previous: FloatArray, sizes: FloatArray) -> FloatArray:
        """Derivatives of the action by the logarithms."""
        names = self.env.action_names
        moved = np.zeros((len(names), len(sizes)))
        try:
            found = self.controller.derivatives()
        except ValueError:
            return moved
        places = [names.index(name) for name in found.actions]
        e = [self.env.state_names.index(name) for name in self.controller.predicted_names]
        own = np.stack([found.by[name] for name in self.hyper.tuned], axis=1) * sizes
        moved[places] = found.by_state @ by_state[e] + found.by_previous @ by_previous[places] + own
        return moved

    def _slope(self, found: StepDerivatives, env: Env, reward: float, ended: bool) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the learner's reward by state and action.

        Raises:
            NotImplementedError: the derivation has another state or reward than the episode.
        """
        at = env.model.reward_names.index(env.model.reward)
        here = [*found.states, *([] if ended else [found.rewards[at]])]
        there = [*env.state, *([] if ended else [reward])]
        for name, mine, other in zip((*env.state_names, "the reward"), here, there, strict=False):
            if abs(mine - other) > _SAME * max(abs(other), 1e-6):
                raise NotImplementedError(
                    f"{env.model.name}: {name} of an episode is {other:.6g}, but {mine:.6g} from its states, discrete "
                    "variables, disturbances and actions: keep initial or earlier values in discrete variables"
                )
        formulation = self._formulation
        scaled, (low, high) = reward * formulation.reward_scale, formulation.reward_range or (-math.inf, math.inf)
        slope = formulation.reward_scale if low < scaled < high else 0.0
        return slope * found.dr_dx[at], slope * found.dr_du[at]


def _given(env: Env) -> dict[str, float]:
    """Discrete variables, and parameters that are not the declared ones."""
    declared = env.model.native.defaults("parameter").tolist()
    pairs = zip(env.model.parameter_names, declared, env.native.values("parameter").tolist(), strict=True)
    given = {name: value for name, before, value in pairs if value != before}
    return given | dict(zip(env.discrete_names, env.discrete.tolist(), strict=True))


def _limited(by: FloatArray, most: float) -> FloatArray:
    """A derivative, shortened to the largest norm; zero if it is not finite."""
    size = float(np.linalg.norm(by))
    return by * min(1.0, most / max(size, 1e-300)) if math.isfinite(size) else np.zeros_like(by)
