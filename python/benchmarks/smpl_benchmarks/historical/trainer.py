"""Training in the environments of the paper's time, by files."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from smpl.learning.formulation import Form, Formulation
from smpl.learning.plan import Task
from smpl_benchmarks.offline import formulated_arrays

OFFLINE = ("MOPO", "COMBO")
ONLINE = ("PG-2022", "A3C-2022", "ARS-2022", "DDPG-2022", "IMPALA-2022", "PPO-2022", "SAC-2022")
# Each names the folder of its environment.
_VARIABLES = {"offline": "SMPL_OFFLINE_2022", "online": "SMPL_ONLINE_2022"}


class HistoricalTrainer:
    """An algorithm that runs in another Python.

    Args:
        which: `offline` or `online`.
        request: arguments of its script.
        formulation: written next to the policy, if there is one.

    Raises:
        ImportError: the environment is not there.
    """

    def __init__(self, which: str, request: Mapping[str, Any], formulation: Formulation | None = None) -> None:
        self._which, self._python = which, python(which)
        self._request, self._formulation = dict(request), formulation
        self._place = tempfile.TemporaryDirectory()
        self._seed, self._steps, self._policy = 0, 0, b""
        self._before: Path | None = None

    def begin(self, seed: int) -> None:
        """Nothing is there yet."""
        self._before = None

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
        before = str(self._before) if self._before is not None else None
        request = {
            **self._request, "seed": self._seed, "steps": self._steps, "before": before, "after": str(folder.resolve())
        }  # fmt: skip
        path = Path(self._place.name) / "request.json"
        path.write_text(json.dumps(request), encoding="utf-8")
        script = Path(__file__).with_name(f"train_{self._which}.py")
        done = subprocess.run(
            [self._python, str(script), str(path)], cwd=self._place.name, capture_output=True, text=True
        )
        if done.returncode:
            raise RuntimeError(f"training in {self._python} failed: {done.stderr.strip()[-2000:]}")
        self._policy = (folder / "policy.pt").read_bytes()

    def export(self, folder: Path) -> str:
        """Write the policy, and its formulation."""
        (folder / "policy.pt").write_bytes(self._policy)
        if self._formulation is not None:
            self._formulation.write(folder)
        return "policy.pt"


def offline_trainer(
    algorithm: str,
    data: Any,
    formulation: Formulation,
    hyperparameters: Mapping[str, Any],
    form: Form | None = None,
) -> HistoricalTrainer:
    """MOPO or COMBO of d3rlpy 1.1.1.

    Args:
        algorithm: which.
        data: the data set, of the environment's own actions.
        formulation: its rewards are used.
        hyperparameters: of the algorithm's class; `dynamics` has those of its model of the process,
            `dynamics_steps` the gradient steps of that.
        form: the formulation in the environment of the data, if the policy is to have its
            observations and actions.
    """
    own = dict(hyperparameters)
    request = {
        "algorithm": algorithm,
        "dynamics": own.pop("dynamics", {}),
        "dynamics_steps": own.pop("dynamics_steps", 0),
        "hyperparameters": own,
    }
    made = HistoricalTrainer("offline", request, None if form is None else formulation)
    made._request["data"] = str(Path(made._place.name) / "data.npz")
    np.savez(made._request["data"], **formulated_arrays(data, formulation, form))
    return made


def online_trainer(
    algorithm: str, task: Task, formulation: Formulation, hyperparameters: Mapping[str, Any]
) -> HistoricalTrainer:
    """An algorithm of Ray 2.6.3, on its own single environments."""
    given = {key: value for key, value in task.model._arguments.items() if key != "source" and value}
    given["model"] = str(given.pop("path"))
    arguments = {**given, **task.arguments, "formulation": asdict(formulation)}
    request = {"algorithm": algorithm, "env": arguments, "hyperparameters": dict(hyperparameters)}
    return HistoricalTrainer("online", request, formulation)


def python(which: str) -> str:
    """The Python of an environment.

    Raises:
        ImportError: it is not there.
    """
    variable = _VARIABLES[which]
    folder = os.environ.get(variable)
    found = shutil.which(str(Path(folder) / "bin" / "python")) if folder else None
    if found is None:
        raise ImportError(
            "this algorithm needs a separate environment: "
            f"python -m smpl.benchmark historical {which} DIR, then {variable}=DIR"
        )
    return found
