"""The benchmark, which is another project: `python/benchmarks` of the repository."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path


def find_benchmarks(as_command: bool) -> None:
    """Make `smpl_benchmarks` importable, from an installation or from the checkout of this package.

    Raises:
        ImportError: it is not found.
        SystemExit: the same for a command, with the message.
    """
    folder = Path(__file__).resolve().parents[2] / "benchmarks"
    if (folder / "smpl_benchmarks").is_dir():
        if str(folder) not in sys.path:
            sys.path.append(str(folder))
    elif importlib.util.find_spec("smpl_benchmarks") is None:
        text = (
            "the benchmark is not part of this installation: run the command from a checkout of the repository, or "
            "install `python/benchmarks` of the repository with pip"
        )
        if as_command:
            raise SystemExit(f"error: {text}")
        raise ImportError(text)
