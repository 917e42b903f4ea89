"""Optional packages: their import, and the message where one is missing."""

from __future__ import annotations

import importlib
from typing import Any

# Name and requirement of a module where they differ from the module's own name.
_PACKAGES = {
    "casadi": ("CasADi", "casadi"),
    "do_mpc": ("do-mpc", "do-mpc"),
    # d3rlpy 2.8.1 pins gymnasium 1.0.0.
    "d3rlpy": ("d3rlpy", "'d3rlpy!=2.8.1'"),
    "jax": ("JAX", "jax"),
    "matplotlib": ("Matplotlib", "matplotlib"),
    "minari": ("Minari", "minari h5py"),
    "onnx": ("ONNX", "onnx"),
    "onnxruntime": ("ONNX Runtime", "onnxruntime"),
    "optuna": ("Optuna", "optuna"),
    "ray": ("Ray", "ray"),
    "ray.rllib": ("RLlib", "'ray[rllib]' torch"),
    "sb3_contrib": ("sb3-contrib", "sb3-contrib"),
    "scipy": ("SciPy", "scipy"),
    "sklearn": ("scikit-learn", "scikit-learn"),
    "stable_baselines3": ("Stable-Baselines3", "stable-baselines3"),
    "torch": ("PyTorch", "torch"),
    "yaml": ("PyYAML", "pyyaml"),
}


def load(module: str, purpose: str) -> Any:
    """Import a module of an optional package.

    Args:
        module: its name, with dots where a part of a package is needed.
        purpose: subject of the message, such as "predictive control".

    Returns:
        The module.

    Raises:
        ImportError: the package is missing, and the message has the command that installs it; or it
            cannot be imported.

    Example:
        >>> load("math", "this example").sqrt(4.0)
        2.0
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        name = _entry(module)[0]
        if (error.name or "").partition(".")[0] != package:
            raise ImportError(f"{purpose} needs {name}, which cannot be imported: {error}", name=error.name) from error
        raise ImportError(f"{purpose} needs {name}: {install(module)}", name=package) from error


def install(module: str) -> str:
    """The command that installs the package of a module.

    Example:
        >>> install("sklearn")
        'pip install scikit-learn'
    """
    return f"pip install {_entry(module)[1]}"


def _entry(module: str) -> tuple[str, str]:
    package = module.partition(".")[0]
    return _PACKAGES.get(module) or _PACKAGES.get(package, (package, package))
