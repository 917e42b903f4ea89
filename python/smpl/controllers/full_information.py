"""Controllers that know the state, the parameters of the episode and the model of the plant.

They are references, not upper bounds: their horizon is finite and their search is local, so that a
learned policy can have a higher return. Smooth and small models are optimised by collocation, the
others by sampling around the actions of the nominal policy. These are among the samples: within its
horizon such a controller is not worse than the nominal policy. That of the antibody plant samples
the settings of a batch and the time at which the columns swap.
"""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np

from smpl.controllers.base import Nominal, Policy, TakesWrapped
from smpl.controllers.culture import ACTIONS, STATES
from smpl.controllers.nmpc import NMPC
from smpl.controllers.plant import plant_mpc
from smpl.controllers.sampling import SamplingMPC
from smpl.envs import Env
from smpl.model import Model
from smpl.support.arguments import FloatArray


class Deferred(TakesWrapped):
    """A controller that is built for the model of the environment at the first reset.

    Args:
        make: builds it for an environment.
    """

    sees = "state"

    def __init__(self, make: Any) -> None:
        self._make = make
        self.controller: Any = None
        self._model: Model | None = None

    def reset(self, env: Env) -> None:
        """Build the controller at the first call, or for another model; begin an episode."""
        if self.controller is None or self._model is not env.model:
            self.controller, self._model = self._make(env), env.model
        self.controller.reset(env)

    def action(self, env: Env) -> FloatArray:
        """Actions of the controller."""
        found: FloatArray = self.controller.action(env)
        return found


def followed(env: Env, horizon: int) -> FloatArray:
    """Actions of the nominal policy from here, (H, actions), in a copy of the environment."""
    ahead, policy = deepcopy(env), Nominal()
    actions = np.empty((horizon, len(env.action_names)))
    ended = False
    for k in range(horizon):
        actions[k] = actions[k - 1] if ended else np.clip(policy.action(ahead), env.action_low, env.action_high)
        if not ended:
            *_, terminated, truncated, _ = ahead.step(ahead.from_physical(actions[k]))
            ended = terminated or truncated
    return actions


# Arguments of `SamplingMPC` by environment; deviations are shares of the action box.
_SAMPLED: dict[str, dict[str, Any]] = {
    "beer": {"horizon": 200, "samples": 48, "iterations": 2, "method": "cem", "hold": 12, "every": 8, "share": 0.15},
    "pensim": {"horizon": 100, "samples": 16, "iterations": 1, "method": "cem", "hold": 25, "every": 25, "share": 0.03},
    "atropine": {"horizon": 6, "samples": 16, "iterations": 2, "method": "cem", "hold": 3, "share": 0.02},
}


# The buffer tank belongs to what is predicted, so that it neither overflows nor runs empty; the
# switch is a rule.
_CULTURE: dict[str, Any] = {
    "horizon": 20,
    "cost": "productivity",
    "part": (*STATES, "h", "c_buf"),
    "actions": (*ACTIONS, "F_out"),
    "rest": Policy("nominal"),
    "p": "episode",
    "degree": 2,
    "tolerance": 1e-6,
    "starts": 0,
    "path": False,
}


def _tanks(env: Env) -> dict[str, tuple[float, float]]:
    """The box of the tanks, which reaches 5 % above the bounds, a thousandth inside."""
    low, high = env.model.native.bounds("state")
    at = {name: env.state_names.index(name) for name in _CULTURE["part"]}
    return {name: (1.001 * float(low[i]) + 0.5 * (name == "h"), 1.049 * float(high[i])) for name, i in at.items()}


def full_information(name: str, **options: Any) -> Any:
    """The full-information controller of a shipped environment.

    Args:
        name: name of the model.
        options: those of `NMPC` or `SamplingMPC`.
    """
    if name == "reactor":
        return Deferred(lambda env: NMPC(env, **{"p": "episode", **options}))
    if name == "mab":
        return Deferred(lambda env: NMPC(env, **{**_CULTURE, "bounds": _tanks(env), **options}))
    if name == "mab_plant":
        return Deferred(lambda env: plant_mpc(env, **options))

    def sampled(env: Env) -> SamplingMPC:
        chosen = {**_SAMPLED[name], "guess": followed, **options}
        share = chosen.pop("share")
        width = share * (env.action_high - env.action_low)
        chosen.setdefault("deviation", dict(zip(env.action_names, width.tolist(), strict=True)))
        return SamplingMPC(**chosen)

    return Deferred(sampled)
