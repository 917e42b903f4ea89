"""Controls that are rivals of learned policies.

A search tunes the numbers of a control by the mean return on training starts, which neither
validation nor test episodes use. `controls.json` has the best numbers, with the budget of the
search; `python -m smpl.benchmark controls --env ENV` makes them again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.controllers import LQR, PID, Loops, OpenLoop, SamplingMPC
from smpl.controllers.full_information import Deferred, followed
from smpl.controllers.pensim import Recipe
from smpl.envs import Env
from smpl.learning.agents import Agent
from smpl.learning.formulation import FormulatedPolicy, Formulation
from smpl.learning.plan import Task
from smpl.support.arguments import FloatArray

FILE = Path(__file__).with_name("controls.json")
Make = Callable[[Task, FloatArray], Any]


@dataclass(frozen=True)
class Control:
    """A control of one environment.

    Attributes:
        what: description of the method.
        make: makes the controller for a task from the numbers.
        low, high: box of the numbers; empty for a control that is not tuned.
        names: of the numbers.
        start: numbers where the search begins; the middle if None.
        starts: training starts of each evaluation.
        evaluations: points of the search.
        method, spread: of the search, see `smpl.optimize.Search`.
        tuning: description for a control without a search.
    """

    what: str
    make: Make
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    names: tuple[str, ...] = ()
    start: tuple[float, ...] | None = None
    starts: int = 20
    evaluations: int = 120
    method: str = "cma"
    spread: float = 0.25
    tuning: str = "not tuned"

    @property
    def budget(self) -> str:
        """Tuning budget in words."""
        if not self.names:
            return self.tuning
        return f"{self.method}, {self.evaluations} x {self.starts} episodes"


class Always:
    """The same action of a formulation at every step."""

    def __init__(self, action: npt.ArrayLike) -> None:
        self._action = np.asarray(action, dtype=np.float64)

    def predict(self, observations: Any) -> FloatArray:
        """The action for each observation."""
        return np.tile(self._action, (len(observations), 1))


def _formulated(formulation: Mapping[str, Any]) -> Make:
    """A constant action of the formulation in which learners act, so that it has their reach."""
    return lambda task, point: FormulatedPolicy(Always(point), Formulation.of(formulation))


def _box(names: Sequence[str]) -> dict[str, Any]:
    return {"low": (-1.0,) * len(names), "high": (1.0,) * len(names), "names": tuple(names)}


def _recipe(moves: int) -> Make:
    """An open-loop recipe, constant in equal parts of an episode; numbers are shares of a box."""

    def make(task: Task, point: FloatArray) -> OpenLoop:
        low, high = task.model.native.bounds("action")
        steps = task.env().max_steps
        parts = np.reshape(point, (moves, len(low)))
        which = np.minimum(np.arange(steps) * moves // steps, moves - 1)
        return OpenLoop(low + (high - low) * (parts[which] + 1) / 2, hold=True)

    return make


def _moves(actions: Sequence[str], moves: int) -> dict[str, Any]:
    return _box([f"{name}[{k + 1}]" for k in range(moves) for name in actions])


def _reactor_loops(task: Task, point: FloatArray) -> Loops:
    """PI of temperature by the jacket and of level by the outflow; times as powers of ten."""
    temperature = PID("T", "T_c", float(point[0]), 10.0 ** float(point[1]))
    level = PID("h", "q_out", float(point[2]), 10.0 ** float(point[3]))
    return Loops(temperature, level)


def _reactor_lqr(task: Task, point: FloatArray) -> LQR:
    return LQR(task.model, integral=("T", "h"))


class Feedback:
    """dq_i = K_i (E - E_ss): proportional feedback of the E-factor to the feeds, within the box."""

    def __init__(self, gains: npt.ArrayLike) -> None:
        self._gains = np.asarray(gains, dtype=np.float64)

    def reset(self, env: Env) -> None:
        """Find the two observations."""
        self._places = [env.observation_names.index(name) for name in ("E", "E_ss")]

    def action(self, env: Env) -> FloatArray:
        """Deviations of the feeds."""
        factor, steady = env.reading[self._places]
        return np.clip(self._gains * (factor - steady), env.action_low, env.action_high)


def _feedback(task: Task, point: FloatArray) -> Feedback:
    return Feedback((0.0, -0.03, 0.0, 0.03))


def _pensim_recipe(task: Task, point: FloatArray) -> OpenLoop:
    """The recipe, its 56 values moved by up to a tenth; the feed of the precursor stays nominal."""
    recipe = Recipe(task.model)
    width = (recipe.high - recipe.low) / 2
    whole = np.append(np.asarray(point), 0.0)
    return OpenLoop(recipe.actions((recipe.low + recipe.high) / 2 + whole * width), hold=True)


def _sampled(share: float, **options: Any) -> Make:
    """Sampling MPC around the nominal policy; standard deviations are shares of the action box."""

    def built(env: Env) -> SamplingMPC:
        width = share * (env.action_high - env.action_low)
        deviation = dict(zip(env.action_names, width.tolist(), strict=True))
        return SamplingMPC(guess=followed, deviation=deviation, method="cem", **options)

    return lambda task, point: Deferred(built)


_PENSIM = {"centre": "recipe", "reach": 0.1, "left": ["discharge", "Fw"]}
_MAB = {
    "centre": "rules",
    "left": ["F_in", "F_r", "F_2", "F_out", "switch"],
    "limits": {"F_1": [21.684, 21.704], "GLC_in": [1800.0, 2000.0], "GLN_in": [12.5, 14.0], "T_c": [35.0, 38.0]},
}
_PLANT = {
    "centre": "rules",
    "left": ["F_in", "F_1", "F_r", "F_2", "GLC_in", "GLN_in", "T_c", "F_out", "switch"],
}
_ATROPINE = {
    "centre": "nominal",
    "limits": {
        "dq1": [-1.9e-5, 1.9e-5],
        "dq2": [-0.00146, 0.00146],
        "dq3": [-0.00021, 0.00021],
        "dq4": [-0.00035, 0.00035],
    },
}
# The nominal action of the reactor, 26.85 degC and 0.1 m^3/min, in shares of the box. The level is
# an integrator, so that a constant outflow holds it near one value only.
_REACTOR = ((26.85 - 25) / 10, (0.1 - 0.125) / 0.075)
_CONSTANT, _OPEN = "constant action, by search", "open-loop recipe, by search"
CONTROLS: dict[str, dict[str, Control]] = {
    "Reactor": {
        "constant": Control(
            _CONSTANT,
            _formulated({}),
            **_box(("T_c", "q_out")),
            start=_REACTOR,
            starts=100,
            evaluations=60,
            spread=0.03,
        ),
        "open_loop": Control(
            _OPEN, _recipe(4), **_moves(("T_c", "q_out"), 4), start=_REACTOR * 4, evaluations=120, spread=0.03
        ),
        "pi": Control(
            "PI of the temperature and PI of the level, tuned by search",
            _reactor_loops,
            low=(0.5, 0.0, -3.0, 0.0),
            high=(20.0, 3.0, -0.05, 3.0),
            names=("K_T", "log10 T_i,T", "K_h", "log10 T_i,h"),
            evaluations=64,
        ),
        "lqr": Control("LQR with integral action on T and h, default weights", _reactor_lqr),
        "sampling": Control(
            "sampling MPC, horizon 20, 48 samples", _sampled(0.2, horizon=20, samples=48, iterations=2, hold=4)
        ),
    },
    "Beer": {
        "constant": Control(
            _CONSTANT, _formulated({}), **_box(("T",)), method="differential_evolution", starts=100, evaluations=64
        ),
        "open_loop": Control(_OPEN, _recipe(10), **_moves(("T",), 10), evaluations=150),
    },
    "PenSim": {
        "constant": Control(
            "recipe with a constant shift, within the reach of the learners, by search",
            _formulated(_PENSIM),
            **_box(("Fs", "Foil", "Fg", "pressure")),
            start=(1.0,) * 4,
            starts=5,
            evaluations=24,
        ),
        "open_loop": Control(
            _OPEN + ": the 56 values of the recipe within a tenth",
            _pensim_recipe,
            **_box([f"v{k}" for k in range(56)]),
            starts=2,
            evaluations=96,
        ),
        "gpei": Control(
            "GPEI: the 56 values of the recipe within a tenth, by a Gaussian process with expected improvement",
            _pensim_recipe,
            **_box([f"v{k}" for k in range(56)]),
            starts=2,
            evaluations=60,
            method="bayes",
        ),
        "sampling": Control(
            "sampling MPC, horizon 60 h, 16 samples",
            _sampled(0.1, horizon=300, samples=16, iterations=1, hold=50, every=50),
        ),
    },
    "Atropine": {
        "constant": Control(
            _CONSTANT, _formulated(_ATROPINE), **_box(("dq1", "dq2", "dq3", "dq4")), starts=5, evaluations=40
        ),
        "feedback": Control(
            "feedback of the E-factor to S2 and S4, -0.03 and 0.03 mL/min per unit",
            _feedback,
            tuning="best of 5 gains on 3 training starts",
        ),
    },
    "MAb": {
        "constant": Control(
            "constant action within the reach of the learners, by search",
            _formulated(_MAB),
            **_box(("F_1", "GLC_in", "GLN_in", "T_c")),
            starts=2,
            evaluations=24,
        ),
    },
    "MAbPlant": {
        "constant": Control(
            "constant action within the reach of the learners, by search",
            _formulated(_PLANT),
            **_box(("c_s_load", "c_s_cex", "c_s_elu", "V_elu", "V_flush")),
            starts=1,
            evaluations=24,
        ),
    },
}


def known(env: str) -> dict[str, Control]:
    """Available controls of an environment: those that are not tuned, and those with numbers."""
    numbers = tuned().get(env, {})
    return {name: one for name, one in CONTROLS.get(env, {}).items() if not one.names or name in numbers}


def tuned(path: Path = FILE) -> dict[str, dict[str, Any]]:
    """Numbers of `controls.json` by environment and control."""
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else {}


def settings(env: str, name: str) -> dict[str, Any]:
    """Settings of a run: description, budget and numbers of a control."""
    control = CONTROLS[env][name]
    found = tuned().get(env, {}).get(name, {})
    return {"control": {"what": control.what, "budget": found.get("budget", control.budget), **_numbers(found)}}


def _numbers(found: Mapping[str, Any]) -> dict[str, Any]:
    return {"point": found["point"]} if "point" in found else {}


def made(task: Task, env: str, name: str, point: Sequence[float] = ()) -> Agent:
    """The control as an agent with its name."""
    return Agent(name, CONTROLS[env][name].make(task, np.asarray(point, dtype=np.float64)))
