"""Elimination of rates and algebraic variables that appear linearly in the equations.

The block triangular form of the equations (A. Pothen, C.-J. Fan, ACM Transactions on Mathematical
Software 16 (1990) 303-324) orders them so that each block is solved with those before it. A small
block in which its own unknowns are linear is solved symbolically: a mass matrix M(x) x' = f(x), or
an algebraic variable that an equation defines. All others stay unknowns of the collocation.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

# Larger linear blocks stay equations: their symbolic solution has more operations than it saves.
_LARGEST = 4
# Points at which a block is compared with its linear form, and the relative error that is rounding.
_TRIALS, _ROUNDING = 3, 1e-8


@dataclass
class Eliminated:
    """Equations of a point after elimination.

    Attributes:
        solved: unknown's place -> expression that does not read solved unknowns.
        rows: places of the equations that are left.
    """

    solved: dict[int, Any]
    rows: list[int]


def eliminate(equations: Any, unknowns: Any, rates: int) -> Eliminated:
    """Solve equations for the unknowns that are linear in a small block.

    Args:
        equations: residuals, a column of CasADi's SX.
        unknowns: as many symbols, the rates of states first.
        rates: number of rates. An algebraic variable stays an unknown if its block reads a rate
            that does: costs and bounds know no rates.

    Returns:
        Unchanged equations where they have no block triangular form with a full diagonal.
    """
    import casadi as ca

    count = int(equations.numel())
    nothing = Eliminated({}, list(range(count)))
    if not count or count != unknowns.numel():
        return nothing
    pattern = ca.jacobian(equations, unknowns).sparsity()
    if ca.sprank(pattern) < count:
        return nothing
    _, row_order, column_order, row_blocks, *_ = pattern.btf()
    place = {unknowns[i].element_hash(): i for i in range(count)}
    left, rows, solved = set[int](), list[int](), dict[int, Any]()
    for first, end in pairwise(row_blocks):
        block, own = list(row_order[first:end]), list(column_order[first:end])
        residual = equations[block]
        read = {place[s.element_hash()] for s in ca.symvar(residual) if s.element_hash() in place} - set(own)
        # A comparison has no derivative, so that a block may read unknowns of later ones.
        known = read <= left | solved.keys()
        hidden = any(i >= rates for i in own) and _reads_rates(read, solved, left, place, rates)
        found = _solution(residual, unknowns[own]) if known and not hidden and len(own) <= _LARGEST else None
        if found is None:
            left |= set(own)
            rows += block
        else:
            solved |= {i: found[j] for j, i in enumerate(own)}
    return Eliminated(_unfolded(solved, unknowns), sorted(rows))


def _reads_rates(read: set[int], solved: dict[int, Any], left: set[int], place: dict[int, int], rates: int) -> bool:
    """Find whether unknowns depend on a rate that is left."""
    import casadi as ca

    seen, waiting = set[int](), list(read)
    while waiting:
        one = waiting.pop()
        if one in seen:
            continue
        seen.add(one)
        if one < rates and one in left:
            return True
        if one in solved:
            keys = [symbol.element_hash() for symbol in ca.symvar(solved[one])]
            waiting += [place[key] for key in keys if key in place]
    return False


def _solution(residual: Any, unknowns: Any) -> Any:
    """The unknowns at which a residual is 0, if it is linear in them."""
    import casadi as ca

    matrix = ca.jacobian(residual, unknowns)
    if any(ca.depends_on(matrix, unknowns[i]) for i in range(unknowns.numel())):
        return None
    rest = ca.substitute(residual, unknowns, ca.SX.zeros(unknowns.shape))
    if not _linear(residual, unknowns, matrix, rest):
        return None
    return -ca.solve(matrix, rest)


def _linear(residual: Any, unknowns: Any, matrix: Any, rest: Any) -> bool:
    """Compares a residual with its linear form, since comparisons have no derivative."""
    import casadi as ca

    others = [s for s in ca.symvar(residual) if not ca.depends_on(unknowns, s)]
    error = residual - (ca.mtimes(matrix, unknowns) + rest)
    compare = ca.Function("compare", [unknowns, ca.vertcat(ca.SX(0, 1), *others)], [error, residual])
    random = np.random.default_rng(0)
    for _ in range(_TRIALS):
        size = 10.0 ** random.uniform(-3, 6)
        at = size * random.standard_normal(unknowns.numel())
        off, value = (np.asarray(part).ravel() for part in compare(at, random.uniform(0.5, 1.5, len(others))))
        if not (np.abs(off) <= _ROUNDING * (np.abs(value) + size)).all():
            return False
    return True


def _unfolded(solved: dict[int, Any], unknowns: Any) -> dict[int, Any]:
    """Expressions in which those before them are inserted."""
    import casadi as ca

    if not solved:
        return {}
    places = list(solved)
    values, _ = ca.substitute_inplace([unknowns[i] for i in places], [solved[i] for i in places], [ca.SX(0)], False)
    return dict(zip(places, values, strict=True))
