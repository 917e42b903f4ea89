"""Solvers of a horizon's programme from CasADi: fatrop, IPOPT and SQP."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from smpl.controllers.collocation import Programme, Transcription
from smpl.controllers.nmpc_guess import Guesses
from smpl.controllers.nmpc_plugins import WIDE, Settings, plugin
from smpl.controllers.nmpc_starts import Simulation
from smpl.controllers.nmpc_watch import Watched
from smpl.support.arguments import FloatArray

SOLVERS = ("auto", "fatrop", "ipopt", "sqp")
# Above so many variables the sparse quadratic programmes of `sqp` take longer than fatrop.
_SMALL = 1500
# A point that breaks no equation by more (in scaled variables) can be followed, whatever else it
# lacks.
_FEASIBLE = 1e-5
# Seconds that the search for the least broken bounds has, whatever the solvers before it took.
_LEAST = 0.5
# Most decisions for which a solver that failed is left out.
_LONGEST_PAUSE = 32


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
        """The remaining plan an interval later; the last interval again at its end."""
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


# Name of a solver, first guess, and whether it retries what another one did not solve.
Attempt = tuple[str, Callable[[], Solution | None], bool]


class Pauses:
    """Failed solvers pause for 1, 4, 16, ... decisions; each success halves the next pause."""

    def __init__(self) -> None:
        self._pause: dict[str, int] = {}
        self._left: dict[str, int] = {}

    def begin(self) -> None:
        """Begin a decision."""
        self._left = {key: left - 1 for key, left in self._left.items() if left > 1}

    def ready(self, key: str) -> bool:
        """Return whether to try it in this decision."""
        return key not in self._left

    def failed(self, key: str) -> None:
        """Leave it out of the next decisions."""
        self._pause[key] = min(max(4 * self._pause.get(key, 0), 1), _LONGEST_PAUSE)
        self._left[key] = self._pause[key] + 1

    def succeeded(self, key: str) -> None:
        """Trust it more."""
        self._pause[key] = self._pause.get(key, 0) // 2


class Solver:
    """Solves the programme of a task from a state.

    Args:
        transcription: of the task.
        settings: name of the solver, one of `SOLVERS`, and its limits; `auto` is `sqp` for a small
            problem with a warm start, `ipopt` for stages of many variables, else `fatrop`.
        starts: further first guesses where there is no last plan.
        limit: seconds of a decision, of all attempts together.

    Attributes:
        limit: as above.
        statuses: results of the solvers that the last decision called, in their order.
    """

    def __init__(self, transcription: Transcription, settings: Settings, starts: int = 0, limit: float = 60.0) -> None:
        self._transcription, self._settings = transcription, settings
        self._programme = transcription.programme()
        self._made: dict[str, Watched] = {}
        self._elastic: Solver | None = None
        self._simulation: Simulation | None = None
        self._guesses: Guesses | None = None
        self._starts, self.limit, self._deadline = starts, limit, np.inf
        self._pauses = Pauses()
        self.statuses: list[str] = []

    def prepare(self) -> None:
        """Makes the solvers before the first decision; forgets failures of the last episode."""
        self._pauses = Pauses()
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

    def _guessed(self) -> Guesses:
        if self._guesses is None:
            solver = self._solver(self._order(warm=False)[0]).solver
            self._guesses = Guesses(self._transcription, self._programme, solver)
        return self._guesses

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

        Raises:
            ValueError: the equations or the cost are not finite at the first guess, nor near it.
        """
        self._deadline, self.statuses = time.perf_counter() + self.limit, []
        self._pauses.begin()
        if not all(np.isfinite(part).all() for part in given):
            self.statuses.append("the state or a given value is not finite")
            return None
        cold = [(rest, action), ((given[0], rest[1]), action)]
        found = self._attempts(given, [] if old is None else [old], cold)
        if old is None and self._starts:
            name = self._order(warm=False)[0]
            others = self._simulated().best(given, action, self.parameters(given), self._starts)
            first = self._guess(rest, action)
            finite = [x for one in others if (x := self._guessed().finite(one, self.parameters(given))) is not None]
            found += [one for x in finite if (one := self._run(name, given, replace(first, x=x))) is not None]
        best = min(found, key=lambda one: one.cost, default=None)
        if best is not None and best.unfinished:
            # It has to be worth more than to go on.
            plan = np.tile(action, (len(best.actions), 1)) if old is None else old.actions
            going_on = self._followed(given, plan)
            return best if going_on is None or best.cost < going_on.cost else None
        return best

    def _attempts(self, given: tuple[Any, ...], warm: list[Solution], cold: list[Any]) -> list[Solution]:
        """Results of one solver after another until one finishes; IPOPT comes last."""
        found: list[Solution] = []
        plan = self._plan(given, warm, cold)
        for place, (name, guess, retried) in enumerate(plan):
            key = f"{name} {place}"
            if time.perf_counter() > self._deadline:
                self.statuses.append("the time limit is reached")
                break
            if not self._pauses.ready(key) and place + 1 < len(plan):
                continue
            first = guess()
            # What hangs leaves time to the others.
            share = 1.0 if place + 1 == len(plan) else 0.5
            one = None if first is None else self._run(name, given, first, share)
            if one is not None:
                found.append(replace(one, retried=retried))
            if one is not None and not one.unfinished:
                self._pauses.succeeded(key)
                break
            self._pauses.failed(key)
        return found

    def _plan(self, given: tuple[Any, ...], warm: list[Solution], cold: list[Any]) -> list[Attempt]:
        """Solvers, their first guesses, and whether they retry what another one did not solve.

        Raises:
            ValueError: there is no last plan, and the programme is not finite at any guess.
        """
        first = warm[0] if warm else self._cold(given, cold)
        if first is None:
            raise ValueError(
                f"{self._guessed().reason(self._guess(*cold[0]).x, given)}: give the states bounds that exclude this "
                "point, or write the equation so that it is finite there"
            )
        plan: list[Attempt] = [(name, lambda: first, False) for name in self._order(warm=bool(warm))]
        if "ipopt" in self._order(warm=False) or self._settings.budget is not None:
            return plan
        actions = first.actions if warm else np.tile(cold[0][1], (self._transcription.task.horizon, 1))
        plan.append(("ipopt", lambda: self._along(given, actions), True))
        plan.append(("ipopt", lambda: self._cold(given, cold[::-1]), True))
        return plan

    def _cold(self, given: tuple[Any, ...], cold: list[Any]) -> Solution | None:
        """The first of some guesses at or near which the programme is finite; None if missing."""
        p = self.parameters(given)
        for one in cold:
            guess = self._guess(*one)
            x = self._guessed().finite(guess.x, p)
            if x is not None:
                return replace(guess, x=x)
        return None

    def _along(self, given: tuple[Any, ...], actions: FloatArray) -> Solution | None:
        """The simulated plan, an initial guess that satisfies the equations, or None."""
        p, along = self.parameters(given), self._simulated().follow(given, actions)
        if not np.isfinite(along).all():
            return None
        self._simulated().complete(along, p)
        x = self._guessed().finite(along, p)
        if x is None:
            return None
        zeros = np.zeros(len(self._programme.g_lower))
        return Solution(self._programme, x, np.zeros(len(x)), zeros, np.zeros((0, 0)), np.zeros((0, 0)))

    def _followed(self, given: tuple[Any, ...], actions: FloatArray) -> Solution | None:
        """A plan and what it leads to; None if that is not known or breaks what must hold."""
        programme, t = self._programme, self._transcription
        x = self._simulated().follow(given, actions)
        cost, broken = self._simulated().complete(x, self.parameters(given))
        if broken > _FEASIBLE:
            return None
        states = x[programme.states] * t.e.state_scale
        zeros = np.zeros(len(programme.g_lower))
        return Solution(programme, x, np.zeros(len(x)), zeros, actions, states, cost, unfinished=True)

    def _order(self, *, warm: bool) -> list[str]:
        """Solvers that are tried; an active set is warm only after a solution."""
        name, convex = self._settings.name, self._transcription.task.convex
        wide = max(self._programme.structure["nu"]) > WIDE
        if name == "ipopt" or (name == "auto" and wide):
            # An economic optimum moves along its bounds, of which a warm start is too sure.
            return ["ipopt_warm", "ipopt"] if warm and convex else ["ipopt"]
        if name != "auto":
            return [name]
        small = len(self._programme.lower) <= _SMALL and convex
        return ["sqp", "fatrop"] if small and warm else ["fatrop"]

    def elastic(
        self, given: tuple[Any, ...], old: Solution | None, rest: tuple[FloatArray, FloatArray], action: FloatArray
    ) -> Solution | None:
        """The plan with the least violation of the hard bounds; None without these or time."""
        task = self._transcription.task
        if all(limit.soft for limit in task.limits) or not all(np.isfinite(part).all() for part in given):
            return None
        if self._elastic is None:
            soft = [replace(limit, weight=1e4) if not limit.soft else limit for limit in task.limits]
            settings = Settings("ipopt", 1e-6, None, self._settings.budget)
            self._elastic = Solver(Transcription(replace(task, limits=soft)), settings, 0)
        self._elastic.limit = max(self._deadline - time.perf_counter(), _LEAST)
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

    def _run(self, name: str, given: tuple[Any, ...], first: Solution, share: float = 1.0) -> Solution | None:
        """The result of a solver, within a share of the time that is left."""
        programme, t = self._programme, self._transcription
        p, now = self.parameters(given), time.perf_counter()
        try:
            found, stats = self._solver(name)(
                now + share * max(self._deadline - now, 0.0), x0=first.x, lam_x0=first.lam_x, lam_g0=first.lam_g, p=p,
                lbx=programme.lower, ubx=programme.upper, lbg=programme.g_lower, ubg=programme.g_upper,
            )  # fmt: skip
        except (RuntimeError, TimeoutError) as error:
            self.statuses.append(f"{name}: {str(error).splitlines()[-1] if str(error) else type(error).__name__}")
            return None
        status = stats.get("return_status")
        ended = status if isinstance(status, str) else f"failed with status {status}"
        self.statuses.append(f"{name}: {'solved' if stats['success'] else ended}")
        x = np.asarray(found["x"]).ravel()
        if not np.isfinite(x).all():
            return None
        f, g = float(found["f"]), np.asarray(found["g"]).ravel()
        actions = np.clip(x[programme.actions] * t.scale, t.task.low, t.task.high)
        if not stats["success"]:
            # A solver that stopped before its first iteration returns no constraints.
            f, g = self._guessed().value(x, p)
        if not (stats["success"] or self._usable(name, x, g)):
            limited = self._settings.budget is not None or self._settings.iterations is not None or name == "sqp"
            return None if limited else self._followed(given, actions)
        states = x[programme.states] * t.e.state_scale
        lam_x = self._active(np.asarray(found["lam_x"]).ravel(), x, programme.lower, programme.upper)
        lam_g = self._active(np.asarray(found["lam_g"]).ravel(), g, programme.g_lower, programme.g_upper)
        return Solution(programme, x, lam_x, lam_g, actions, states, f)

    def parameters(self, given: tuple[Any, ...]) -> FloatArray:
        """Scaled parameters of the programme."""
        state, before, constant, varying, at = given
        t = self._transcription
        return np.concatenate([state / t.e.state_scale, before / t.scale, constant, varying, [at]])

    @staticmethod
    def _active(multipliers: FloatArray, values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Multipliers, 0 away from bounds, for the start of an active-set method."""
        near = np.minimum(values - low, high - values) <= 1e-5
        return np.where(near, multipliers, 0.0)

    def _usable(self, name: str, x: FloatArray, g: FloatArray) -> bool:
        """Return whether a point at which a solver stopped early meets the equations."""
        programme = self._programme
        if self._settings.budget is None and self._settings.iterations is None:
            return False
        sides = (programme.g_lower - g, g - programme.g_upper, programme.lower - x, x - programme.upper)
        worst = max(float(np.nan_to_num(np.max(side, initial=0.0), nan=np.inf)) for side in sides)
        # One iteration of the real-time scheme leaves an error of second order.
        return bool(worst <= (1e-2 if name == "sqp" else _FEASIBLE))

    def _solver(self, name: str) -> Watched:
        if name not in self._made:
            self._made[name] = plugin(name, self._programme, self._settings)
        return self._made[name]
