"""Linearisation of a model, see `smpl.Model.linearize`."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from smpl.support.arguments import FloatArray


class Linearization(tuple[FloatArray, ...]):
    """The matrices A, B, C, D, as a tuple.

    Attributes:
        state_names: names of the states x of A, B and C; the free ones of a model whose states are
            projected to constraints.
        states: derivatives of all states by x, (states, len(state_names)).

    Example:
        >>> model = smpl.compile("reactor")
        >>> model.linearize(model.steady_state([26.85, 0.1]), [26.85, 0.1]).state_names
        ('c_A', 'T', 'h')
    """

    state_names: tuple[str, ...]
    states: FloatArray

    def __new__(
        cls, matrices: Iterable[FloatArray], state_names: tuple[str, ...], states: FloatArray | None
    ) -> Linearization:
        """Make it of the four matrices; without `states`, x are all states."""
        made = super().__new__(cls, matrices)
        made.state_names = state_names
        made.states = np.eye(len(state_names)) if states is None else states
        return made

    def __getnewargs__(self) -> tuple[tuple[FloatArray, ...], tuple[str, ...], FloatArray]:
        """Arguments of a copy, also by `pickle`."""
        return tuple(self), self.state_names, self.states
