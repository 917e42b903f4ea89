"""Policies outside of Python: export to C, ONNX and FMI 3, loading, and replay of recorded scores.

    import smpl
    smpl.deploy.export_policy("lqr", "reactor", "c", "lqr.c")
    controller = smpl.deploy.load_artefact("lqr.c", smpl.Env("reactor"))

docs/export.md describes the forms; the commands are `smpl export-policy` and `smpl verify`.
"""

from __future__ import annotations

import importlib
from typing import Any

from smpl.deploy.artefact import Artefact, load_artefact
from smpl.deploy.contract import Contract, Signal, model_hash

__all__ = ["TARGETS", "Artefact", "Contract", "Signal", "export_policy", "load_artefact", "model_hash"]


def __getattr__(name: str) -> Any:
    """Load the export at its first use: it needs the controllers, which read exported files."""
    if name in ("TARGETS", "export_policy"):
        return getattr(importlib.import_module("smpl.deploy.export"), name)
    raise AttributeError(f"module 'smpl.deploy' has no attribute {name!r}", name=name)
