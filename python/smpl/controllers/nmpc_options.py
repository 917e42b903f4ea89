"""Options of nonlinear model predictive control, in four groups."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from smpl.controllers.nmpc_objective import Cost
from smpl.support.options import Options

Bounds = Mapping[str, tuple[float | None, float | None]]


@dataclass(frozen=True, kw_only=True, repr=False)
class NMPCObjective(Options):
    """Objective of `NMPC` and its horizon.

    Attributes:
        horizon: number of control steps that are predicted.
        cost: name of a declared reward, which is maximised; None for the default reward. Or weights
            of squared distances from set-points, by names of states, outputs, observations and
            actions. Or a function of a mapping from names to CasADi expressions that returns the
            expression to minimise.
        set_point: set-points of weighted quantities by name, in declared units: numbers, or
            functions of the time, known over the horizon. The default is the value at the model's
            steady state.
        terminal: weights at the end of the horizon; None for those of `cost`.
        rate_weight: weights of squared changes of actions from one interval to the next, by name,
            per squared unit of the action (do-mpc scales actions first).
        integrate: the cost is the mean over each interval instead of the value at its end.
        shrinking: the horizon ends with the episode, as for a batch; rewards after its end do not
            count.
        tunable: weights are values that `adjust` changes and `derivatives` differentiates by.
    """

    horizon: int = 20
    cost: Cost = None
    set_point: Mapping[str, Any] | None = None
    terminal: Mapping[str, float] | None = None
    rate_weight: Mapping[str, float] | None = None
    integrate: bool = False
    shrinking: bool = False
    tunable: bool = False


@dataclass(frozen=True, kw_only=True, repr=False)
class NMPCConstraints(Options):
    """Bounds and limits of `NMPC`.

    Attributes:
        bounds: (low, high) by name in declared units, None for an open end; they replace declared
            bounds.
        path: bounds also hold at the collocation nodes inside each interval, unless the bounded
            quantity reads integrals or earlier values. A start out of bounds may return in time. If
            False, bounds hold at the ends of intervals only.
        hard: names of bounds that must hold; violations of all others cost `soft_weight`.
        declared: bounds of states, failures and constraints that the model declares count too
            (soft).
        margin: tightening of declared bounds, relative to their range (to the bound if the range is
            infinite).
        soft_weight: price of a violation relative to the size of its quantity; large compared with
            the scaled cost, which is of order 10.
        rate_limit: largest changes of actions in a step by name, in units of the action.
        hold: move blocking: actions change every `hold` intervals; or a list of lengths of moves,
            the last of which continues to the end of the horizon.
    """

    bounds: Bounds | None = None
    path: bool = True
    hard: Iterable[str] = ()
    declared: bool = True
    margin: float = 1e-4
    soft_weight: float = 1e3
    rate_limit: Mapping[str, float] | None = None
    hold: int | Iterable[int] = 1


@dataclass(frozen=True, kw_only=True, repr=False)
class NMPCPrediction(Options):
    """Predicted part of the plant, known inputs, estimation and collocation of `NMPC`.

    Attributes:
        part: states, components or arrays that are predicted; the others keep the plant's values.
        actions: names of the optimised actions; None for those that the predicted equations read.
        rest: controller that chooses the other actions; None holds them at the operating action.
        forecast: known values of parameters, disturbances and other actions by name: numbers,
            arrays with one value per step of the episode, or functions of the time.
        p: parameters of the predicting model by name; `"episode"` uses those of the plant's
            episode.
        estimator: `ExtendedKalmanFilter` or `MovingHorizonEstimator`, of which estimated parameters
            and disturbances count too; None for the state and the disturbances of the environment.
        offset_free: estimate a constant disturbance of each rate from prediction errors, so that
            outputs reach their set-points in spite of wrong parameters and unmeasured disturbances.
            With an estimator, let it estimate a disturbance or a parameter instead.
        filter: share of each new prediction error in that estimate, 0 to 1.
        nodes: `radau` (Radau's nodes) or `gauss` (Gauss' nodes and the end of the element).
        degree: number of collocation nodes of an element.
        elements: number of elements of an interval.
        smooth: width of smoothed switches, as for `smpl.export.casadi`.
    """

    part: Iterable[str] | None = None
    actions: Iterable[str] | None = None
    rest: Any = None
    forecast: Mapping[str, Any] | None = None
    p: Mapping[str, float] | str | None = None
    estimator: Any = None
    offset_free: bool = False
    filter: float = 1.0
    nodes: str = "radau"
    degree: int = 3
    elements: int = 1
    smooth: float = 0.0


@dataclass(frozen=True, kw_only=True, repr=False)
class NMPCSolver(Options):
    """Numerical solution of `NMPC`.

    Attributes:
        solver: `fatrop`, `ipopt`, `sqp` (real-time iterations with `iterations=1`) or `auto`: `sqp`
            from a warm start if the problem is small and the cost a sum of squares, else `fatrop`.
            IPOPT is tried if another one fails.
        iterations: limit of the solver's iterations; None for the solver's own.
        budget: seconds for a decision, with IPOPT. At the end the present point is used if it
            satisfies the equations; otherwise the last plan continues. None for no budget.
        time_limit: seconds after which all solvers of a decision stop; a fallback is counted.
        starts: number of further initial guesses if there is no last plan, chosen from sixty
            simulated ones; the best result counts. None for 3, or 0 with a budget or if the cost is
            a sum of squares.
        tolerance: convergence tolerance of the solver.
        keep_warm_start: keep the last plan for the next episode.
    """

    solver: str = "auto"
    iterations: int | None = None
    budget: float | None = None
    time_limit: float = 60.0
    starts: int | None = None
    tolerance: float = 1e-8
    keep_warm_start: bool = False


@dataclass(frozen=True, kw_only=True, repr=False)
class NMPCOptions(NMPCSolver, NMPCPrediction, NMPCConstraints, NMPCObjective):
    """All options of `NMPC`: objective, constraints, prediction and solver.

    Example:
        >>> NMPCOptions(horizon=30, solver="sqp")
        NMPCOptions(horizon=30, solver='sqp')
    """
