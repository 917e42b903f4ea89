"""Online learning by Stable-Baselines3 and sb3-contrib on the native batch (extra `sb3`)."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

from smpl.learning.environments import Curriculum, FormulatedVectorEnv
from smpl.learning.formulation import Formulation
from smpl.learning.plan import Task
from smpl.support.arguments import check_numbers
from smpl.vector import AutoresetMode
from smpl_benchmarks.offline import needs

# Algorithms of sb3-contrib, and policies that are not the usual `MlpPolicy`.
CONTRIB = ("ARS", "TQC", "CrossQ", "RecurrentPPO")
_POLICIES = {"ARS": "LinearPolicy", "RecurrentPPO": "MlpLstmPolicy"}


class StableBaselinesTrainer:
    """An algorithm of Stable-Baselines3 or sb3-contrib.

    Args:
        algorithm: name of its class (`PPO`).
        task: the environment.
        formulation: as the learner sees it.
        hyperparameters: of the class.
        num_envs: environments of the native batch.
        curriculum: parameters that move with training.

    Raises:
        ImportError: the package is missing.
        ValueError: an unknown algorithm or hyperparameter.
    """

    def __init__(
        self,
        algorithm: str,
        task: Task,
        formulation: Formulation,
        hyperparameters: Mapping[str, Any],
        num_envs: int,
        curriculum: Mapping[str, Any] | None = None,
    ) -> None:
        package = needs("sb3_contrib" if algorithm in CONTRIB else "stable_baselines3")
        self._class: Any = getattr(package, algorithm, None)
        if self._class is None:
            raise ValueError(f"algorithm is {algorithm!r}, which {package.__name__} does not have")
        known = inspect.signature(self._class).parameters
        unknown = [name for name in hyperparameters if name not in known]
        if unknown:
            raise ValueError(f"{algorithm} has no hyperparameter {', '.join(unknown)}; there are: {', '.join(known)}")
        check_numbers(algorithm, hyperparameters, {name: one.default for name, one in known.items()})
        self.algorithm, self._formulation = algorithm, formulation
        self._hyper = {"policy": _POLICIES.get(algorithm, "MlpPolicy"), **hyperparameters}
        self.venv = FormulatedVectorEnv(
            task.model, num_envs, formulation=formulation, curriculum=Curriculum(curriculum) if curriculum else None,
            autoreset_mode=AutoresetMode.SAME_STEP, **task.arguments,
        )  # fmt: skip
        self._model: Any = None

    def begin(self, seed: int) -> None:
        """Make a new learner."""
        # A package may write into what it is given, as CrossQ does into `policy_kwargs`.
        given = deepcopy(self._hyper)
        self._model = self._class(env=self._environment(), seed=seed % 2**31, device="cpu", **given)

    def load(self, folder: Path) -> None:
        """Make the learner of a checkpoint."""
        self._model = self._class.load(folder / "model.zip", env=self._environment(), device="cpu")
        if (folder / "replay.pkl").is_file():
            self._model.load_replay_buffer(folder / "replay.pkl")

    def train(self, steps: int, seed: int, progress: float) -> None:
        """Go on by steps of the process, with new episodes."""
        self.venv.progress = progress
        self._model.set_random_seed(seed)
        self._model.learn(steps, reset_num_timesteps=False)

    def save(self, folder: Path) -> None:
        """Write networks, optimisers and what is there to replay."""
        self._model.save(folder / "model.zip")
        if getattr(self._model, "replay_buffer", None) is not None:
            self._model.save_replay_buffer(folder / "replay.pkl")

    def export(self, folder: Path) -> str:
        """Write the policy and its formulation."""
        self._model.save(folder / "policy.zip")
        self._formulation.write(folder)
        return f"{self.algorithm}:policy.zip"

    def _environment(self) -> Any:
        from smpl.sb3 import SB3VecEnv

        return SB3VecEnv(self.venv)
