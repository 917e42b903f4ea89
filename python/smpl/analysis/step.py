"""The sampling interval of a model, and a step of that length."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from smpl.analysis.sensitivity import step

if TYPE_CHECKING:
    from smpl.model import Model


class Step(float):
    """The sampling interval of a model, in its unit of time; called, it takes a control step."""

    model: Model

    def __call__(
        self,
        x: npt.ArrayLike,
        u: npt.ArrayLike,
        p: Mapping[str, npt.ArrayLike] | None = None,
        *,
        method: str | None = None,
        threads: int | None = None,
        first_step: int = 0,
    ) -> npt.NDArray[np.float64]:
        """States after a control step from the states `x` with the actions `u`.

        It is a step of an environment that was reset to `x`. Random numbers are at their means.
        Conditions that would end an episode are not looked at.

        Args:
            x: states, (states,), or (N, states) for N points on all cores.
            u: actions, (actions,) or (N, actions).
            p: values of parameters, discrete variables and disturbances by name, one for all points
                or (N,).
            method: what takes the steps; the model's or scenario's if none.
            threads: all processors if none.
            first_step: steps that count as completed before: the clock begins there.

        Returns:
            (states,), or (N, states) if `x` or `u` has points.

        Raises:
            ValueError: an unknown name, a wrong shape, no finite number.
            SimulationError: the step does not come to its end.
        """
        return step(self.model, x, u, p, method=method, threads=threads, first_step=first_step)
