"""Many instances of a model on a GPU, one thread each (experimental).

The text that `smpl export --to kernel` writes holds the equations, Rodas5P and the events of a
model. On a GPU the package `cupy` compiles it with NVRTC; on the processor the C compiler `cc`
compiles the same text, which is how it is tested.

    import smpl
    import smpl.cuda

    batch = smpl.cuda.Batch(smpl.compile("reactor"), 4096, device="cpu")
    batch.reset()
    observations, rewards, ended = batch.step(batch.nominal)
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smpl._native import SimulationError
from smpl.export.files import json as _tree
from smpl.export.files import text as _text
from smpl.model import Model

# Threads of a block: each needs much memory.
_THREADS = 64
_LENGTHS = ("memory", "unknowns", "states", "actions", "parameters", "observations", "rewards")


class _Processor:
    """The text as a shared library of C."""

    arrays: Any = np

    def __init__(self, source: str) -> None:
        compiler = os.environ.get("CC", "").strip() or "cc"
        with tempfile.TemporaryDirectory() as folder:
            text, library = Path(folder) / "kernel.c", Path(folder) / "kernel.so"
            text.write_text(source)
            flags = ["-std=c99", "-O2", "-fPIC", "-shared", "-ffp-contract=off"]
            try:
                done = subprocess.run([compiler, *flags, "-o", library, text, "-lm"], capture_output=True, text=True)
            except OSError as error:
                raise RuntimeError(f"the C compiler `{compiler}` does not run: {error}") from error
            if done.returncode != 0:
                raise RuntimeError(f"the C compiler `{compiler}` refuses the kernel: {done.stderr.strip()}")
            self._library = ctypes.CDLL(str(library))

    def call(self, function: str, count: int, *arguments: Any) -> None:
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in arguments]
        self._library[function](ctypes.c_int(count), *pointers)


class _Gpu:
    """The text as a module of CUDA."""

    def __init__(self, source: str) -> None:
        try:
            import cupy
        except ImportError as error:
            raise ImportError("device='cuda' needs the package `cupy`: device='cpu' runs the same text") from error
        self.arrays = cupy
        options = ("--device-as-default-execution-space", "--fmad=false")
        self._module = cupy.RawModule(code=source, backend="nvrtc", options=options)

    def call(self, function: str, count: int, *arguments: Any) -> None:
        blocks = (count + _THREADS - 1) // _THREADS
        self._module.get_function(function)((blocks,), (_THREADS,), (np.int32(count), *arguments))


class Batch:
    """Instances of a model that step together, with the model's tolerance and Rodas5P.

    They start at the nominal start, have no noise and no delay of observations, and an episode has
    no last step: an environment adds these. Failures and successes end an instance, which then
    stays as it is until `reset`.

    Args:
        model: a compiled model; variants and settings are those that it was compiled with.
        count: number of instances.
        device: `cuda`, or `cpu` for the same text compiled as C.
        history: most internal steps that each instance keeps for dead times, `delay(...)`; 500 if
            left out. An instance that needs more has `status` 2.

    Attributes:
        nominal: nominal actions (count, actions), in the units of the model.
        unknowns: states and solved algebraic variables (count, unknowns), on the device.
        status: of each instance (count,), on the device: 0 if it runs, 1 if a failure or a success
            has ended it, 2 if its equations could not be solved.

    Raises:
        ValueError: a model that a kernel cannot carry (derivatives of algebraic variables).
        ImportError: no `cupy` for `cuda`.
        RuntimeError: no C compiler for `cpu`, or one that refuses the text.
    """

    def __init__(self, model: Model, count: int, *, device: str = "cuda", history: int | None = None) -> None:
        if device not in ("cuda", "cpu"):
            raise ValueError(f"device must be `cuda` or `cpu`, not {device!r}")
        if count < 1:
            raise ValueError(f"count must be positive, not {count}")
        source = _text(model, "kernel", history=history)["c"]
        self._device: _Gpu | _Processor = _Gpu(source) if device == "cuda" else _Processor(source)
        self.count = count
        xp = self._device.arrays
        found = xp.zeros(len(_LENGTHS), dtype=np.int64)
        self._device.call("smpl_batch_describe", 1, found)
        self._lengths = dict(zip(_LENGTHS, (int(n) for n in found), strict=True))
        elements = _tree(model)["elements"]
        self._states: list[str] = [element["name"] for element in elements["states"]]
        kept = ("parameters", "discretes", "disturbances")
        self._parameters: list[str] = [element["name"] for group in kept for element in elements[group]]
        self._memory = self._array("memory")
        self.unknowns = self._array("unknowns")
        self._observations, self._rewards = self._array("observations"), self._array("rewards")
        self.status = xp.full(count, 2, dtype=np.int32)
        self.nominal = np.tile(model.action_nominal, (count, 1))

    def reset(
        self,
        which: ArrayLike | None = None,
        *,
        states: Mapping[str, ArrayLike] | None = None,
        parameters: Mapping[str, ArrayLike] | None = None,
    ) -> Any:
        """Begin an episode.

        Args:
            which: instances, as booleans (count,); all if left out.
            states: values by name of an element, one or one per instance, in the units of the
                model; others have the values of the nominal start.
            parameters: likewise, of parameters, discrete variables and disturbances; a disturbance
                that is given stays as it is, the others follow their rules with the median of what
                they draw.

        Returns:
            Observations (count, observations) in physical units, on the device.

        Raises:
            KeyError: an unknown name.
            SimulationError: an instance has no consistent start.
        """
        xp = self._device.arrays
        marks = xp.ones(self.count, dtype=np.int32) if which is None else xp.asarray(which, dtype=bool).astype(np.int32)
        if marks.shape != (self.count,):
            raise ValueError(f"`which` must have the shape ({self.count},), not {marks.shape}")
        starts = self._given("states", self._states, states)
        values = self._given("parameters", self._parameters, parameters)
        arguments = (marks, starts, values, self._memory, self.unknowns, self._observations, self.status)
        self._device.call("smpl_batch_reset", self.count, *arguments)
        failed = xp.flatnonzero((self.status == 2) & (marks != 0))
        if len(failed):
            raise SimulationError(f"instance {int(failed[0])} has no consistent start")
        return self._observations

    def step(self, actions: ArrayLike) -> tuple[Any, Any, Any]:
        """Make a step in every instance that runs.

        Args:
            actions: (count, actions) in the units of the model.

        Returns:
            Observations (count, observations); rewards (count, rewards), with no columns if a
            reward reads an integral over the step; and which instances do not run any more
            (count,). Arrays are of the device, and the next call overwrites them.
        """
        xp = self._device.arrays
        given = xp.ascontiguousarray(xp.asarray(actions, dtype=np.float64))
        if given.shape != (self.count, self._lengths["actions"]):
            raise ValueError(f"actions must have the shape {(self.count, self._lengths['actions'])}, not {given.shape}")
        arguments = (given, self._memory, self.unknowns, self._observations, self._rewards, self.status)
        self._device.call("smpl_batch_step", self.count, *arguments)
        return self._observations, self._rewards, self.status != 0

    def _array(self, what: str) -> Any:
        return self._device.arrays.zeros((self.count, self._lengths[what]), dtype=np.float64)

    def _given(self, what: str, names: list[str], given: Mapping[str, ArrayLike] | None) -> Any:
        values: NDArray[np.float64] = np.full((self.count, self._lengths[what]), np.nan)
        for name, value in (given or {}).items():
            if name not in names:
                raise KeyError(f"{what} have no element `{name}`: {', '.join(names[:8])}, ...")
            values[:, names.index(name)] = value
        return self._device.arrays.asarray(values)
