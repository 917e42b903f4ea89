"""Former names of modules."""

from __future__ import annotations

import importlib
import sys
import warnings


def moved(former: str, name: str) -> None:
    """Let a module be found under its former name, with a warning."""
    warnings.warn(f"the module {former} is deprecated, use {name}", DeprecationWarning, stacklevel=3)
    sys.modules[former] = importlib.import_module(name)
