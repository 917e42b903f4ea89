"""Equations in C, compiled when the benchmark runs: gcc -O3 -march=native."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smpl.support.arguments import FloatArray

HERE = Path(__file__).parent
SUNDIALS = ["-lsundials_ida", "-lsundials_nvecserial", "-lsundials_sunmatrixsparse", "-lsundials_sunlinsolklu", "-lklu"]


class Library:
    """Files of this folder (`timing.c` and so on), compiled as one."""

    def __init__(self, *names: str, flags: Sequence[str] = (), libraries: Sequence[str] = ()) -> None:
        """Compile.

        Args:
            names: files without their endings.
            flags: of the compiler, in addition to -O3 and -march=native.
            libraries: to link.

        Raises:
            OSError: the compiler refuses, for example since a library is missing.
        """
        self._folder = tempfile.TemporaryDirectory()
        source, shared = (Path(self._folder.name) / name for name in ("code.c", "code.so"))
        source.write_text("\n".join((HERE / f"{name}.c").read_text() for name in names))
        command = ["gcc", "-O3", "-march=native", "-shared", "-fPIC", *flags, "-o", str(shared), str(source)]
        done = subprocess.run([*command, *libraries, "-lm"], capture_output=True, text=True)
        if done.returncode != 0:
            raise OSError(done.stderr)
        self.functions = ctypes.CDLL(str(shared))

    def times(self, y: FloatArray, u: FloatArray, nonzeros: int) -> tuple[float, float]:
        """Seconds of a residual and of a Jacobian."""
        self.functions.least_time.restype = ctypes.c_double
        out = np.zeros(max(len(y), nonzeros))
        pointers = [pointer(array) for array in (y, np.zeros_like(y), u, out)]
        if hasattr(self.functions, "prepare"):
            self.functions.prepare(pointers[2])
        residual = float(self.functions.least_time(0, *pointers))
        return residual, float(self.functions.least_time(1, *pointers))

    def residual(self, y: FloatArray, u: FloatArray) -> FloatArray:
        """Residual at y' = 0: the rates."""
        out, zero = np.empty_like(y), np.zeros_like(y)
        if hasattr(self.functions, "prepare"):
            self.functions.prepare(pointer(u))
        self.functions.residual(pointer(y), pointer(zero), pointer(u), pointer(out))
        return out


def pointer(array: NDArray[Any]) -> ctypes.c_void_p:
    """Address of an array, which the caller keeps."""
    return ctypes.c_void_p(array.ctypes.data)


def compiler() -> bool:
    """True if gcc is there; otherwise it is skipped by name."""
    found = shutil.which("gcc") is not None
    if not found:
        print("  C: skipped, gcc is not installed")
    return found
