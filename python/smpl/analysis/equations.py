"""Equations of a model in Python, see `smpl.Model`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy.typing as npt

from smpl import _native
from smpl.support.arguments import (
    FloatArray,
    as_finite,
    as_finite_number,
    as_mapping,
    as_vector,
    check_names,
    expand_parameters,
    pairs_of,
)
from smpl.support.names import Named
from smpl.support.optional import load
from smpl.support.options import listed

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

    from smpl.model import Model

# Roles whose values the argument `p` may replace, in the order in which a name is looked up.
_REPLACEABLE = ("parameter", "discrete", "disturbance")


class Equations(Named):
    """Residual, Jacobian and steady states of a compiled model."""

    native: _native.Model

    @cached_property
    def unknown_names(self) -> tuple[str, ...]:
        """Names of the elements of `y`: states, then solved algebraic variables."""
        return (*self.state_names, *self.native.names("solved"))

    def residual(
        self,
        t: float,
        y: npt.ArrayLike,
        yp: npt.ArrayLike,
        u: npt.ArrayLike,
        p: Mapping[str, float] | None = None,
    ) -> FloatArray:
        """Residual: f - y' for differential rows, g for algebraic ones; shape of `y`.

        `initial(x)` and `previous(x)` are x, as at the start of an episode from there (actions at
        their nominal values), `steady(x)` is that of the model's own steady state. So it is for
        `jacobian`, `rhs` and `linearize`.

        Raises:
            ValueError: a wrong shape, a name in `p` that the model does not have, or a value in `u`
                or `p` that is not finite. Elements of `y` and `yp` may be: solvers try such points,
                and see it in the result.
        """
        return self.native.residual(as_finite_number("t", t), self._y(y), self._y(yp, "yp"), self._u(u), self._given(p))

    def jacobian(
        self,
        t: float,
        y: npt.ArrayLike,
        yp: npt.ArrayLike,
        u: npt.ArrayLike,
        cj: float,
        p: Mapping[str, float] | None = None,
    ) -> csc_matrix:
        """Jacobian of the residual, dF/dy + cj dF/dy', as a SciPy matrix in compressed columns.

        Raises:
            ValueError: as for `residual`.
            ImportError: SciPy is missing.
        """
        csc_matrix = load("scipy.sparse", "Model.jacobian").csc_matrix
        data, rows, columns = self.native.jacobian(
            as_finite_number("t", t),
            self._y(y),
            self._y(yp, "yp"),
            self._u(u),
            as_finite_number("cj", cj),
            self._given(p),
        )
        size = len(self.unknown_names)
        return csc_matrix((data, rows, columns), shape=(size, size))

    def rhs(self, t: float, y: npt.ArrayLike, u: npt.ArrayLike, p: Mapping[str, float] | None = None) -> FloatArray:
        """Right-hand side dy/dt of a model that is explicit and has no algebraic unknowns.

        What equations read of other instants is as for `residual`.

        Raises:
            ValueError: as for `residual`; also where the model is not explicit.
        """
        return self.native.rhs(as_finite_number("t", t), self._y(y), self._u(u), self._given(p))

    @listed
    def steady_state(
        self,
        u: npt.ArrayLike,
        p: Mapping[str, float] | None = None,
        fixed: Mapping[str, float] | None = None,
        guess: Mapping[str, float] | None = None,
    ) -> FloatArray:
        """Steady state at the action `u`: the unknowns `y` with vanishing residual.

        `initial(x)`, `previous(x)` and `steady(x)` are x itself, for other actions than those of
        the `steady` block too. Discrete variables are held at their initial values, or those in
        `p`: updates `at start` and `at end` do not run.

        Args:
            u: actions.
            p: parameters and the like.
            fixed: values of states that the equations leave free, by name; those of the model's
                `steady` block by default.
            guess: where the search begins, states and solved algebraic variables by name
                (`unknown_names`); the others begin at the model's steady state, else where they
                start. It selects one of several steady states.

        Raises:
            ValueError: as for `residual`.
            SimulationError: none was found.
        """
        held = pairs_of("fixed", fixed, self.state_names)
        begin = pairs_of("guess", guess, self.unknown_names)
        return self.native.steady_state(self._u(u), self._given(p), held, begin)

    @listed
    def trim(
        self,
        fixed: Mapping[str, float],
        free: Sequence[str],
        u: npt.ArrayLike | None = None,
        p: Mapping[str, float] | None = None,
        guess: Mapping[str, float] | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Steady state in which some unknowns have given values and as many actions are found.

        Args:
            fixed: values of states and solved algebraic variables (`unknown_names`), physical
                units.
            free: names of the actions that are found, as many as `fixed` has.
            u: actions; those of `free` are guesses. The nominal ones by default.
            p: parameters and the like.
            guess: initial guess of unknowns by name, as for `steady_state`.

        Returns:
            The unknowns `y` and the actions.

        Raises:
            ValueError: an unknown name, a wrong shape or number of actions.
            SimulationError: none was found.

        Example:
            >>> y, u = smpl.compile("reactor").trim({"h": 0.7}, ["q_out"])
        """
        held = pairs_of("fixed", fixed, self.unknown_names)
        check_names("free", free, self.action_names)
        if len(set(free)) != len(held):
            raise ValueError(f"free has {len(set(free))} actions, fixed has {len(held)} values: they must be as many")
        found = [self.action_names.index(name) for name in dict.fromkeys(free)]
        begin = pairs_of("guess", guess, self.unknown_names)
        given = self.native.defaults("action") if u is None else u
        return self.native.trim(self._u(given), self._given(p), held, found, begin)

    def _y(self, values: npt.ArrayLike, name: str = "y") -> FloatArray:
        return as_vector(name, values, len(self.unknown_names))

    def _u(self, values: npt.ArrayLike) -> FloatArray:
        return as_finite("u", values, len(self.action_names))

    @cached_property
    def _replaceable(self) -> dict[str, tuple[str, int]]:
        places: dict[str, tuple[str, int]] = {}
        for role in _REPLACEABLE:
            for index, name in enumerate(self.native.names(role)):
                places.setdefault(name, (role, index))
        return places

    def _given(self, p: Mapping[str, float] | None) -> list[tuple[str, int, float]]:
        p = as_mapping("p", p)
        if not p:
            return []
        arrays = [name for name in p if name not in self._replaceable and self.native.elements_of(name)]
        values = {name: value for name, value in p.items() if name not in arrays}
        check_names("p", values, self._replaceable)
        expanded = expand_parameters("p", cast("Model", self), {name: p[name] for name in arrays})
        return [
            (*self._replaceable[name], as_finite_number(f"p[{name!r}]", value))
            for name, value in (expanded | values).items()
        ]
