"""Models exported as C, compiled: what other exports are compared with.

runtime/tests/exports.rs compares it with the machine code.
"""

import ctypes
import re
import subprocess

import numpy as np

import smpl

VECTORS = ("y", "yp", "u", "p", "c", "w", "out")


class Library:
    """The functions of an exported model by name, on NumPy vectors."""

    def __init__(self, model, folder):
        source, header = smpl.export.write(model, "c", folder / "exported.c")
        done = subprocess.run(
            ["cc", "-std=c99", "-O0", "-shared", "-fPIC", "-o", "exported.so", source.name, "-lm"],
            cwd=folder,
            capture_output=True,
        )
        assert done.returncode == 0, done.stderr.decode()
        self.code = ctypes.CDLL(str(folder / "exported.so"))
        text = header.read_text()
        self.sizes = {name: int(n) for name, n in re.findall(r"#define EXPORTED_(\w+) (\d+)", text)}
        self.arguments = {
            name: re.findall(r"\w+(?=[,)])", arguments)
            for name, arguments in re.findall(r"void exported_(\w+)(\([^;]*\));", text)
        }

    def is_update(self, name):
        return "out" not in self.arguments[name]

    def __call__(self, name, t, y, yp, u, p, c, cj=0.0):
        """The output of a function, or for an update the changed y and p."""
        work = np.zeros(self.sizes["WORK"] + 1)
        vectors = {"y": y.copy(), "yp": yp, "u": u, "p": p.copy(), "c": c, "w": work}
        size = {"RESIDUAL": "UNKNOWNS", "RATES": "STATES", "JACOBIAN": "NONZEROS"}.get(name.upper(), name.upper())
        vectors["out"] = np.full(self.sizes.get(size, 0), np.nan)
        vectors = {key: np.ascontiguousarray(value, dtype=float) for key, value in vectors.items()}
        self._call("prepare", vectors, t, cj)
        self._call(name, vectors, t, cj)
        return (vectors["y"], vectors["p"]) if self.is_update(name) else vectors["out"]

    def _call(self, name, vectors, t, cj):
        scalars = {"t": t, "cj": cj}
        getattr(self.code, f"exported_{name}")(
            *(
                ctypes.c_double(scalars[argument])
                if argument in scalars
                else ctypes.c_void_p(vectors[argument].ctypes.data)
                for argument in self.arguments[name]
            )
        )
