"""Nonlinear and economic model predictive control by direct collocation (extra `mpc`).

The equations are those of the model itself, exported as CasADi functions. J. B. Rawlings, D. Q.
Mayne, M. Diehl, Model Predictive Control (2017); offset-free tracking by a disturbance estimate: G.
Pannocchia, J. B. Rawlings, AIChE Journal 49 (2003) 426-437.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from smpl.controllers.base import TakesWrapped
from smpl.controllers.collocation import NODES, Limit, Task, Transcription
from smpl.controllers.names import operating_action
from smpl.controllers.nmpc_given import Given
from smpl.controllers.nmpc_model import Expressions
from smpl.controllers.nmpc_objective import Objective, by_action, row_sizes
from smpl.controllers.nmpc_options import NMPCOptions
from smpl.controllers.nmpc_plugins import Settings
from smpl.controllers.nmpc_sensitivity import ActionDerivatives, Sensitivity
from smpl.controllers.nmpc_solver import SOLVERS, Solution, Solver
from smpl.controllers.nmpc_starts import Finer
from smpl.envs import Env
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_count, as_mapping, as_number
from smpl.support.clock import as_seconds
from smpl.support.hints import refuse_attribute
from smpl.support.names import listing
from smpl.support.options import takes

# Further first guesses for an economic cost.
_STARTS = 3
# A prediction is right if no state is further off, over the range that it passes through.
_RIGHT = 0.05


class NMPC(TakesWrapped):
    """Nonlinear model predictive control: applies the first of the best actions over a horizon.

    Args:
        env_or_model: the predicting model, or an environment of it. The plant may be another one
            with its states and actions: another scenario, variant, or other parameters.
        options: `NMPCOptions` or groups of them (`NMPCObjective`, `NMPCConstraints`,
            `NMPCPrediction`, `NMPCSolver`), and options as keyword arguments; `horizon` and `cost`
            may follow the model by position.

    Attributes:
        decisions: number of decisions.
        fallbacks: decisions without a solution, which continue the last plan, or use the one that
            violates the bounds least.
        retries: decisions that IPOPT solved after the solver had failed.
        unfinished: decisions without convergence, which use the best plan found if it is better
            than the last one and keeps hard bounds; kinks of the model cause them.
        times: seconds of each decision.
        plan, predicted: the actions (H, actions chosen) and states (H + 1, states) of the last
            solution.
        last_status: results of the solvers that the last decision called, in their order: `fatrop:
            solved`.
        conflicts: bounds that could not be held in the last decision.
        disturbance: estimated change of each state in a step.
        error: prediction error of the episode's first plan: the largest difference of a state from
            a prediction with four times as many elements, over the range of the state.

    Raises:
        ImportError: CasADi is missing.
        ValueError: names, shapes or bounds that do not fit; the message names them and lists the
            valid ones.
        TypeError: an unknown option, or one that is given twice.

    Example:
        controller = NMPC(env, 20, {"c_A": 100}, rate_weight={"T_c": 1e-4})
        controller = NMPC(env, NMPCObjective(cost={"c_A": 100}), NMPCSolver(solver="ipopt"))
    """

    def __getattr__(self, name: str) -> Any:
        """Answer do-mpc's names by the right ones."""
        refuse_attribute(self, name)

    @takes(NMPCOptions, "horizon", "cost")
    def __init__(self, env_or_model: Env | Model, options: NMPCOptions) -> None:
        self.model = env_or_model.model if isinstance(env_or_model, Env) else env_or_model
        if not isinstance(self.model, Model):
            raise TypeError(f"env_or_model is {type(env_or_model).__name__}, expected an smpl.Env or an smpl.Model")
        self.horizon = as_count("horizon", options.horizon)
        _one_of("solver", options.solver, SOLVERS)
        _one_of("nodes", options.nodes, NODES)
        self._expressions = Expressions(self.model, options.part, options.smooth)
        self.action_names = self._choose_actions(options.actions)
        objective = Objective(
            self._expressions, self.action_names, options.cost, options.terminal, options.rate_weight,
            options.integrate, bool(options.tunable),
        )  # fmt: skip
        self._given = Given(
            self._expressions, self.horizon, options.p, options.forecast, options.set_point, objective.targets,
            objective.weights,
        )  # fmt: skip
        self._sensitivity: Sensitivity | None = None
        self._solved: tuple[Solution, FloatArray] | None = None
        self._offset_free, self._filter = bool(options.offset_free), as_number("filter", options.filter)
        task = self._task(objective, self._limits(options), options)
        settings, starts = _settings(options, objective.convex)
        self._solver = Solver(Transcription(task), settings, starts, as_seconds("time_limit", options.time_limit))
        self._finer: Finer | None = None
        # A result that was stopped early does not solve the equations yet.
        self._comparing = options.budget is None and options.iterations is None
        self._rest, self._estimator, self._keep = options.rest, options.estimator, bool(options.keep_warm_start)
        self.sees = getattr(self._estimator, "sees", "state")
        self.decisions = self.fallbacks = self.retries = self.unfinished = 0
        self.times: list[float] = []
        self.conflicts: list[str] = []
        self.last_status = ""
        self.error = 0.0
        self.disturbance = np.zeros(len(self._expressions.state_names))
        self.plan, self.predicted = np.zeros((0, len(self.action_names))), np.zeros((0, 0))
        self._ahead: Solution | None = None
        self._before: tuple[int, FloatArray, FloatArray] | None = None

    def reset(self, env: Env) -> None:
        """Forget the last episode.

        Raises:
            ValueError: the environment has not the states, actions or step of the model that
                predicts.
        """
        self._check(env)
        self._given.begin(env, self._estimator)
        self._solver.prepare()
        self._places = [env.action_names.index(name) for name in self.action_names]
        self._low, self._high = env.action_low, env.action_high
        self.disturbance[:] = 0.0
        self.conflicts, self._before, self._told = [], None, False
        if self._rest is not None:
            self._rest.reset(env)
        if self._estimator is not None:
            self._estimator.reset(env)
        self._operating = self._resting_action(env)
        if not self._keep:
            self._ahead = None

    def action(self, env: Env) -> FloatArray:
        """The first actions of the best plan, and those of `rest`, within the box."""
        begin = time.perf_counter()
        others = self._operating if self._rest is None else np.asarray(self._rest.action(env), dtype=np.float64)
        state = self._state(env)
        previous = others[self._places] if env.steps == 0 else env.action[self._places]
        self._given.update(env, others, self._estimator)
        if self._offset_free:
            self._learn(env, state, previous)
        fixed, varying = self._given.vectors(env, self.disturbance)
        solution = self._decide(state, previous, fixed, varying, env)
        action = others.copy()
        action[self._places] = self.plan[0]
        action = np.clip(action, self._low, self._high)
        self._ahead = solution
        self._before = (env.steps, state, self._given.first)
        self.decisions += 1
        self.times.append(time.perf_counter() - begin)
        return action

    @property
    def predicted_names(self) -> tuple[str, ...]:
        """Names of the predicted states."""
        return tuple(self._expressions.state_names)

    def adjust(self, values: Mapping[str, float]) -> None:
        """Change weights of a tunable cost, set-points and parameters, from the next reset on.

        Args:
            values: by the names of `ActionDerivatives.by`: `cost:T`, `terminal:T`, `rate:T_c`,
                `target:T`, or a parameter. With `p="episode"` parameters are those of the plant.

        Raises:
            ValueError: an unknown name, a number that is not finite, or a negative weight.
        """
        self._given.adjust(values)

    def derivatives(self) -> ActionDerivatives:
        """Derivatives of the last decision's actions, with the active bounds of its plan.

        They do not exist where a bound becomes active or inactive. Actions of `rest` are left out.

        Raises:
            ValueError: the last decision has no solution that has converged, or the active bounds
                do not determine it.

        Example:
            controller = NMPC(env, 20, {"T": 1.0, "T_c": 0.1}, tunable=True)
            controller.derivatives().by["cost:T"]    # after action(env)
        """
        if self._solved is None:
            raise ValueError("the last decision has no solution that has converged: there are no derivatives")
        solution, p = self._solved
        if self._sensitivity is None:
            self._sensitivity = Sensitivity(solution.programme)
        return self._sensitivity.derivatives(solution, p)

    def report(self) -> str:
        """Decisions so far, their times and what failed, in a line."""
        if not self.times:
            return "no decisions yet"
        ms = 1e3 * np.array(self.times)
        return (
            f"{self.decisions} decisions, median {np.median(ms):.3g} ms, 99th percentile {np.percentile(ms, 99):.3g}"
            f" ms, longest {ms.max():.3g} ms; {self.fallbacks} fallbacks, {self.retries} retries,"
            f" {self.unfinished} unfinished"
        )

    # Construction.

    def _choose_actions(self, given: Iterable[str] | None) -> tuple[str, ...]:
        names = self.model.action_names
        if given is None:
            chosen = self._expressions.actions_read()
            if not chosen:
                raise ValueError(f"no action of {self.model.name} acts on the predicted states")
            return chosen
        wanted = (given,) if isinstance(given, str) else tuple(given)
        wrong = [name for name in wanted if name not in names]
        if wrong or not wanted:
            what = ", ".join(map(repr, wrong)) or "none"
            raise ValueError(f"actions: unknown {what}; there are: {listing(names, self.model.action_units)}")
        return tuple(name for name in names if name in wanted)

    def _limits(self, options: NMPCOptions) -> list[Limit]:
        e, own, hard = self._expressions, dict(as_mapping("bounds", options.bounds)), tuple(options.hard)
        margin, weight = options.margin, as_number("soft_weight", options.soft_weight)
        found = []
        for name, expression, low, high in e.limits() if options.declared else []:
            if name in own:
                continue
            # A lone root function or violation is 0 at its bound.
            width = high - low if np.isfinite(high - low) else max(abs(low) if np.isfinite(low) else abs(high), 0.0)
            size = width if np.isfinite(high - low) and width > 0 else 1.0
            price = np.inf if name in hard else weight
            found.append(Limit(name, expression, low + margin * width, high - margin * width, size, price))
        for name, pair in own.items():
            low, high = _pair(name, pair)
            size = high - low if np.isfinite(high - low) and high > low else e.scale(name)
            found.append(Limit(name, e[name], low, high, size, np.inf if name in hard else weight))
        unknown = [name for name in hard if name not in {limit.name for limit in found}]
        if unknown:
            known = ", ".join(limit.name for limit in found) or "none"
            raise ValueError(f"hard: no bound of {', '.join(map(repr, unknown))}; there are bounds of: {known}")
        return found

    def _task(self, objective: Objective, limits: list[Limit], options: NMPCOptions) -> Task:
        e = self._expressions
        import casadi as ca

        free = _moves(options.hold, self.horizon)
        rates = by_action("rate_limit", options.rate_limit, self.model, self.action_names, np.inf)
        everything = ca.vertcat(e.equations, objective.stage, objective.last, *(one.expression for one in limits))
        if e.integral.numel():
            everything = ca.vertcat(everything, e.call(e.export.integrals))
        offsets = [f"offset:{name}" for name in e.state_names] if self._offset_free else []
        keys = (*e.given(everything, self.action_names), *offsets, *(["within:episode"] if options.shrinking else []))
        self._given.prepare(keys)
        reads_before = any(symbol.name().startswith("before:") for symbol in ca.symvar(everything))
        at = [self.model.action_names.index(name) for name in self.action_names]
        low, high = self.model.native.bounds("action")
        return Task(
            e, self.horizon, self.action_names, objective.stage, objective.last, bool(options.integrate), limits, keys,
            self._given.varying, free, rates, low[at], high[at],
            offset=self._offset_free,
            remembers=reads_before or not all(free) or bool(np.isfinite(rates).any()) or bool(options.rate_weight),
            factor=objective.factor(self._given), convex=objective.convex, rows=row_sizes(e, self._given),
            kind=options.nodes, degree=as_count("degree", options.degree),
            elements=as_count("elements", options.elements), path=bool(options.path),
        )  # fmt: skip

    # Decisions.

    def _check(self, env: Env) -> None:
        missing = [name for name in self._expressions.state_names if name not in env.state_names]
        if missing and self._estimator is None:
            raise ValueError(
                f"this predictive controller needs the states {', '.join(missing)} of {self.model.name}, which "
                f"{env.model.name} does not have: give part=[...] or an estimator"
            )
        lacking = [name for name in self.action_names if name not in env.action_names]
        if lacking:
            raise ValueError(
                f"this predictive controller is for the actions {', '.join(self.action_names)}; {env.model.name} has "
                f"{', '.join(env.action_names)}"
            )
        if not np.isclose(env.model.step, self.model.step, rtol=1e-9):
            raise ValueError(
                f"the model that predicts has steps of {self.model.step} {self.model.time_unit}, the environment of "
                f"{env.model.step} {env.model.time_unit}"
            )
        if self._estimator is not None:
            known = self._estimator.model.state_names
            absent = [name for name in self._expressions.state_names if name not in known]
            if absent:
                raise ValueError(f"the estimator estimates {', '.join(known[:8])}, not {', '.join(absent)}")

    def _resting_action(self, env: Env) -> FloatArray:
        return np.clip(operating_action(env), env.action_low, env.action_high)

    def _state(self, env: Env) -> FloatArray:
        if self._estimator is None:
            names, values = env.state_names, env.state
        else:
            names, values = self._estimator.model.state_names, self._estimator.update(env)
        by_name = dict(zip(names, values.tolist(), strict=True))
        return np.array([by_name[name] for name in self._expressions.state_names])

    def _learn(self, env: Env, state: FloatArray, applied: FloatArray) -> None:
        """Take what the last step did other than predicted as a disturbance that stays."""
        if self._before is None or self._before[0] != env.steps - 1:
            return
        _, start, given = self._before
        expected = self._solver.step(start, applied, given, env.time - self.model.step)
        error = state - expected
        if np.isfinite(error).all():
            self.disturbance += self._filter * error

    def _decide(
        self, state: FloatArray, previous: FloatArray, fixed: FloatArray, varying: FloatArray, env: Env
    ) -> Solution | None:
        """Solve, or fall back; sets plan, predicted and conflicts."""
        given = (state, previous, fixed, varying, env.time)
        rest = self._operating[self._places]
        old = None if self._ahead is None else self._ahead.shifted()
        solution = self._solver.solve(given, old, self._given.guess, rest)
        self.last_status = "; ".join(self._solver.statuses)
        if solution is not None and old is None and self._comparing:
            self._compare(given, solution)
        converged = solution is not None and not solution.unfinished
        self._solved = (solution, self._solver.parameters(given)) if solution is not None and converged else None
        self.conflicts = []
        self.retries += solution is not None and solution.retried
        self.unfinished += solution is not None and solution.unfinished
        if solution is None:
            self.fallbacks += 1
            solution = self._fall_back(given, old, rest)
        if solution is not None:
            self.plan, self.predicted = solution.actions, solution.states
        return solution

    def _mistake(self, given: tuple[Any, ...], solution: Solution) -> tuple[float, str]:
        """The error of a prediction and its state, where the finer equations are solved."""
        if self._finer is None:
            self._finer = Finer(Transcription(solution.programme.task))
        right = self._finer.states(given, solution.actions)
        known = np.isfinite(right).all(axis=1)
        off = np.abs(solution.states - right)[known].max(axis=0)
        both = np.concatenate([solution.states, right[known]])
        range_of = np.maximum(np.ptp(both, axis=0), 1e-3 * self._expressions.state_scale)
        worst = int(np.argmax(off / range_of))
        return float((off / range_of)[worst]), self._expressions.state_names[worst]

    def _compare(self, given: tuple[Any, ...], solution: Solution) -> None:
        """Tell of a prediction that more elements contradict."""
        self.error, state = self._mistake(given, solution)
        if self.error > _RIGHT:
            message = (
                f"the first plan is predicted with an error of {self.error:.2g} of the range of {state}: give more "
                "nodes by elements= or degree="
            )
            warnings.warn(message, RuntimeWarning, stacklevel=5)

    def _fall_back(self, given: tuple[Any, ...], old: Solution | None, rest: FloatArray) -> Solution | None:
        elastic = self._solver.elastic(given, old, self._given.guess, rest)
        if elastic is not None:
            self.conflicts = elastic.broken()
            if self.conflicts and not self._told:
                self._told = True
                message = f"no plan holds all bounds from here: {'; '.join(self.conflicts)}"
                warnings.warn(message, RuntimeWarning, stacklevel=4)
            return elastic
        if old is None:
            self.plan = np.tile(rest, (self.horizon, 1))
        else:
            self.plan, self.predicted = old.actions, old.states
        return old


