"""Models in the form of other tools.

    import smpl
    model = smpl.compile("reactor")
    functions = smpl.export.casadi(model)
    tree = smpl.export.json(model)

`text` and `write` give the files that `smpl export` writes; the other functions build what the
target is made of. docs/export.md describes each form.
"""

from __future__ import annotations

from smpl.export.files import fmu, json, text, write
from smpl.export.modules import CasadiModel, JaxModel, casadi, jax
from smpl.export.parts import CasadiPart
from smpl.export.predictive import do_mpc

__all__ = ["CasadiModel", "CasadiPart", "JaxModel", "casadi", "do_mpc", "fmu", "jax", "json", "text", "write"]
