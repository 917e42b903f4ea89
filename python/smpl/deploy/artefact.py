"""Exported policies as controllers: their contract is checked against the environment."""

from __future__ import annotations

import ctypes
import os
import platform
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from smpl.controllers.base import TakesWrapped
from smpl.deploy.contract import Contract
from smpl.deploy.onnx import KEY
from smpl.envs import Env
from smpl.support.arguments import FloatArray
from smpl.support.optional import load

# Status of an action, as the function in C returns it.
_STATUS = {1: "an input is not finite", 2: "the table of actions has ended"}
Call = Callable[[FloatArray, FloatArray], FloatArray]


class Artefact(TakesWrapped):
    """An exported policy as a controller of an environment.

    Args:
        contract: of the file.
        call: `(input, memory) -> action`; changes the memory.
        where: name of the file.
        any_model: accept another version of the model.

    Attributes:
        contract: names, units and limits of inputs and actions, model and hash.
    """

    def __init__(self, contract: Contract, call: Call, where: str, any_model: bool = False) -> None:
        self.contract, self._call, self._where, self._any_model = contract, call, where, any_model
        self._memory = np.zeros(contract.memory)
        self._places: list[tuple[str, int]] = []

    def reset(self, env: Env) -> None:
        """Begin an episode.

        Raises:
            ValueError: the environment is not the one of the contract; the message names what
                differs.
        """
        self.contract.check(env, self._where, any_model=self._any_model)
        self._memory[:] = 0.0
        self._places = [
            (one.source, getattr(env, f"{one.source}_names").index(one.name)) for one in self.contract.inputs
        ]

    def action(self, env: Env) -> FloatArray:
        """The action for the readings and states of the environment."""
        values = {"observation": lambda: env.reading, "state": lambda: env.state}
        seen = {source: values[source]() for source in {source for source, _ in self._places}}
        return self.act(np.array([seen[source][at] for source, at in self._places]))

    def act(self, inputs: FloatArray) -> FloatArray:
        """The action for inputs in physical units, in the order of the contract.

        Raises:
            ValueError: an input is not finite, or a table has ended.
        """
        return self._call(inputs, self._memory)


def load_artefact(path: str | Path, env: Any = None, *, any_model: bool = False) -> Artefact:
    """An exported policy as a controller.

    Args:
        path: `.c` (compiled with the compiler `cc`, or the one in the environment variable `CC`),
            `.onnx` (needs `onnxruntime`), or `.fmu` with a binary for this machine.
        env: the environment that it is for, checked at once; otherwise at its reset.
        any_model: accept another version of the model with the same names, units and limits.

    Raises:
        ValueError: the file is missing, is not an exported policy, or its contract does not fit the
            environment.
        ImportError: a package is missing.
    """
    file = Path(path)
    if file.suffix not in LOADERS:
        raise ValueError(f"path is {str(path)!r}, expected a file that ends in {', '.join(LOADERS)}")
    if not file.is_file():
        raise ValueError(f"policy file {str(path)!r} is not there")
    found = Artefact(*LOADERS[file.suffix](file), file.name, any_model)
    if env is not None:
        found.contract.check(getattr(env, "unwrapped", env), file.name, any_model=any_model)
    return found


def _of_c(file: Path) -> tuple[Contract, Call]:
    if not file.with_suffix(".h").is_file():
        raise ValueError(f"{file.name} needs {file.stem}.h next to it")
    with tempfile.TemporaryDirectory() as place:
        return _of_library(compiled(file, Path(place)), file.stem, file.name)


def compiled(file: Path, folder: Path) -> Path:
    """The shared library of a C file.

    Raises:
        ValueError: there is no compiler, or it refuses the file.
    """
    library = folder / f"{file.stem}.so"
    compiler = os.environ.get("CC") or "cc"
    flags = ["-std=c99", "-O2", "-fPIC", "-shared", "-ffp-contract=off", "-o", str(library)]
    try:
        done = subprocess.run([compiler, *flags, str(file), "-lm"], capture_output=True, text=True)
    except OSError as error:
        raise ValueError(f"{file.name} needs a C compiler; {compiler} cannot be started: {error}") from error
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if "error" in line] or ["no message"]
        raise ValueError(f"the C compiler {compiler} refuses {file.name}: {lines[0]}")
    return library


def _of_library(library: Path, name: str, where: str) -> tuple[Contract, Call]:
    try:
        loaded = ctypes.CDLL(str(library))
        function = getattr(loaded, f"{name}_action")
        text = ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(loaded, f"{name}_contract")))
    except (OSError, AttributeError, ValueError) as error:
        raise ValueError(f"{where} does not hold a policy exported by smpl: {error}") from error
    contract = Contract.of_text(text.decode(), where)
    pointer = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
    function.argtypes, function.restype = [pointer] * 3, ctypes.c_int

    def call(inputs: FloatArray, memory: FloatArray) -> FloatArray:
        action = np.empty(len(contract.actions))
        status = function(np.ascontiguousarray(inputs, dtype=np.float64), memory, action)
        if status:
            raise ValueError(f"{where}: {_STATUS.get(status, status)}")
        return action

    return contract, call


def _of_fmu(file: Path) -> tuple[Contract, Call]:
    inside = f"binaries/x86_64-linux/{file.stem}.so"
    if not (sys.platform == "linux" and platform.machine() == "x86_64"):
        raise ValueError(f"{file.name}: binaries of exported policies are for Linux on x86-64; use the C source in it")
    with tempfile.TemporaryDirectory() as place:
        try:
            with zipfile.ZipFile(file) as archive:
                names = [one for one in archive.namelist() if one.startswith("binaries/") and one.endswith(".so")]
                library = Path(archive.extract(names[0] if names else inside, place))
        except (KeyError, zipfile.BadZipFile) as error:
            raise ValueError(f"{file.name} is not an FMU with a binary for this machine: {error}") from error
        return _of_library(library, library.stem, file.name)


def _of_onnx(file: Path) -> tuple[Contract, Call]:
    runtime = load("onnxruntime", "an ONNX policy")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        session = runtime.InferenceSession(str(file), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # the runtime has its own exceptions
        raise ValueError(f"{file.name} cannot be read as ONNX: {str(error).splitlines()[0]}") from error
    contract = Contract.of_text(session.get_modelmeta().custom_metadata_map.get(KEY, "{}"), file.name)

    def call(inputs: FloatArray, memory: FloatArray) -> FloatArray:
        if not np.isfinite(inputs).all():
            raise ValueError(f"{file.name}: {_STATUS[1]}")
        given = {"memory": memory[None], **({"input": inputs[None]} if len(inputs) else {})}
        action, after = session.run(["action", "next_memory"], given)
        if np.isnan(action).any():
            raise ValueError(f"{file.name}: {_STATUS[2]}")
        memory[:] = after[0]
        return np.array(action[0])

    return contract, call


# Readers by the ending of the file.
LOADERS: dict[str, Callable[[Path], tuple[Contract, Call]]] = {".c": _of_c, ".onnx": _of_onnx, ".fmu": _of_fmu}
