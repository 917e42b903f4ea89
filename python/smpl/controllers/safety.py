"""A filter that changes the actions of a policy only as declared limits require.

Predictive safety filter: K. P. Wabersich, M. N. Zeilinger, Automatica 129 (2021) 109597; plans are
sampled and simulated by the model itself, so that events, phases and integer actions are not an
obstacle.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.analysis.rollout import Rollout
from smpl.controllers.base import TakesWrapped
from smpl.controllers.names import operating_action
from smpl.envs import Env
from smpl.policies import Rows, as_policy
from smpl.support.arguments import FloatArray, as_count, as_finite_number, as_vector

# Points on the way from a proposed action to one that is safe, and how often that way is refined.
_POINTS, _ROUNDS = 9, 4


class SafetyFilter(TakesWrapped):
    """The nearest action to that of a policy after which a safe plan over the horizon is known.

    An action is safe if a plan that begins with it meets no failure and violates no constraint of
    the model in the prediction. Plans go on with the action itself, with the backup action, or as
    the last safe plan. The prediction starts at the running environment (discrete variables and
    phases included); random numbers are at their means.

    Args:
        policy: a controller, a policy or a function, see `smpl.policies.as_policy`.
        env: the environment that it is for; None for that of the reset.
        horizon: steps of a plan.
        backup: action that should keep the plant safe, physical units; if None the operating
            action.
        samples: actions tried in addition to those between the proposed and the backup action.
        margin: violation of a constraint that is accepted, a share of its range.
        threads: of the prediction; all processors if None.

    Attributes:
        decisions, interventions: number of actions, and of those that were changed.
        unresolved: decisions without a known safe plan; the plan that lasts longest, then the one
            with the smallest violation, counts.
        change: sum of the changes; a change is the largest of its shares of the ranges of the
            actions.
        plan: the plan of the last action, (horizon, actions).

    Raises:
        ValueError: an argument of a wrong shape or range.

    Example:
        controller = SafetyFilter(policy, env, horizon=20)
        episode = smpl.evaluation.run_episode(env, controller, seed=0)
        controller.statistics()
    """

    def __init__(
        self,
        policy: Any,
        env: Env | None = None,
        *,
        horizon: int = 10,
        backup: npt.ArrayLike | None = None,
        samples: int = 64,
        margin: float = 0.0,
        threads: int | None = None,
    ) -> None:
        self._policy, self._chooser = as_policy(policy), policy
        self._horizon, self._samples = as_count("horizon", horizon), as_count("samples", samples, 0)
        self._margin, self._threads = as_finite_number("margin", margin), threads
        if self._margin < 0:
            raise ValueError(f"margin is {margin}, expected a share that is not negative")
        self._given = backup
        self.decisions = self.interventions = self.unresolved = 0
        self.change = 0.0
        self.plan: FloatArray | None = None
        self._memory: dict[str, Any] = {}
        self._backup = np.zeros(0)
        self._generator = np.random.default_rng(0)
        if env is not None:
            self._attach(env)

    def reset(self, env: Env) -> None:
        """Begin an episode of the policy; the counts go on.

        Raises:
            ValueError: the policy or the backup action does not fit the environment.
        """
        self._attach(env)
        seed, number = env.episode
        self._memory = {"seed": seed, "number": number}
        self._generator = np.random.default_rng([seed % 2**63, number])
        self._policy.check(env)
        self._policy.reset(env, seed)
        self.plan = None

    @property
    def counts(self) -> FloatArray:
        """Decisions, interventions, unresolved decisions, and the sum of the changes."""
        return np.array([self.decisions, self.interventions, self.unresolved, self.change], dtype=np.float64)

    def statistics(self) -> dict[str, float]:
        """Share of changed actions, mean changes, and share of decisions without a safe plan."""
        return rates(self.counts)

    def action(self, env: Env) -> FloatArray:
        """The action of the policy, or the nearest one that is safe."""
        proposed = self._proposed(env)
        self.decisions += 1
        found = self._safest(env, proposed[None])
        if found[0]:
            self.plan = found[1]
            return proposed
        width = np.where(np.isfinite(env.action_high - env.action_low), env.action_high - env.action_low, 1.0)
        width = np.where(width > 0, width, 1.0)
        safe, plan = self._safest(env, self._candidates(env, proposed, width), proposed, width)
        if safe:
            plan = self._nearer(env, proposed, plan, width)
        else:
            self.unresolved += 1
        self.plan = plan
        self.interventions += 1
        self.change += float(np.abs((plan[0] - proposed) / width).max())
        return plan[0].copy()

    def _attach(self, env: Env) -> None:
        backup = operating_action(env) if self._given is None else self._given
        self._backup = np.clip(as_vector("backup", backup, len(env.action_names)), env.action_low, env.action_high)

    def _proposed(self, env: Env) -> FloatArray:
        """The action of the policy in physical units, within the limits."""
        seen: Any = env._returned
        rows = Rows(env, seen[None], env.state[None], np.array([env.steps]), [self._memory])
        chosen = as_vector("the policy's action", self._policy.act(rows)[0], len(env.action_names))
        physical = chosen if self._policy.physical else env.to_physical(chosen)
        return np.clip(physical, env.action_low, env.action_high)

    def _candidates(self, env: Env, proposed: FloatArray, width: FloatArray) -> FloatArray:
        """First actions to try: towards the backup, of the last plan, at limits, and samples."""
        share = np.linspace(0.0, 1.0, _POINTS)[1:, None]
        rows = [proposed + share * (self._backup - proposed)]
        if self.plan is not None:
            rows.append(self.plan[min(1, len(self.plan) - 1)][None])
        for at in range(len(proposed)):
            for end in (env.action_low[at], env.action_high[at]):
                if np.isfinite(end):
                    one = proposed.copy()
                    one[at] = end
                    rows.append(one[None])
        sizes = 2.0 ** -self._generator.integers(0, 7, (self._samples, 1))
        rows.append(proposed + sizes * width * self._generator.uniform(-1.0, 1.0, (self._samples, len(proposed))))
        return np.clip(np.concatenate(rows), env.action_low, env.action_high)

    def _plans(self, firsts: FloatArray) -> FloatArray:
        """Plans with these first actions, (continuations x firsts, horizon, actions)."""
        count, horizon = len(firsts), self._horizon
        held = np.repeat(firsts[:, None], horizon, axis=1)
        safe = held.copy()
        safe[:, 1:] = self._backup
        plans = [held, safe]
        if self.plan is not None and horizon > 1:
            later = held.copy()
            rest = np.concatenate([self.plan[2:], np.tile(self._backup, (horizon, 1))])[: horizon - 1]
            later[:, 1:] = np.repeat(rest[None], count, axis=0)
            plans.append(later)
        return np.concatenate(plans)

    def _safest(
        self, env: Env, firsts: FloatArray, near: FloatArray | None = None, width: FloatArray | None = None
    ) -> tuple[bool, FloatArray]:
        """If one is safe, and the safe plan nearest to `near`, else the plan that does best."""
        plans = self._plans(firsts)
        found = env.rollout(plans, threads=self._threads)
        safe = self._safe(found)
        if safe.any():
            rows = np.flatnonzero(safe)
            if near is None or width is None:
                return True, plans[rows[0]]
            away = _distance(plans[rows, 0], near, width)
            return True, plans[rows[int(np.argmin(away))]]
        failed = np.array([bool(text) for text in found.failure])
        order = np.lexsort((found.cost.sum(axis=1), -found.steps.astype(np.int64), failed))
        return False, plans[int(order[0])]

    def _safe(self, found: Rollout) -> npt.NDArray[np.bool_]:
        failed = np.array([bool(text) for text in found.failure])
        worst = found.violations.max(axis=(1, 2), initial=0.0)
        return np.asarray(~failed & ~(worst > self._margin))

    def _nearer(self, env: Env, proposed: FloatArray, plan: FloatArray, width: FloatArray) -> FloatArray:
        """A safe plan nearer to the proposed action: single actions are restored, then all."""
        for at in range(len(proposed)):
            one = plan[0].copy()
            one[at] = proposed[at]
            safe, restored = self._safest(env, one[None])
            plan = restored if safe else plan
        first, low, high = plan[0].copy(), 0.0, 1.0
        whole = float(_distance(first, proposed, width))
        for _ in range(_ROUNDS if whole > 0 else 0):
            shares = np.linspace(low, high, _POINTS)[1:-1]
            safe, nearest = self._safest(env, proposed + shares[:, None] * (first - proposed), proposed, width)
            if safe:
                plan, high = nearest, float(_distance(nearest[0], proposed, width)) / whole
                low = max([low, *shares[shares < high - 1e-12]])
            else:
                low = float(shares[-1])
        return plan


def rates(counts: FloatArray) -> dict[str, float]:
    """Statistics of the counts of a filter, see `SafetyFilter.counts`."""
    decisions, interventions, unresolved, change = (float(one) for one in counts)
    return {
        "intervention_rate": interventions / max(decisions, 1),
        "mean_change": change / max(decisions, 1),
        "mean_change_of_interventions": change / max(interventions, 1),
        "unresolved_rate": unresolved / max(decisions, 1),
    }


def _distance(actions: FloatArray, near: FloatArray, width: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm((actions - near) / width, axis=-1))
