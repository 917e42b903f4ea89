"""A recorded run, on the steps of a model."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from smpl.support.arguments import FloatArray


@dataclass(frozen=True)
class Run:
    """One recorded run of H steps.

    Attributes:
        name: where it is from, for messages.
        states: at the start, (states,); what the record has not is at the model's nominal start.
        actions: (H, actions).
        outputs: observations and states by name, (H + 1,), NaN where nothing was read.
        discrete: discrete variables at the start.
        disturbances: sequences by name, (H,).
        parameters: known values.
        assumed: states of which the record has no start.
        instants: of samples within steps: the step, from 0, and the share of it.
        samples: outputs by name at these instants, NaN where nothing was read.
    """

    name: str
    states: FloatArray
    actions: FloatArray
    outputs: dict[str, FloatArray]
    discrete: dict[str, float]
    disturbances: dict[str, FloatArray]
    parameters: dict[str, float]
    assumed: tuple[str, ...] = ()
    instants: tuple[tuple[int, float], ...] = ()
    samples: dict[str, FloatArray] = field(default_factory=dict)

    def values(self, name: str) -> FloatArray:
        """An output at the ends of the steps, then at the instants, (H + 1 + instants,)."""
        missing = np.full(len(self.instants), np.nan)
        return np.concatenate([self.outputs[name], self.samples.get(name, missing)])

    def times(self, step: float) -> FloatArray:
        """Times of these values for a sampling interval."""
        within = [k + share for k, share in self.instants]
        return step * np.concatenate([np.arange(len(self.actions) + 1), within])
