"""smpl: compiled process models in a declarative language, as Gymnasium environments.

    import gymnasium, smpl
    env = gymnasium.make("smpl/Reactor-v0")

Importing the package registers the environments. `smpl.compile` makes a model of any `.eq` file and
`smpl.Env(model)` an environment of it.
"""

import importlib
from types import ModuleType
from typing import Any

from smpl._native import CompileError, Diagnostic, ScenarioError, SimulationError, __version__
from smpl.analysis.fitting import Fit, fit
from smpl.analysis.least_squares import FitOptions
from smpl.envs import Env
from smpl.model import CompileWarning, Model, compile
from smpl.notebooks.live import Live, live
from smpl.pictures import Picture, plot
from smpl.registry import register_envs
from smpl.support.files import announce_library
from smpl.support.foreign import check as _check_foreign
from smpl.support.hints import of_attribute
from smpl.vector import VectorEnv, make_vec

__all__ = [
    "CompileError",
    "CompileWarning",
    "Diagnostic",
    "Env",
    "Fit",
    "FitOptions",
    "Live",
    "Model",
    "Picture",
    "ScenarioError",
    "SimulationError",
    "VectorEnv",
    "__version__",
    "compile",
    "fit",
    "live",
    "make_vec",
    "plot",
    "register_envs",
]

_LAZY = (
    "analysis", "controllers", "cuda", "datasets", "deploy", "evaluation", "export", "jax", "learning", "optimize",
    "policies", "sb3", "torch", "wrappers",
)  # fmt: skip


def __getattr__(name: str) -> ModuleType:
    """Loads parts of the package at their first use."""
    if name in _LAZY:
        return importlib.import_module(f"smpl.{name}")
    hint = of_attribute("smpl", name, (*__all__, *_LAZY))
    raise AttributeError(f"module 'smpl' has no attribute {name!r}{hint and f'; {hint}'}", name=name)


def load_ipython_extension(shell: Any) -> None:
    """Adds the cell magic `%%smpl NAME`, which checks, binds and shows a model."""
    from smpl.notebooks.magic import load

    load(shell)


_check_foreign()
announce_library()
register_envs()
