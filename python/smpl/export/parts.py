"""Parts of models: some states, with what they get from the others as inputs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from smpl.support.arguments import FloatArray, check_names


@dataclass(frozen=True)
class CasadiPart:
    """A part of a model as a CasADi function; made by `CasadiModel.part`.

    Attributes:
        rates: `rates(x, w, u, p)`, rates of the states of the part; u and p are those of the whole
            model.
        state_names, state_nominal: elements of x.
        outside_names, outside_nominal: elements of w: states and algebraic variables of the rest
            that the rates read.
    """

    rates: Any
    state_names: tuple[str, ...]
    state_nominal: FloatArray
    outside_names: tuple[str, ...]
    outside_nominal: FloatArray


def chosen(states: Iterable[str], names: tuple[str, ...]) -> list[int]:
    """Positions of states that are named, or belong to a component or an array that is named.

    Raises:
        ValueError: a name means no state; the message lists the right ones.
    """
    positions: set[int] = set()
    for wanted in states:
        found = [i for i, name in enumerate(names) if name == wanted or name.startswith((f"{wanted}.", f"{wanted}["))]
        if not found:
            check_names("states", [wanted], names)
        positions.update(found)
    return sorted(positions)


def cut(
    build: Callable[..., dict[str, Any]],
    smooth: float,
    states: Iterable[str],
    names: tuple[tuple[str, ...], tuple[str, ...]],
    nominal: FloatArray,
) -> CasadiPart:
    """The part of a model with some states; `names` are of states and algebraic variables."""
    import casadi as ca

    at = chosen(states, names[0])
    # Scalars: what the part does not need falls away.
    dae = build("SX", smooth)["dae"]
    x, z, u, p = (ca.SX.sym(dae.name_in(i), dae.size1_in(i)) for i in range(4))
    everything = ca.vertcat(x, z)
    rows = dae(x, z, u, p)[0][at]
    starts = ca.jacobian_sparsity(rows, everything).colind()
    outside = [k for k in range(everything.numel()) if starts[k + 1] > starts[k] and k not in set(at)]
    rates = ca.Function("rates", [x[at], everything[outside], u, p], [rows], ["x", "w", "u", "p"], ["ode"])
    inside, rest = (tuple((names[0] + names[1])[k] for k in positions) for positions in (at, outside))
    return CasadiPart(rates, inside, np.array(nominal[at]), rest, np.array(nominal[outside]))
