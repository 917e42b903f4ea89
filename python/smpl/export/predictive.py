"""Models of do-mpc."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from smpl.export.modules import CasadiModel, casadi
from smpl.model import Model
from smpl.support.arguments import check_names
from smpl.support.optional import load

# Larger models have one vector of states instead of a variable for each.
_MOST_VARIABLES = 200


def do_mpc(
    model: Model,
    parameters: Iterable[str] = (),
    varying: Iterable[str] = (),
    kind: str | None = None,
    smooth: float = 0.0,
) -> Any:
    """The model as a `do_mpc.model.Model` that is set up for do-mpc's controllers and simulators.

    Every state, algebraic variable and action is a variable with its name. Every character except a
    letter, digit or underscore becomes an underscore (`c[1,2]` is `c_1_2`). A model of more than
    200 states has one vector `x`, and one `z`. Outputs, observations and rewards that (x, z, u, p)
    determine are expressions: `NAME`, `obs_NAME`, `reward_NAME`.

    Args:
        model: a compiled model, explicit in its rates.
        parameters: names among `CasadiModel.parameter_names` that become parameters (`_p`) of the
            model.
        varying: names that become time-varying parameters (`_tvp`): disturbances, for example. All
            others have their nominal values.
        kind, smooth: as for `smpl.export.casadi`; optimizers need smooth switches.

    Raises:
        ImportError: do-mpc or CasADi is missing.
        ValueError: the model is not explicit in its rates, or a name is unknown.
    """
    functions = casadi(model, kind, smooth)
    library = load("do_mpc", "this export")
    if functions.dae is None:
        raise ValueError(f"{model.name} is not explicit in its rates: do-mpc takes no model of that form")
    parameters, varying = list(parameters), list(varying)
    check_names("parameters", parameters, functions.parameter_names)
    check_names("varying", varying, functions.parameter_names)
    made = library.model.Model("continuous", functions.kind)
    x = _variables(made, "_x", "x", functions.state_names)
    z = _variables(made, "_z", "z", functions.algebraic_names)
    u = _variables(made, "_u", "u", functions.action_names)
    p = _parameters(made, functions, parameters, varying)
    rates, algebraic = functions.dae(x, z, u, p)
    for name, part in _parts("x", functions.state_names, rates):
        made.set_rhs(name, part)
    for name, part in _parts("z", functions.algebraic_names, algebraic):
        made.set_alg(f"{name}_equation", part)
    _expressions(made, functions, {"dx": rates, "x": x, "z": z, "u": u, "p": p})
    made.setup()
    return made


def _plain(names: Iterable[str]) -> list[str]:
    """Names as identifiers, no two alike."""
    plain: list[str] = []
    for name in names:
        wanted = re.sub(r"\W+", "_", name).strip("_")
        plain.append(wanted if wanted not in plain else f"{wanted}_{len(plain)}")
    return plain


def _variables(made: Any, kind: str, vector: str, names: tuple[str, ...]) -> Any:
    """Variables of a model, one for each name or a vector of all, as a column."""
    import casadi as ca

    if len(names) > _MOST_VARIABLES:
        return made.set_variable(kind, vector, shape=(len(names), 1))
    return ca.vertcat(*(made.set_variable(kind, name) for name in _plain(names)))


def _parts(vector: str, names: tuple[str, ...], values: Any) -> list[tuple[str, Any]]:
    if len(names) > _MOST_VARIABLES:
        return [(vector, values)]
    return [(name, values[i]) for i, name in enumerate(_plain(names))]


def _parameters(made: Any, functions: CasadiModel, parameters: list[str], varying: list[str]) -> Any:
    import casadi as ca

    chosen = dict.fromkeys(parameters, "_p") | dict.fromkeys(varying, "_tvp")
    plain = dict(zip(functions.parameter_names, _plain(functions.parameter_names), strict=True))
    elements = [
        made.set_variable(chosen[name], plain[name]) if name in chosen else value
        for name, value in zip(functions.parameter_names, functions.parameter_nominal, strict=True)
    ]
    return ca.vertcat(*elements)


def _expressions(made: Any, functions: CasadiModel, values: dict[str, Any]) -> None:
    """Outputs, observations and rewards that no value of another instant is needed for."""
    lists: list[tuple[str, tuple[str, ...], Any]] = [
        ("", functions.output_names, functions.outputs),
        ("obs_", functions.observation_names, functions.observations),
    ]
    lists += [("reward_", (name,), function) for name, function in functions.rewards.items()]
    taken = set(_plain(functions.state_names + functions.algebraic_names + functions.action_names))
    for prefix, names, function in lists:
        if function is None or "c" in function.name_in():
            continue
        found = function(*(values[name] for name in function.name_in()))
        for i, name in enumerate(_plain(names)):
            if prefix + name not in taken:
                made.set_expression(prefix + name, found[i])
