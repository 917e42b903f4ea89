"""Predictive control by sampling: the model simulates many sequences of actions.

Model predictive path integral: G. Williams, A. Aldrich, E. A. Theodorou, Journal of Guidance,
Control, and Dynamics 40 (2017) 344-357; cross-entropy: R. Y. Rubinstein, D. P. Kroese, The
Cross-Entropy Method (2004). No derivative is needed, so that phases, events, recipes and integer
actions are possible.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from smpl.analysis.rollout import Rollout, rollout
from smpl.controllers.base import TakesWrapped
from smpl.controllers.names import operating_action
from smpl.envs import Env
from smpl.model import Model
from smpl.support.arguments import FloatArray, as_count, as_number, as_numbers, check_names, refuse_past
from smpl.support.names import listing
from smpl.support.options import Options, takes

METHODS = ("mppi", "cem")
Cost = Callable[[Rollout, FloatArray], Any]
Guess = Callable[[Env, int], Any]


@dataclass(frozen=True, kw_only=True, repr=False)
class SamplingOptions(Options):
    """Options of `SamplingMPC`.

    Attributes:
        horizon: number of control steps that are predicted.
        samples: sequences of actions in each iteration, at least 4.
        iterations: improvements of the distribution in a decision.
        method: `mppi` (weights by the exponential of the cost) or `cem` (mean and deviation of the
            best samples).
        cost: name of a reward of the model, which is maximised; None for the chosen one. Or a
            function of the `Rollout` and the actions (N, H, actions) that returns costs to
            minimise, (N,) or (N, H).
        discount: factor of the cost of each further step.
        temperature: of `mppi`, relative to the distance from the best cost of a decision to the
            median.
        elites: share of the samples that `cem` keeps.
        deviation: standard deviations by names of actions, in their units; None for a quarter of
            the box.
        hold: number of steps for which a sampled change of the plan is held (move blocking).
        every: number of steps between two decisions; in between the last plan continues.
        integer: names of actions with integer values.
        guess: function (env, horizon) that returns actions (H, actions) or (K, H, actions), which
            are tried in addition to the samples; the first one is the initial plan. None for the
            operating action.
        p: parameters of the predicting model by name.
        outputs: the rollout has algebraic outputs, for the cost.
        estimator: `ExtendedKalmanFilter` or `MovingHorizonEstimator`; None for the state of the
            environment.
        seed: distinguishes controllers in the same episode; random numbers depend on it and on the
            episode.
        failure_cost: added for each step that a failed sequence falls short of the horizon; None
            for a value above the costs of all sequences without failure.
    """

    horizon: int = 20
    samples: int = 256
    iterations: int = 3
    method: str = "mppi"
    cost: str | Cost | None = None
    discount: float = 1.0
    temperature: float = 0.1
    elites: float = 0.1
    deviation: Mapping[str, float] | None = None
    hold: int = 1
    every: int = 1
    integer: Iterable[str] = ()
    guess: Guess | None = None
    p: Mapping[str, float] | None = None
    outputs: bool = False
    estimator: Any = None
    seed: int = 0
    failure_cost: float | None = None


class SamplingMPC(TakesWrapped):
    """Sampling-based model predictive control of any model.

    Args:
        model: the predicting model, or an environment of it; None for the model of the plant, from
            the present snapshot of the environment (with discrete variables, phases and delayed
            readings). Another model, or other parameters, begin at the state of the environment, or
            at the estimate.
        options: `SamplingOptions`, and options as keyword arguments; `horizon` may follow the model
            by position.

    Attributes:
        fallbacks: decisions in which every sequence failed: the one that lasts longest is taken.
        decisions: how many decisions there were.
        plan: the sequence of which the last action was the first, (H, actions).
    """

    @takes(SamplingOptions, "horizon")
    def __init__(self, model: Model | Env | None = None, *, options: SamplingOptions) -> None:
        if options.method not in METHODS:
            raise ValueError(f"method is {options.method!r}; there are: {', '.join(METHODS)}")
        self.model = model.model if isinstance(model, Env) else model
        self.method = options.method
        self.horizon, self.hold = as_count("horizon", options.horizon), as_count("hold", options.hold)
        self._samples = as_count("samples", options.samples, 4, "at least 4")
        self._iterations = as_count("iterations", options.iterations)
        self._every = as_count("every", options.every)
        self._cost, self._discount = options.cost, as_number("discount", options.discount)
        self._temperature = as_number("temperature", options.temperature)
        self._elites = as_number("elites", options.elites)
        if not (self._temperature > 0 and 0 < self._elites <= 1):
            raise ValueError(
                f"temperature is {options.temperature}, elites {options.elites}: expected above 0, and a share of 1"
            )
        self._deviation, self._integer = dict(options.deviation or {}), tuple(options.integer)
        self._guess, self._p, self._outputs = options.guess, dict(options.p or {}), bool(options.outputs)
        self._estimator = options.estimator
        self._seed = as_count("seed", options.seed, 0, "an integer that is not negative")
        self._failure_cost = options.failure_cost
        self.sees = getattr(self._estimator, "sees", "environment")
        self.fallbacks = self.decisions = 0
        self.plan = np.zeros((0, 0))

    def reset(self, env: Env) -> None:
        """Forget the last plan.

        Raises:
            ValueError: names or rewards that the model does not have.
        """
        check_names("deviation", self._deviation, env.action_names)
        check_names("integer", self._integer, env.action_names)
        predicting = self._predicting(env)
        if predicting.action_names != env.action_names:
            raise ValueError(
                f"the model that predicts has the actions {', '.join(predicting.action_names)}, the environment "
                f"{', '.join(env.action_names)}"
            )
        missing = [name for name in predicting.state_names if name not in env.state_names]
        if missing and self._estimator is None:
            raise ValueError(
                f"{predicting.name} has the states {', '.join(missing[:8])}, which {env.model.name} does not: give an "
                "estimator of that model"
            )
        width = (env.action_high - env.action_low) / 4
        self._width = np.array([self._deviation.get(name, width[i]) for i, name in enumerate(env.action_names)])
        self._whole = np.array([name in self._integer for name in env.action_names])
        self._generator = np.random.default_rng([self._seed, *env.episode])
        self._low, self._high = env.action_low, env.action_high
        if self._estimator is not None:
            self._estimator.reset(env)
        self.plan, self._used = np.zeros((0, len(env.action_names))), 0

    def action(self, env: Env) -> FloatArray:
        """The first action of the best plan that was found."""
        state = None if self._estimator is None else self._estimator.update(env)
        self._used += 1
        if self._used < min(self._every, len(self.plan)):
            return self.plan[self._used].copy()
        self._decide(env, state)
        self._used = 0
        return self.plan[0].copy()

    def _decide(self, env: Env, state: FloatArray | None) -> None:
        horizon = max(1, min(self.horizon, env.max_steps - env.steps))
        given = self._candidates(env, horizon)
        mean = self._shifted(env, horizon, given)
        deviation = np.tile(self._width, (-(-horizon // self.hold), 1))
        best, lowest, failed = mean, np.inf, True
        for _ in range(self._iterations):
            plans = self._draw(mean, deviation, best, horizon, given)
            costs, failures = self._evaluate(env, state, plans)
            place = int(np.argmin(costs))
            if costs[place] < lowest:
                best, lowest, failed = plans[place], costs[place], bool(failures[place])
            mean, deviation = self._improved(plans, costs, deviation)
        self.decisions += 1
        self.fallbacks += failed
        # The mean of the weighted plans is smoother than the best of them, but may be worse.
        final = self._rounded(mean)[None]
        costs, failures = self._evaluate(env, state, final)
        self.plan = final[0] if costs[0] <= lowest and not failures[0] else best

    def _predicting(self, env: Env) -> Model:
        model = self.model or env.model
        if isinstance(self._cost, str):
            if self._cost not in model.reward_names:
                known = listing(model.reward_names, model.reward_units)
                raise ValueError(f"cost is {self._cost!r}, no reward of {model.name}; there are: {known}")
            if self._cost != model.reward:
                model = model.variant_of(reward=self._cost)
        return model

    def _candidates(self, env: Env, horizon: int) -> FloatArray:
        """Sequences that are tried whatever is drawn, (K, H, actions)."""
        if self._guess is None:
            return np.broadcast_to(operating_action(env), (1, horizon, len(self._low)))
        shape = f"({horizon}, {len(self._low)}) or (K, {horizon}, {len(self._low)})"
        given = as_numbers("guess", self._guess(env, horizon), shape)
        if given.shape[-2:] != (horizon, len(self._low)) or given.ndim not in (2, 3):
            raise ValueError(f"guess has shape {given.shape}, expected {shape}")
        return np.clip(given if given.ndim == 3 else given[None], self._low, self._high)

    def _shifted(self, env: Env, horizon: int, given: FloatArray) -> FloatArray:
        """The rest of the last plan; the guess without a plan, and at its end."""
        start = given[0].copy()
        kept = self.plan[self._used : self._used + horizon]
        start[: len(kept)] = kept
        return start

    def _rounded(self, plans: FloatArray) -> FloatArray:
        plans = np.clip(plans, self._low, self._high)
        return np.where(self._whole, np.clip(np.rint(plans), np.ceil(self._low), np.floor(self._high)), plans)

    def _draw(
        self, mean: FloatArray, deviation: FloatArray, best: FloatArray, horizon: int, given: FloatArray
    ) -> FloatArray:
        noise = deviation * self._generator.standard_normal((self._samples, *deviation.shape))
        changes = np.repeat(noise, self.hold, axis=1)[:, :horizon]
        return self._rounded(np.concatenate([mean[None], best[None], mean + changes, given]))

    def _evaluate(self, env: Env, state: FloatArray | None, plans: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Costs (N,) of sequences, and which of them fail."""
        predicting = self._predicting(env)
        if predicting is env.model and state is None and not self._p:
            found = env.rollout(plans, outputs=self._outputs)
        else:
            found = self._from_state(env, predicting, state, plans)
        failures = np.array([bool(failure) for failure in found.failure])
        costs = self._costs(found, plans)
        short = plans.shape[1] - found.steps
        fine = costs[~failures]
        if self._failure_cost is not None:
            costs = costs + failures * self._failure_cost * (1 + short)
        elif failures.any():
            # Above all that do not fail; among those that do, the longest is the best.
            top = fine.max(initial=0.0)
            costs = np.where(failures, top + max(1.0, float(np.ptp(fine)) if len(fine) else 1.0) * (1 + short), costs)
        return np.where(np.isfinite(costs), costs, np.inf), failures

    def _from_state(self, env: Env, model: Model, state: FloatArray | None, plans: FloatArray) -> Rollout:
        refuse_past(model, "SamplingMPC with another model, state or parameters")
        if state is None:
            by_name = dict(zip(env.state_names, env.state.tolist(), strict=True))
            state = np.array([by_name[name] for name in model.state_names])
        known = dict(zip(env.discrete_names, env.discrete.tolist(), strict=True))
        discrete = {name: value for name, value in known.items() if name in model.discrete_names}
        parameters, disturbances = self._estimated(env, known, model, plans.shape[1])
        return rollout(
            model,
            state,
            plans,
            parameters=parameters,
            discrete=discrete,
            disturbances=disturbances,
            first_step=env.steps,
            outputs=self._outputs,
            max_steps=env.max_steps,
        )

    def _estimated(
        self, env: Env, discrete: dict[str, float], model: Model, horizon: int
    ) -> tuple[dict[str, float], dict[str, FloatArray]]:
        """Parameters, and disturbances (horizon,), of the estimator and of `p`."""
        estimated: dict[str, float] = getattr(self._estimator, "estimate", {})
        parameters = {name: value for name, value in estimated.items() if name in model.parameter_names}
        moving = [name for name in estimated if name in model.disturbance_names]
        found: dict[str, FloatArray] = {}
        if moving and self._estimator is not None and hasattr(self._estimator, "prediction"):
            found = self._estimator.prediction.ahead(estimated, env.action, env.steps, discrete, horizon)
        return {**parameters, **self._p}, {name: found[name] for name in moving if name in found}

    def _costs(self, found: Rollout, plans: FloatArray) -> FloatArray:
        costs = self._cost(found, plans) if callable(self._cost) else -found.rewards
        count, horizon = plans.shape[:2]
        values = as_numbers("cost", costs, f"({count},) or ({count}, {horizon})")
        if values.shape == (count, horizon):
            return values @ self._discount ** np.arange(horizon)
        if values.shape != (count,):
            raise ValueError(f"cost has shape {values.shape}, expected ({count},) or ({count}, {horizon})")
        return values

    def _improved(self, plans: FloatArray, costs: FloatArray, deviation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and deviation of the next samples."""
        order = np.argsort(costs)
        if self.method == "cem":
            kept = plans[order[: max(2, int(self._elites * len(costs)))]]
            # A deviation never vanishes, so that the next iteration still looks around.
            return kept.mean(axis=0), np.maximum(kept.std(axis=0)[:: self.hold], 0.05 * self._width)
        finite = costs[np.isfinite(costs)]
        if not len(finite):
            return plans[0], deviation
        size = float(np.median(finite) - finite.min()) or 1.0
        weight = np.exp(-np.where(np.isfinite(costs), (costs - finite.min()) / (self._temperature * size), np.inf))
        mean = np.tensordot(weight / weight.sum(), plans, axes=1)
        return mean, 0.7 * deviation
