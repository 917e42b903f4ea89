"""Files of policies: those of learning packages, and those that `smpl export-policy` writes."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.controllers import NMPC
from smpl.controllers.full_information import Deferred
from smpl.support.optional import load

Array = npt.NDArray[Any]


def load_policy(spec: str) -> Any:
    """The policy of a file.

    `PPO:FILE.zip` of Stable-Baselines3, `FILE.d3` of d3rlpy, `FILE.pt` of TorchScript, `FILE.json`
    of a tuned predictive controller, and what `smpl export-policy` writes: `FILE.c`, `FILE.onnx`,
    `FILE.fmu`.

    Raises:
        ValueError: the file is missing, cannot be read, or its algorithm is not named.
        ImportError: its package is missing.
    """
    algorithm, _, file = spec.rpartition(":")
    if not Path(file).is_file():
        raise ValueError(f"policy file {file!r} is not there")
    return FILES[Path(file).suffix](algorithm, file)


def _stable_baselines(algorithm: str, file: str) -> Any:
    if not algorithm:
        raise ValueError(f"which algorithm made {file!r}? Write it before the file, as in PPO:{file}")
    _needs("stable_baselines3")
    for package in ("stable_baselines3", "sb3_contrib"):
        try:
            found = getattr(importlib.import_module(package), algorithm, None)
        except ImportError:
            continue
        if found is not None:
            with _of_file(file, algorithm):
                return found.load(file, device="cpu")
    raise ValueError(f"algorithm {algorithm!r} is not in stable-baselines3 or sb3-contrib (is that installed?)")


def _d3rlpy(_: str, file: str) -> Any:
    d3rlpy = _needs("d3rlpy")
    with _of_file(file, "d3rlpy"):
        return d3rlpy.load_learnable(file)


def _torchscript(_: str, file: str) -> Any:
    torch = _needs("torch")
    with of_torchscript(), _of_file(file, "TorchScript"):
        return _TorchPolicy(torch.jit.load(file).eval())


def _exported(_: str, file: str) -> Any:
    from smpl.deploy.artefact import load_artefact

    return load_artefact(file)


def _predictive(_: str, file: str) -> Any:
    """The predictive controller of options and learned values."""
    with _of_file(file, "a predictive controller"):
        content = json.loads(Path(file).read_text(encoding="utf-8"))
        options, values = dict(content["nmpc"]), dict(content["values"])
    return Deferred(lambda env: _adjusted(env, options, values))


def _adjusted(env: Any, options: dict[str, Any], values: dict[str, float]) -> Any:
    controller = NMPC(env, **options)
    controller.adjust(values)
    return controller


# File formats by their endings: those in which policies are trained, and exported ones.
TRAINED: dict[str, Callable[[str, str], Any]] = {".zip": _stable_baselines, ".d3": _d3rlpy, ".pt": _torchscript}
FILES = TRAINED | {".json": _predictive} | dict.fromkeys((".c", ".onnx", ".fmu"), _exported)


@contextlib.contextmanager
def _of_file(file: str, what: str) -> Iterator[None]:
    """Name the file where a package cannot read it, whatever it raises then."""
    try:
        yield
    except ImportError:
        raise
    except Exception as error:
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise ValueError(f"policy file {file!r} cannot be read as one of {what}: {reason}") from error


@contextlib.contextmanager
def of_torchscript() -> Iterator[None]:
    """Suppresses deprecation warnings of TorchScript, which all pinned versions read."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"`torch\.jit\.", FutureWarning)
        yield


class _TorchPolicy:
    """A TorchScript module that maps a batch of observations to actions."""

    def __init__(self, module: Any) -> None:
        self._module = module

    def predict(self, observations: Array) -> Array:
        torch = importlib.import_module("torch")
        with torch.no_grad():
            return np.asarray(self._module(torch.as_tensor(observations)).numpy())


def _needs(module: str) -> Any:
    # The gym that d3rlpy imports, and Stable-Baselines3 where it is there, greets with a banner.
    with contextlib.redirect_stderr(io.StringIO()):
        return load(module, "this policy")
