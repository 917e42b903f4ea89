"""Solvers of a horizon's programme: fatrop, IPOPT and sequential quadratic programming, all of CasADi's wheel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from smpl._arguments import FloatArray, as_count, as_number
from smpl.controllers.collocation import Programme, Transcription
from smpl.controllers.nmpc_starts import Simulation

SOLVERS = ("auto", "fatrop", "ipopt", "sqp")
# Above so many variables the sparse quadratic programmes of `sqp` take longer than fatrop.
_SMALL = 1500
# Above so many variables a stage IPOPT's sparse factorisation is faster than fatrop's dense blocks.
_WIDE = 60
# Changes of the active set after which a quadratic programme is given up.
_CHANGES = 30
# Iterations of `sqp` after which `auto` gives it up.
_WARM = 6
# A point that breaks no equation by more (in scaled variables) can be followed, whatever else it lacks.
_FEASIBLE = 1e-5
# Interior points that need more iterations go to and fro at a kink.
_ENDLESS = 500
# IPOPT's own limit of a decision where no budget is given, s of the processor: a busy machine decides the same.
_LONGEST = 60.0


@dataclass
class Solution:
    """A point of the programme.

    Attributes:
        actions, states: physical units, (H, actions) and (H + 1, states).
        cost: scaled, with the price of broken bounds.
        retried: IPOPT found it after the chosen solver had not.
        unfinished: what a solver had when it stopped, followed by the equations.
    """

    programme: Programme
    x: FloatArray
    lam_x: FloatArray
    lam_g: FloatArray
    actions: FloatArray
    states: FloatArray
    cost: float = np.inf
    retried: bool = False
    unfinished: bool = False

    def shifted(self) -> Solution:
        """What is left an interval later; the last interval again at its end."""
        if self.programme.structure["nu"].count(self.programme.structure["nu"][0]) != self.programme.task.horizon:
            x = self.x.copy()
            _shift(x, self.programme.states)
        else:
            x = self.x.copy()
            for places in (self.programme.states, self.programme.actions, self.programme.inner, self.programme.slack):
                _shift(x, places)
        later = [np.concatenate([part[1:], part[-1:]]) for part in (self.actions, self.states)]
        return replace(self, x=x, actions=later[0], states=later[1])

    def broken(self) -> list[str]:
        """Bounds that it does not hold, and the bounds of actions that it lies on."""
        programme, task = self.programme, self.programme.task
        found, soft = [], [limit for limit in task.limits if limit.soft]
        slack = self.x[programme.slack].reshape(task.horizon, len(soft))
        for j, limit in enumerate(soft):
            over = float(slack[:, j].max(initial=0.0)) * limit.size
            if over > 1e-4 * limit.size:
                count = int((slack[:, j] > 1e-4).sum())
                inside = f"{limit.low:g} to {limit.high:g}"
                unit = task.expressions.unit(limit.name)
                found.append(
                    f"{limit.name} in {inside} {unit} is missed by {over:.3g} ({count} of {task.horizon} steps)"
                )
        if found:
            width = task.high - task.low
            for i, name in enumerate(task.actions):
                for side, bound in (("lower", task.low[i]), ("upper", task.high[i])):
                    if abs(self.actions[0, i] - bound) <= 1e-4 * width[i]:
                        found.append(f"{name} is at its {side} bound {bound:g} {task.expressions.unit(name)}")
        return found


def _shift(x: FloatArray, places: Any) -> None:
    if places.size and places.ndim == 2:
        x[places[:-1]] = x[places[1:]]


class Solver:
    """Solves the programme of a task from a state.

    Args:
        transcription: of the task.
        name: one of `SOLVERS`; `auto` is `sqp` for a small problem with a warm start, `ipopt` for stages of many
            variables, else `fatrop`.
        tolerance: of the solver.
        iterations: its limit; its own if None.
        budget: seconds a decision, or None.
        starts: further first guesses where there is no last plan.
    """

    def __init__(
        self,
        transcription: Transcription,
        name: str,
        tolerance: float,
        iterations: int | None,
        budget: float | None,
        starts: int = 0,
    ) -> None:
        self._transcription, self._name = transcription, name
        self._tolerance = as_number("tolerance", tolerance)
        self._iterations = None if iterations is None else as_count("iterations", iterations)
        self._budget = budget
        self._programme = transcription.programme()
        self._made: dict[str, Any] = {}
        self._elastic: Solver | None = None
        self._simulation: Simulation | None = None
        self._starts = starts

    def prepare(self) -> None:
        """Make the solvers, so that the first decision does not."""
        for name in (*self._order(warm=True), *self._order(warm=False)):
            self._solver(name)
        if self._starts:
            self._simulated()

    def step(self, state: FloatArray, action: FloatArray, given: FloatArray, at: float) -> FloatArray:
        """The state an interval later by the equations of the programme."""
        return self._simulated().step(state, action, given, at)

    def _simulated(self) -> Simulation:
        if self._simulation is None:
            self._simulation = Simulation(self._transcription, self._programme)
        return self._simulation

    def solve(
        self,
        given: tuple[Any, ...],
        old: Solution | None,
        rest: tuple[FloatArray, FloatArray],
        action: FloatArray,
    ) -> Solution | None:
        """The best plan; None where none was found.

        Args:
            given: state, action before, values for all intervals, values of each, time.
            old: the last plan, shifted, or None.
            rest: states and algebraic variables of the first guess.
            action: actions of the first guess.
        """
        if not all(np.isfinite(part).all() for part in given):
            return None
        first = self._guess(rest, action)
        found = self._attempts(given, first if old is None else old, self._guess((given[0], rest[1]), action))
        if old is None and self._starts:
            name = self._order(warm=False)[0]
            others = self._simulated().best(given, action, self._parameters(given), self._starts)
            found += [one for x in others if (one := self._run(name, given, replace(first, x=x))) is not None]
        best = min(found, key=lambda one: one.cost, default=None)
        if best is not None and best.unfinished:
            # It has to be worth more than to go on.
            plan = np.tile(action, (len(best.actions), 1)) if old is None else old.actions
            going_on = self._followed(given, plan)
            return best if going_on is None or best.cost < going_on.cost else None
        return best

    def _attempts(self, given: tuple[Any, ...], first: Solution, again: Solution) -> list[Solution]:
        """What one solver after another finds from a guess, until one is finished; IPOPT from another guess too."""
        found: list[Solution] = []
        retry = "ipopt" not in self._order(warm=False) and self._budget is None
        attempts = [(name, first, False) for name in self._order(warm=first.actions.size > 0)]
        attempts += [("ipopt", first, True), ("ipopt", again, True)] if retry else []
        for name, guess, retried in attempts:
            one = self._run(name, given, guess)
            if one is not None:
                found.append(replace(one, retried=retried))
                if not one.unfinished:
                    break
        return found

    def _followed(self, given: tuple[Any, ...], actions: FloatArray) -> Solution | None:
        """A plan and what it leads to; None if that is not known or breaks what must hold."""
        programme, t = self._programme, self._transcription
        x = self._simulated().follow(given, actions)
        cost, broken = self._simulated().complete(x, self._parameters(given))
        if broken > _FEASIBLE:
            return None
        states = x[programme.states] * t.e.state_scale
        zeros = np.zeros(len(programme.g_lower))
        return Solution(programme, x, np.zeros(len(x)), zeros, actions, states, cost, unfinished=True)

    def _order(self, *, warm: bool) -> list[str]:
        """Solvers that are tried; an active set is warm only after a solution."""
        wide = max(self._programme.structure["nu"]) > _WIDE
        if self._name == "ipopt" or (self._name == "auto" and wide):
            # An economic optimum moves along its bounds, of which a warm start is too sure.
            return ["ipopt_warm", "ipopt"] if warm and self._transcription.task.convex else ["ipopt"]
        if self._name != "auto":
            return [self._name]
        small = len(self._programme.lower) <= _SMALL and self._transcription.task.convex
        return ["sqp", "fatrop"] if small and warm else ["fatrop"]

    def elastic(
        self, given: tuple[Any, ...], old: Solution | None, rest: tuple[FloatArray, FloatArray], action: FloatArray
    ) -> Solution | None:
        """The plan that breaks the bounds that had to hold least; None if there are none, or no time."""
        task = self._transcription.task
        if all(limit.soft for limit in task.limits) or not all(np.isfinite(part).all() for part in given):
            return None
        if self._elastic is None:
            soft = [replace(limit, weight=1e4) if not limit.soft else limit for limit in task.limits]
            self._elastic = Solver(Transcription(replace(task, limits=soft)), "ipopt", 1e-6, None, self._budget)
        return self._elastic.solve(given, None, rest if old is None else (given[0], rest[1]), action)

    def _guess(self, rest: tuple[FloatArray, FloatArray], action: FloatArray) -> Solution:
        """The same state and action all along."""
        programme, t = self._programme, self._transcription
        x = np.zeros(len(programme.lower))
        state, algebraic = rest[0] / t.e.state_scale, rest[1] / t.e.algebraic_scale
        x[programme.states] = state
        x[programme.actions] = action / t.scale
        if programme.previous.size:
            x[programme.previous] = action / t.scale
        cells = t.width // (t.n + t.nz)
        x[programme.inner] = np.tile(np.concatenate([state, algebraic]), cells)
        x = np.clip(x, programme.lower, programme.upper)
        zeros = np.zeros(len(programme.g_lower))
        return Solution(programme, x, np.zeros(len(x)), zeros, np.zeros((0, 0)), np.zeros((0, 0)))

    def _run(self, name: str, given: tuple[Any, ...], first: Solution) -> Solution | None:
        programme, t = self._programme, self._transcription
        solver = self._solver(name)
        try:
            found = solver(
                x0=first.x, lam_x0=first.lam_x, lam_g0=first.lam_g, p=self._parameters(given),
                lbx=programme.lower, ubx=programme.upper, lbg=programme.g_lower, ubg=programme.g_upper,
            )  # fmt: skip
        except RuntimeError:
            return None
        x, g = np.asarray(found["x"]).ravel(), np.asarray(found["g"]).ravel()
        stats = solver.stats()
        if not np.isfinite(x).all():
            return None
        actions = np.clip(x[programme.actions] * t.scale, t.task.low, t.task.high)
        if not (stats["success"] or self._usable(name, x, g)):
            limited = self._budget is not None or self._iterations is not None or name == "sqp"
            return None if limited else self._followed(given, actions)
        states = x[programme.states] * t.e.state_scale
        lam_x = self._active(np.asarray(found["lam_x"]).ravel(), x, programme.lower, programme.upper)
        lam_g = self._active(np.asarray(found["lam_g"]).ravel(), g, programme.g_lower, programme.g_upper)
        return Solution(programme, x, lam_x, lam_g, actions, states, float(found["f"]))

    def _parameters(self, given: tuple[Any, ...]) -> FloatArray:
        state, before, constant, varying, at = given
        t = self._transcription
        return np.concatenate([state / t.e.state_scale, before / t.scale, constant, varying, [at]])

    @staticmethod
    def _active(multipliers: FloatArray, values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Multipliers, 0 away from bounds, where an interior point leaves small ones: an active set begins there."""
        near = np.minimum(values - low, high - values) <= 1e-5
        return np.where(near, multipliers, 0.0)

    def _usable(self, name: str, x: FloatArray, g: FloatArray) -> bool:
        """Whether a point at which a solver stopped early meets the equations."""
        programme = self._programme
        if self._budget is None and self._iterations is None:
            return False
        worst = max(
            float(np.max(programme.g_lower - g, initial=0.0)), float(np.max(g - programme.g_upper, initial=0.0)),
            float(np.max(programme.lower - x, initial=0.0)), float(np.max(x - programme.upper, initial=0.0)),
        )  # fmt: skip
        # One iteration of the real-time scheme leaves an error of second order.
        return bool(worst <= (1e-2 if name == "sqp" else _FEASIBLE))

    def _solver(self, name: str) -> Any:
        if name not in self._made:
            import casadi as ca

            functions = self._programme.functions
            # A function that CasADi could not evaluate is told by what is returned, not on the screen.
            quiet: dict[str, Any] = {"print_time": False, "show_eval_warnings": False, "error_on_fail": False}
            quiet["calc_lam_p"] = False
            make = {"fatrop": self._fatrop, "ipopt": self._ipopt, "ipopt_warm": self._warm, "sqp": self._sqp}[name]
            plugin = {"sqp": "sqpmethod", "ipopt_warm": "ipopt"}.get(name, name)
            self._made[name] = ca.nlpsol("horizon", plugin, functions, {**quiet, **make()})
        return self._made[name]

    def _fatrop(self) -> dict[str, Any]:
        options: dict[str, Any] = {"print_level": 0, "tolerance": self._tolerance}
        options["max_iter"] = self._iterations or _ENDLESS
        return {"fatrop": options, **self._programme.structure}

    def _ipopt(self) -> dict[str, Any]:
        options: dict[str, Any] = {"print_level": 0, "sb": "yes", "tol": self._tolerance, "max_iter": _ENDLESS}
        if max(self._programme.structure["nu"]) > _WIDE:
            options["mumps_pivot_order"] = 0  # minimum degree orders a long band better than what MUMPS chooses
        if self._budget is None:
            options["max_cpu_time"] = _LONGEST
        else:
            options["max_wall_time"] = self._budget
        if self._iterations is not None and self._name == "ipopt":
            options["max_iter"] = self._iterations
        return {"ipopt": options}

    def _warm(self) -> dict[str, Any]:
        """IPOPT from a point near the solution and its multipliers."""
        options = self._ipopt()["ipopt"]
        push = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac", "mult_bound_push")
        options |= {f"warm_start_{name}": 1e-6 for name in push}
        return {"ipopt": {**options, "warm_start_init_point": "yes", "mu_init": 1e-4}}

    def _sqp(self) -> dict[str, Any]:
        quiet = {"print_header": False, "print_iteration": False, "print_status": False}
        inner = {"print_time": False, "print_iter": False, "print_header": False, "print_info": False}
        return {
            **quiet,
            "qpsol": "qrqp",
            "qpsol_options": {**inner, "error_on_fail": False, "max_iter": _CHANGES if self._name == "auto" else 1000},
            "max_iter": self._iterations or (_WARM if self._name == "auto" else 50),
            "tol_pr": self._tolerance,
            "tol_du": self._tolerance,
        }