def _settings(options: NMPCOptions, convex: bool) -> tuple[Settings, int]:
    """Settings of the solver, and the number of further initial guesses."""
    solver, starts = options.solver, options.starts
    budget = None if options.budget is None else as_seconds("budget", options.budget)
    if budget is not None and solver not in ("auto", "ipopt"):
        raise ValueError(f"budget is kept by IPOPT alone: give solver='ipopt', or iterations= to limit {solver}")
    if budget is not None and starts:
        raise ValueError("a budget has no time for further starts: give one of budget= and starts=")
    if starts is None:
        starts = 0 if convex or budget is not None else _STARTS
    iterations = None if options.iterations is None else as_count("iterations", options.iterations)
    settings = Settings(
        "ipopt" if budget is not None else solver, as_number("tolerance", options.tolerance), iterations, budget
    )
    return settings, as_count("starts", starts, 0, "a number of first guesses, 0 or more")


def _pair(name: str, given: Any) -> tuple[float, float]:
    try:
        low, high = given
    except (TypeError, ValueError):
        raise ValueError(f"bounds[{name!r}] is {given!r}, expected (low, high), with None for an open end") from None
    found = (
        -np.inf if low is None else as_number(f"bounds[{name!r}]", low),
        np.inf if high is None else as_number(f"bounds[{name!r}]", high),
    )
    if not found[0] <= found[1]:
        raise ValueError(f"bounds[{name!r}]: the lower bound {found[0]} is above the upper bound {found[1]}")
    return found


def _moves(hold: Any, horizon: int) -> list[bool]:
    """Intervals in which actions are chosen anew."""
    if isinstance(hold, (int, np.integer)):
        every = as_count("hold", hold)
        return [k % every == 0 for k in range(horizon)]
    starts = np.cumsum([0, *(as_count("hold", length) for length in hold)])
    # The last move goes on to the end of the horizon.
    kept = set(starts[:-1].tolist())
    if not kept:
        raise ValueError("hold is empty, expected the length of at least one move")
    return [k in kept for k in range(horizon)]


def _one_of(argument: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        raise ValueError(f"{argument} is {value!r}; there are: {', '.join(known)}")
