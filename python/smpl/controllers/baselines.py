"""The baselines of the published environments, by name."""

from __future__ import annotations

from collections.abc import Callable
from difflib import get_close_matches
from functools import partial
from typing import Any

from smpl.controllers.base import Constant, Policy
from smpl.controllers.beer import Profile, isothermal
from smpl.controllers.culture import CultureMPC
from smpl.controllers.full_information import full_information
from smpl.controllers.gallery import LOOPS, RECIPES
from smpl.controllers.pensim import RecipeSearch
from smpl.controllers.reactor import Proportional, ReactorNMPC
from smpl.registry import ENVIRONMENTS, GALLERY


def _zero(**options: Any) -> Constant:
    return Constant([0.0] * 4, actions=("dq1", "dq2", "dq3", "dq4"), **options)


def _policy(name: str) -> Callable[..., Policy]:
    return lambda **options: Policy(name, **options)


def _culture(kind: str) -> Callable[..., CultureMPC]:
    return lambda **options: CultureMPC(kind, **options)


_BASELINES: dict[str, dict[str, Callable[..., Any]]] = {
    "reactor": {"pid": Proportional, "mpc": ReactorNMPC},
    "beer": {"profile": Profile, "isothermal": isothermal},
    "pensim": {"recipe": _policy("nominal"), "gpei": RecipeSearch},
    "atropine": {"mpc": _policy("mpc"), "zero": _zero},
    "mab": {"nominal": _policy("nominal"), "mpc": _culture("mpc"), "empc": _culture("empc")},
    "mab_plant": {"nominal": _policy("nominal")},
}
for _name, _known in _BASELINES.items():
    _known["full_information"] = partial(full_information, _name)
_BASELINES |= {name: {"pid": loops} for name, loops in LOOPS.items()}
_BASELINES |= {name: {"recipe": _policy("recipe")} for name in RECIPES}


def baseline(env_name: str, name: str, **options: Any) -> Any:
    """A baseline of the paper as a controller.

    Args:
        env_name: `reactor`, `Reactor` or `smpl/Reactor-v0`.
        name: `pid`, `mpc` (reactor); `profile`, `isothermal` (beer); `recipe`, `gpei` (PenSim);
            `mpc`, `zero` (atropine); `nominal`, `mpc`, `empc` (MAb); `nominal` (its plant). Each
            also has `full_information`, which knows the state and the parameters of the episode.
            Plants of the gallery have `pid`, batches `recipe`.
        options: further arguments of the controller, such as `temperature` of `isothermal`.

    Raises:
        ValueError: no such environment or baseline; the message lists those that there are.
        ImportError: an extra is missing; the message names the command.
    """
    model = _model(env_name)
    known = _BASELINES[model]
    if name not in known:
        raise ValueError(f"baseline {name!r} of {model}: there are {', '.join(known)}")
    return known[name](**options)


def baselines(env_name: str) -> tuple[str, ...]:
    """Names of the baselines of an environment."""
    return tuple(_BASELINES[_model(env_name)])


def _model(env_name: str) -> str:
    plain = str(env_name).removeprefix("smpl:").removeprefix("smpl/").removesuffix("-v0")
    names = {name.lower(): model for name, model in (ENVIRONMENTS | GALLERY).items()} | {
        model: model for model in _BASELINES
    }
    if plain.lower() in names:
        return names[plain.lower()]
    near = get_close_matches(plain.lower(), names, 1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise ValueError(f"no environment {env_name!r}{hint}; there are: {', '.join(_BASELINES)}")
