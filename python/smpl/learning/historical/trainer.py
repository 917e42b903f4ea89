"""MOPO and COMBO for the benchmark: training in the environment `offline`, by files."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from smpl.learning.formulation import Formulation
from smpl.learning.offline import formulated_arrays

ALGORITHMS = ("MOPO", "COMBO")
# Names the folder of the environment.
VARIABLE = "SMPL_OFFLINE_2022"


class HistoricalTrainer:
    """MOPO or COMBO of d3rlpy 1.1.1.

    Args:
        algorithm: which.
        data: the data set, of the environment's own actions.
        formulation: its rewards are used.
        hyperparameters: of the algorithm's class; `dynamics` has those of its model of the process, `dynamics_steps`
            the gradient steps of that.

    Raises:
        ImportError: the environment is not there.
    """

    def __init__(self, algorithm: str, data: Any, formulation: Formulation, hyperparameters: Mapping[str, Any]) -> None:
        self._python = python()
        own = dict(hyperparameters)
        self._request = {
            "algorithm": algorithm,
            "dynamics": own.pop("dynamics", {}),
            "dynamics_steps": own.pop("dynamics_steps", 0),
            "hyperparameters": own,
        }
        self._place = tempfile.TemporaryDirectory()
        self._data = Path(self._place.name) / "data.npz"
        np.savez(self._data, **formulated_arrays(data, formulation))
        self._seed, self._steps, self._before = 0, 0, Path()

    def begin(self, seed: int) -> None:
        """Nothing is there yet."""
        self._before = Path()

    def load(self, folder: Path) -> None:
        """Begin from a checkpoint."""
        self._before = folder.resolve()

    def train(self, steps: int, seed: int, progress: float) -> None:
        """Remember what to do; `save` does it, for that is where the results go."""
        self._steps, self._seed = steps, seed

    def save(self, folder: Path) -> None:
        """Train, and write the checkpoint.

        Raises:
            RuntimeError: training fails; the message has its last words.
        """
        before = str(self._before) if self._before != Path() else None
        request = {
            **self._request, "seed": self._seed, "steps": self._steps, "data": str(self._data), "before": before,
            "after": str(folder.resolve()),
        }  # fmt: skip
        path = Path(self._place.name) / "request.json"
        path.write_text(json.dumps(request), encoding="utf-8")
        script = Path(__file__).with_name("train_offline.py")
        clean = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
        done = subprocess.run(
            [self._python, str(script), str(path)], cwd=self._place.name, env=clean, capture_output=True, text=True
        )
        if done.returncode:
            raise RuntimeError(f"training by d3rlpy 1.1.1 failed: {done.stderr.strip()[-2000:]}")
        self._policy = (folder / "policy.pt").read_bytes()

    def export(self, folder: Path) -> str:
        """Write the policy."""
        (folder / "policy.pt").write_bytes(self._policy)
        return "policy.pt"


def python() -> str:
    """The Python of the environment.

    Raises:
        ImportError: it is not there.
    """
    folder = os.environ.get(VARIABLE)
    found = shutil.which(str(Path(folder) / "bin" / "python")) if folder else None
    if found is None:
        raise ImportError(
            "this algorithm needs d3rlpy 1.1.1 in an environment of its own: "
            f"python -m smpl.learning.historical offline DIR, then {VARIABLE}=DIR"
        )
    return found
