"""Sampling-based predictive control of the antibody plant: a decision a batch.

Plans of 25 h say what the next batch is run with (elution, flush, modifier) and when the columns
swap. Phases, swaps and events are simulated as they are; nothing of the plant is written again
here.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from smpl.controllers.sampling import SamplingMPC
from smpl.envs import Env
from smpl.support.arguments import FloatArray

PERIOD, HORIZON = 20, 25
# Litres of flush and elution that plans begin with: the nominal ones, and shorter ones of which the
# product reaches the pool within the hour in which the pool begins to fill.
VOLUMES = ((750, 300), (500, 150), (450, 150))
# A batch that is to be in the pool at the end of the episode starts so many hours before.
LAST = 5
SPREAD = {"V_flush": 40.0, "V_elu": 20.0, "c_s_cex": 0.06, "c_s_elu": 0.01}


def plans(env: Env, horizon: int) -> FloatArray:
    """Initial sequences of actions (K, horizon, actions) with a swap every 20 h."""
    at = {name: i for i, name in enumerate(env.action_names)}
    base = np.tile(env.policy("nominal"), (horizon, 1))
    # The level of the buffer tank is controlled in the policy; a plan lets out what comes in.
    base[:, at["F_out"]] = base[:, at["F_2"]]
    steps = env.steps + np.arange(horizon)
    base[:, at["switch"]] = steps % PERIOD == PERIOD - 1
    found = []
    for flush, elution in VOLUMES:
        plan = base.copy()
        plan[:, at["V_flush"]], plan[:, at["V_elu"]] = flush, elution
        found.append(plan)
    if env.max_steps - LAST in steps:
        for plan in list(found):
            late = plan.copy()
            late[:, at["switch"]] = steps == env.max_steps - LAST
            found.append(late)
    return np.array(found)


def cost(found: Any, _: FloatArray) -> FloatArray:
    """Antibody that is not recovered, and a violation dearer than all of a batch."""
    return np.asarray(-found.rewards / 1e5 + 1e3 * found.violations.sum(axis=2))


def plant_mpc(env: Env, **options: Any) -> SamplingMPC:
    """The controller for an environment of the plant; `options` are those of `SamplingMPC`."""
    chosen: dict[str, Any] = {
        "horizon": HORIZON, "hold": HORIZON, "every": PERIOD, "samples": 12, "iterations": 2, "method": "cem",
        "elites": 0.25, "integer": ["switch"], "guess": plans, "cost": cost,
        "deviation": {name: SPREAD.get(name, 0.0) for name in env.action_names},
    }  # fmt: skip
    return SamplingMPC(**{**chosen, **options})
