"""Predictive control of the antibody culture: the published tracking and economic controllers."""

from __future__ import annotations

from typing import Any

from smpl.controllers.base import Policy, TakesWrapped
from smpl.controllers.nmpc import NMPC
from smpl.envs import Env
from smpl.export import casadi
from smpl.model import Model
from smpl.support.arguments import FloatArray

# What the culture model holds; buffer tank and column follow the rules of the nominal policy.
STATES = (
    "Xv1", "Xt1", "GLC1", "GLN1", "LAC1", "AMM1", "mAb1", "V1",
    "Xv2", "Xt2", "GLC2", "GLN2", "LAC2", "AMM2", "mAb2", "V2", "T",
)  # fmt: skip
ACTIONS = ("F_in", "F_1", "F_r", "F_2", "GLC_in", "GLN_in", "T_c")
KINDS = ("mpc", "empc")


class CultureMPC(TakesWrapped):
    """`mpc` and `empc` of the paper: predictive control of the culture by seven actions.

    The tracking controller minimises the integral of squared scaled deviations of states and
    actions from the steady state. The economic one maximises the antibody produced (the reward
    `productivity`). Declared bounds hold where they can: a start outside of them is brought back.
    The outflow of the buffer tank and the switch are those of the policy `nominal`. The problem is
    built at the first reset.

    Args:
        kind: `mpc` or `empc`.
        horizon: intervals of an hour; the paper's 100.
        tank: predict the level of the buffer tank too, with the outflow that the rule has at the
            nominal level. The published economic controller does not, and lets the tank run empty
            or over within hours: by default it is predicted for `empc` alone.
        options: further arguments of `NMPC`.

    Attributes:
        controller: the `NMPC`.
    """

    sees = "state"

    def __init__(self, kind: str = "mpc", horizon: int = 100, *, tank: bool | None = None, **options: Any) -> None:
        if kind not in KINDS:
            raise ValueError(f"kind is {kind!r}; there are: {', '.join(KINDS)}")
        self._kind, self._horizon = kind, horizon
        part = (*STATES, "h") if (kind == "empc" if tank is None else tank) else STATES
        self._options: dict[str, Any] = {"integrate": True, "part": part, "actions": ACTIONS, "tolerance": 1e-4}
        # A start that is too hot is cooled by what the other tanks bear, so that broken bounds are
        # priced low.
        self._options |= {"rest": Policy("nominal"), "p": "episode", "soft_weight": 100.0, "starts": 0} | options
        # Nothing of the culture turns within an hour.
        self._options.setdefault("path", False)
        self.controller: NMPC | None = None

    def reset(self, env: Env) -> None:
        """Build the problem at the first call; forget the last solution.

        Raises:
            ValueError: the environment is not an antibody culture.
        """
        missing = [name for name in (*STATES, *ACTIONS) if name not in (*env.state_names, *env.action_names)]
        if missing:
            raise ValueError(
                f"this controller is for the antibody culture; {env.model.name} has no {', '.join(missing[:5])}"
            )
        if self.controller is None or self.controller.model is not env.model:
            cost: Any = "productivity" if self._kind == "empc" else _deviations(env.model)
            given = {"bounds": self._bounds(env), **self._options}
            if "h" in given["part"]:
                # The rule brings the outflow back with the level. As it is at the moment, held for
                # all of the horizon, it would ask for more than the culture bears after an hour
                # with a full tank.
                outflow = env.model.native.defaults("action")[env.action_names.index("F_out")]
                given["forecast"] = {"F_out": float(outflow), **given.get("forecast", {})}
            self.controller = NMPC(env, self._horizon, cost, **given)
        self.controller.reset(env)

    def action(self, env: Env) -> FloatArray:
        """The first actions of the best plan, and the two rules."""
        if self.controller is None:
            raise ValueError("call reset(env) first")
        return self.controller.action(env)

    def _bounds(self, env: Env) -> dict[str, tuple[float, float]]:
        """The published bounds, tightened by 1e-4 of their values."""
        low, high = env.model.native.bounds("state")
        wider = env.parameters.get("headroom", 1.0)
        at = {name: env.state_names.index(name) for name in self._options["part"]}
        found = {name: (1.0001 * float(low[i]), 0.9999 * float(high[i]) / wider) for name, i in at.items()}
        if "h" in found:
            # The tank counts as empty above 0.
            found["h"] = (0.02 * found["h"][1], 0.98 * found["h"][1])
        return found

    @property
    def fallbacks(self) -> int:
        """Decisions without a solution, in which the last plan went on."""
        return 0 if self.controller is None else self.controller.fallbacks


def _deviations(model: Model) -> dict[str, float]:
    """Weights one of the scaled states and actions."""
    functions = casadi(model)
    scale = dict(zip(functions.state_names, functions.state_scale.tolist(), strict=True))
    scale |= dict(zip(functions.action_names, functions.action_scale.tolist(), strict=True))
    return {name: 1 / scale[name] ** 2 for name in (*STATES, *ACTIONS)}
