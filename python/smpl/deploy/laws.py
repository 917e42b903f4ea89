"""Control laws that can be exported: tables, linear feedback, PID loops, networks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.support.arguments import FloatArray

Single = npt.NDArray[np.float32]
# Activations of networks.
ACTIVATIONS = ("linear", "tanh", "relu", "elu", "leaky_relu", "sigmoid")


@dataclass(frozen=True)
class Table:
    """A sequence of actions by the number of the step.

    Attributes:
        actions: (steps, actions).
        hold: the last one is held after the end; otherwise there is no action.
        inputs: none.
    """

    actions: FloatArray
    hold: bool = True
    inputs: tuple[tuple[str, int], ...] = ()

    @property
    def memory(self) -> int:
        """Number of values carried from call to call: the step."""
        return 1


@dataclass(frozen=True)
class Linear:
    """u = rest - gain (x - state) - integral_gain z within limits, z the summed output errors.

    Attributes:
        inputs: source and position of each input.
        gain: (actions, inputs); integral_gain: (actions, errors).
        state, rest: operating point.
        rows, through: errors by deviations of inputs and actions, (errors, inputs) and (errors,
            actions).
        low, high: limits of the actions.
    """

    inputs: tuple[tuple[str, int], ...]
    gain: FloatArray
    state: FloatArray
    rest: FloatArray
    low: FloatArray
    high: FloatArray
    integral_gain: FloatArray
    rows: FloatArray
    through: FloatArray

    @property
    def memory(self) -> int:
        """Number of values carried from call to call: the step and the sums."""
        return 1 + len(self.rows)


@dataclass(frozen=True)
class Loop:
    """A PID loop with its set-point at each step (the last is held), see `smpl.controllers.PID`."""

    measured: int
    action: int
    gain: float
    integral_time: float
    derivative_time: float
    filter: float
    weight: float
    tracking_time: float
    interval: float
    low: float
    high: float
    level: float
    velocity: bool
    clamping: bool
    back_calculation: bool
    bumpless: bool
    set_points: FloatArray


@dataclass(frozen=True)
class Loops:
    """PID loops; the other actions are held.

    Attributes:
        inputs: source and position of each input.
        base: actions without loops.
        loops: each with the position of its input and its action.
    """

    inputs: tuple[tuple[str, int], ...]
    base: FloatArray
    loops: tuple[Loop, ...]

    @property
    def memory(self) -> int:
        """Number of values carried from call to call: the step, and six of each loop."""
        return 1 + 6 * len(self.loops)


@dataclass(frozen=True)
class Layer:
    """weight x + bias and activation, in single precision; `slope` is of ELU and leaky ReLU."""

    weight: Single
    bias: Single
    activation: str = "linear"
    slope: float = 1.0


@dataclass(frozen=True)
class Network:
    """A network from scaled observations to scaled actions.

    Attributes:
        inputs: source and position of each observation.
        low, high: bounds by which an observation is scaled to [-1, 1]; NaN for one that is not
            scaled. Observations are clipped to `clip_low` and `clip_high` before.
        windows: (inputs,) True where the scaled value is clipped to [-1, 1].
        history: number of observations that are seen, the newest last.
        layers: of the network.
        out_low, out_high: the output is clipped there.
        learned: positions of the actions that the network chooses.
        centre: actions at output 0; down, up: change of each learned action at -1 and at 1.
        physical: outputs are actions in physical units.
        actions: number of the actions.
    """

    inputs: tuple[tuple[str, int], ...]
    low: FloatArray
    high: FloatArray
    clip_low: FloatArray
    clip_high: FloatArray
    windows: npt.NDArray[np.bool_]
    layers: tuple[Layer, ...]
    out_low: Single
    out_high: Single
    learned: tuple[int, ...]
    centre: FloatArray
    down: FloatArray
    up: FloatArray
    history: int = 1
    physical: bool = False
    formulation: dict[str, Any] | None = field(default=None)

    @property
    def memory(self) -> int:
        """Number of values carried from call to call: the step, and earlier observations."""
        return 1 + (self.history - 1) * len(self.inputs)


Law = Table | Linear | Loops | Network
