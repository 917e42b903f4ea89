"""Sensors of the observation levels of a model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from smpl.model import Model
from smpl.support.arguments import FloatArray, as_mapping, as_number
from smpl.support.names import listing

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Sensors:
    """Sensors of an observation level, in the order of `observation_names`.

    A sample is taken at every step that is a multiple of `every` and read `delay` steps later; the
    reading is held in between. At the start all are read at once.

    Attributes:
        noise: standard deviations, physical units; 0 for an exact reading.
        every, delay: in steps.
        unused: numbers of sensors that an estimator leaves out.
    """

    noise: FloatArray
    every: IntArray
    delay: IntArray
    unused: frozenset[int] = frozenset()

    def arriving(self, step: int) -> dict[int, list[int]]:
        """Samples first read at a step: step at which they were taken -> sensors."""
        if step == 0:
            return {0: [sensor for sensor in range(len(self.noise)) if sensor not in self.unused]}
        found: dict[int, list[int]] = {}
        for sensor, (every, delay) in enumerate(zip(self.every.tolist(), self.delay.tolist(), strict=True)):
            taken = step - delay
            if taken > 0 and taken % every == 0 and sensor not in self.unused:
                found.setdefault(taken, []).append(sensor)
        return found

    @property
    def longest(self) -> int:
        """The longest delay."""
        return int(self.delay.max(initial=0))


def sensors(model: Model, noise: Mapping[str, float] | None = None) -> Sensors:
    """Sensors of the model's observation level.

    Args:
        model: the model, compiled with that level.
        noise: standard deviations by name instead of the declared ones.

    Raises:
        ValueError: an unknown name, or a negative deviation.
    """
    deviation, every, delay = np.array(model.native.sensors, dtype=np.float64).reshape(-1, 3).T.copy()
    for name, value in as_mapping("noise", noise).items():
        if name not in model.observation_names:
            known = listing(model.observation_names, model.observation_units)
            raise ValueError(f"noise: unknown {name!r}; the level {model.level!r} has: {known}")
        given = as_number(f"noise[{name!r}]", value)
        if not given >= 0:
            raise ValueError(f"noise[{name!r}] is {value!r}, expected a number that is not negative")
        deviation[model.observation_names.index(name)] = given
    return Sensors(deviation, np.maximum(every, 1).astype(np.int64), delay.astype(np.int64))
