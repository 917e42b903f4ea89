"""Types of the compiled module. The classes are thin; the package's own classes are what users call."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import numpy as np
import numpy.typing as npt

__version__: str

FloatArray = npt.NDArray[np.float64]
Observation = npt.NDArray[np.float32]
BoolArray = npt.NDArray[np.bool_]
# Names, units and bounds are asked for by role: state, solved, algebraic, discrete, disturbance, action, parameter,
# observation, reward, constraint.
Role = str
# Values put in place of those that an episode would have: (role, element, value).
Given = Sequence[tuple[str, int, float]]

class Diagnostic:
    """One finding of the compiler; positions are 1-based and count characters."""

    file: str
    line: int
    column: int
    end_line: int
    end_column: int
    code: str
    severity: str
    message: str
    help: str | None
    notes: list[str]
    related: list[RelatedPlace]

class RelatedPlace:
    """Another place that belongs to a finding; positions are 1-based and count characters."""

    message: str
    file: str
    line: int
    column: int
    end_line: int
    end_column: int

class CompileError(Exception):
    """The model is at fault; `diagnostics` says where and why."""

    diagnostics: list[Diagnostic]

class ScenarioError(ValueError):
    """The scenario, a variant or a setting is at fault."""

class SimulationError(RuntimeError):
    """The equations could not be solved where there is no episode that could fail.

    ``start`` is the report of a start without a solution, None otherwise: a mapping with ``block`` (number, count),
    ``unknowns`` (name, unit, guess, value, bounds), ``equations`` (equation, residual), ``tried`` (method, iterations,
    residual, outside_bounds), ``at_bounds``, ``badly_scaled``, ``other_solutions`` (outside of the bounds, in the order
    of the unknowns) and ``help``.
    """

    start: dict[str, Any] | None

class Model:
    """A compiled model."""

    def __init__(
        self,
        path: str | None,
        source: str | None,
        scenario: str | None,
        variants: Sequence[str],
        settings: Mapping[str, str],
        observation: str,
        reward: str | None,
        extra: str | None = None,
    ) -> None: ...
    name: str
    text: str
    time_name: str
    time_unit: str
    explicit: bool
    delays: list[str]
    projected: list[str]
    unknowns: int
    states: int
    reward: str
    level: str
    levels: list[str]
    sensors: list[tuple[float, int, int]]
    policies: list[str]
    def is_recipe(self, policy: str) -> bool: ...
    warnings: list[Diagnostic]
    phases: list[str]
    ports: list[tuple[str, str, list[tuple[str, list[str], str | None]]]]
    step: float
    max_steps: int
    nonzeros: int
    sources: list[str]
    def names(self, role: Role) -> list[str]: ...
    def elements_of(self, parameter: str) -> list[str]: ...
    def determined(self, names: list[str]) -> list[tuple[str, int, int]]: ...
    def units(self, role: Role) -> list[str]: ...
    def export(self, target: str, stem: str | None = None, history: int | None = None) -> list[tuple[str, str]]: ...
    def fmu(self, binary: bool, history: int | None = None) -> tuple[bytes, str | None]: ...
    def bounds(self, role: Role) -> tuple[FloatArray, FloatArray]: ...
    def defaults(self, role: Role) -> FloatArray: ...
    def residual(self, t: float, y: FloatArray, yp: FloatArray, u: FloatArray, given: Given) -> FloatArray: ...
    def jacobian(
        self, t: float, y: FloatArray, yp: FloatArray, u: FloatArray, cj: float, given: Given
    ) -> tuple[FloatArray, npt.NDArray[np.int32], npt.NDArray[np.int32]]: ...
    def rhs(self, t: float, y: FloatArray, u: FloatArray, given: Given) -> FloatArray: ...
    def evaluation_times(self, t: float, y: FloatArray, u: FloatArray, cj: float) -> tuple[float, float]: ...
    def steady_state(
        self,
        u: FloatArray,
        given: Given,
        fixed: Sequence[tuple[int, float]],
        guess: Sequence[tuple[int, float]],
    ) -> FloatArray: ...
    def trim(
        self,
        u: FloatArray,
        given: Given,
        fixed: Sequence[tuple[int, float]],
        free: Sequence[int],
        guess: Sequence[tuple[int, float]],
    ) -> tuple[FloatArray, FloatArray]: ...
    def reads_other_instants(self) -> bool: ...
    def linearize(
        self, y: FloatArray, u: FloatArray, given: Given, minimal: bool
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, tuple[list[int], FloatArray] | None]: ...
    @property
    def constraint_names(self) -> list[str]: ...
    def disturbed(
        self,
        points: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
        parameters: Sequence[tuple[str, FloatArray]],
        discrete: Sequence[tuple[str, FloatArray]],
        first_step: int,
    ) -> tuple[FloatArray, FloatArray]: ...
    def draws(self) -> list[tuple[str, bool, bool]]: ...
    def sensitivity(
        self,
        states: FloatArray,
        actions: FloatArray,
        parameters: Sequence[tuple[str, FloatArray]],
        discrete: Sequence[tuple[str, FloatArray]],
        disturbances: Sequence[tuple[str, FloatArray]],
        size: tuple[int, int, int],
        key: tuple[list[tuple[str, int]], int, int | None, str | None],
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]: ...
    def rollout(
        self,
        start: Snapshot | FloatArray,
        actions: FloatArray,
        parameters: Sequence[tuple[str, FloatArray]],
        discrete: Sequence[tuple[str, FloatArray]],
        disturbances: Sequence[tuple[str, FloatArray]],
        size: tuple[int, int],
        options: tuple[
            int | None,
            int,
            bool,
            Sequence[tuple[int, float]],
            tuple[Sequence[float], Sequence[float], Sequence[float]] | None,
        ],
        run: tuple[int, int | None, str | None],
    ) -> tuple[
        FloatArray,
        FloatArray,
        FloatArray,
        FloatArray,
        FloatArray,
        FloatArray,
        npt.NDArray[np.uint32],
        npt.NDArray[np.bool_],
        npt.NDArray[np.bool_],
        list[str],
        tuple[list[str], list[str]],
        tuple[FloatArray, FloatArray],
    ]: ...

class Start:
    """What an episode starts from in place of what it would draw."""

    def __init__(
        self,
        mode: str,
        state: Mapping[str, float] | FloatArray | None,
        discrete: Mapping[str, float],
        parameters: Mapping[str, float],
        disturbances: Mapping[str, FloatArray],
        held: Sequence[str],
        disturbance_seed: int | None = None,
    ) -> None: ...

class Snapshot:
    """All that an environment would go on from."""

    def __init__(self, data: bytes) -> None: ...
    def to_bytes(self) -> bytes: ...

Info = dict[str, object]

class Env:
    """One environment."""

    def __init__(
        self,
        model: Model,
        normalize: bool | str,
        dense_reward: bool,
        info_state: bool,
        max_steps: int | None,
        method: str | None,
    ) -> None: ...
    def reset(self, seed: int | None, start: Start | None) -> tuple[Observation, Info]: ...
    def step(self, action: npt.ArrayLike) -> tuple[Observation, float, bool, bool, Info]: ...
    def values(self, role: Role) -> FloatArray: ...
    def policy(self, name: str) -> FloatArray: ...
    time: float
    steps: int
    max_steps: int
    # Cause of the last step's failure, see `Rollout.failure_kind`, and the name of a declared one.
    failure_kind: str
    failure_name: str
    steady_state: FloatArray | None
    steady_action: FloatArray | None
    constraint_names: list[str]
    solver_statistics: dict[str, int]
    # Seed and number of the episode.
    episode: tuple[int, int]
    def snapshot(self) -> Snapshot: ...
    def restore(self, snapshot: Snapshot) -> None: ...

# time, success, failure, constraints (names first), cost, rewards (names first), state, phase
BatchInfo = tuple[
    FloatArray,
    BoolArray,
    list[str] | None,
    FloatArray,
    FloatArray,
    FloatArray,
    FloatArray | None,
    list[int] | None,
    list[str] | None,
]

class Batch:
    """Environments of one model, stepped together by threads."""

    def __init__(
        self,
        model: Model,
        num_envs: int,
        normalize: bool | str,
        dense_reward: bool,
        info_state: bool,
        max_steps: int | None,
        method: str | None,
        num_threads: int,
        autoreset: str,
    ) -> None: ...
    constraint_names: list[str]
    def reset(
        self, mask: BoolArray, seeds: Sequence[int | None] | None, start: Start | None
    ) -> tuple[Observation, BatchInfo]: ...
    def step(
        self, actions: FloatArray
    ) -> tuple[
        Observation, FloatArray, BoolArray, BoolArray, BatchInfo, tuple[BoolArray, Observation, BatchInfo] | None
    ]: ...
    def values(self, role: Role) -> FloatArray: ...
    def policy(self, name: str) -> FloatArray: ...
    def snapshot(self) -> list[tuple[Snapshot, bool]]: ...
    def restore(self, snapshots: list[tuple[Snapshot, bool]]) -> None: ...

def main(arguments: Sequence[str]) -> int: ...
def on_steps(
    times: FloatArray, values: FloatArray, step: float, linear: bool, end: float | None, most: int
) -> tuple[list[float], int | None]: ...

class Picture:
    """A picture of an episode or of saved runs; it shows itself in a notebook."""

    names: list[str]
    def svg(self) -> str: ...
    def html(self) -> str: ...
    def png(self) -> bytes: ...
    def rgb(self, scale: float = 1.0) -> npt.NDArray[np.uint8]: ...
    def save(self, path: str | PathLike[str]) -> None: ...
    def _repr_svg_(self) -> str: ...
    def _repr_html_(self) -> str: ...

class Recording:
    """The rows of an episode."""

    def __init__(self, env: Env) -> None: ...
    def add(self, env: Env) -> None: ...
    def go_back(self, env: Env) -> bool: ...
    def picture(self, show: Sequence[str], note: str) -> Picture: ...
    def save(self, path: str | PathLike[str]) -> None: ...

def picture_of_tables(paths: Sequence[PathLike[str]], show: Sequence[str], model: Model | None) -> Picture: ...
def nominal_picture(model: Model, show: Sequence[str], most_steps: int) -> Picture: ...
