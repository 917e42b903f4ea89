"""Online learning by RLlib on the native batch, by `vector_entry_point` (extra `rllib`)."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

import gymnasium

from smpl.envs import Env
from smpl.learning.environments import Formulated, FormulatedVectorEnv
from smpl.learning.formulation import Formulation
from smpl.learning.plan import Task
from smpl.learning.policy_files import of_torchscript
from smpl.support.arguments import check_numbers
from smpl_benchmarks.offline import needs

ID = "smpl/Formulated-v0"
# Module and class of each configuration.
_CONFIGURATIONS = {
    "RLlib-PPO": ("ray.rllib.algorithms.ppo", "PPOConfig"),
    "RLlib-IMPALA": ("ray.rllib.algorithms.impala", "IMPALAConfig"),
    "RLlib-APPO": ("ray.rllib.algorithms.appo", "APPOConfig"),
    "RLlib-SAC": ("ray.rllib.algorithms.sac", "SACConfig"),
}


def make(formulation: Mapping[str, Any], **arguments: Any) -> gymnasium.Env[Any, Any]:
    """One environment in a formulation; arguments as of `smpl.Env`."""
    return Formulated(Env(**arguments), formulation)


def register() -> None:
    """Register `smpl/Formulated-v0` with Gymnasium, unless it is registered already."""
    if ID not in gymnasium.registry:
        gymnasium.register(
            ID,
            entry_point="smpl_benchmarks.rllib:make",
            vector_entry_point="smpl.learning.environments:FormulatedVectorEnv",
        )


class RLlibTrainer:
    """An algorithm of RLlib, in this process. Repeated runs differ in bits.

    Args:
        algorithm: `RLlib-PPO`, ...
        task: the environment.
        formulation: as the learner sees it.
        hyperparameters: of `AlgorithmConfig.training`.
        num_envs: environments of the native batch.

    Raises:
        ImportError: Ray is missing.
        ValueError: an unknown algorithm or hyperparameter.
    """

    def __init__(
        self,
        algorithm: str,
        task: Task,
        formulation: Formulation,
        hyperparameters: Mapping[str, Any],
        num_envs: int,
    ) -> None:
        if algorithm not in _CONFIGURATIONS:
            raise ValueError(f"algorithm is {algorithm!r}; there are: {', '.join(_CONFIGURATIONS)}")
        needs("ray.rllib")
        self._ray = needs("ray")
        needs("torch")
        module, name = _CONFIGURATIONS[algorithm]
        self._config: Any = getattr(importlib.import_module(module), name)
        known = inspect.signature(self._config.training).parameters
        unknown = [one for one in hyperparameters if one not in known and not hasattr(self._config(), one)]
        if unknown:
            raise ValueError(f"{algorithm} has no hyperparameter {', '.join(unknown)}")
        check_numbers(algorithm, hyperparameters, vars(self._config()))
        self._hyper, self._num_envs, self._formulation = deepcopy(dict(hyperparameters)), num_envs, formulation
        given = {key: value for key, value in task.model._arguments.items() if key != "source" and value}
        given["model"] = given.pop("path")
        self._arguments = {**given, **task.arguments, "formulation": formulation}
        space: Any = FormulatedVectorEnv(num_envs=1, **self._arguments).single_observation_space
        self._width = int(space.shape[0])
        self._algo: Any = None

    def begin(self, seed: int) -> None:
        """Make a new learner."""
        register()
        if not self._ray.is_initialized():
            self._ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
        self._stop()
        mode = gymnasium.VectorizeMode.VECTOR_ENTRY_POINT
        config = (
            self._config()
            .environment(f"smpl_benchmarks.rllib:{ID}", env_config=self._arguments)
            .env_runners(
                num_env_runners=0, num_envs_per_env_runner=self._num_envs, gym_env_vectorize_mode=mode,
                create_local_env_runner=True,
            )
            .learners(num_learners=0)
            .training(**self._hyper)
            .debugging(seed=seed % 2**31, log_level="ERROR")
        )  # fmt: skip
        self._algo = config.build_algo()

    def load(self, folder: Path) -> None:
        """Make the learner of a checkpoint."""
        self.begin(0)
        self._algo.restore_from_path(str(folder.resolve()))

    def train(self, steps: int, seed: int, progress: float) -> None:
        """Go on for at least so many steps of the process."""
        last: int | None = None
        for _ in range(steps):  # an iteration has one step at least
            found = int(self._algo.train()["env_runners"]["num_env_steps_sampled_lifetime"])
            last = found if last is None else last
            if found - last + self._hyper.get("train_batch_size_per_learner", 1) >= steps:
                break

    def save(self, folder: Path) -> None:
        """Write what RLlib keeps."""
        self._algo.save_to_path(str(folder.resolve()))

    def export(self, folder: Path) -> str:
        """Write the mean action as TorchScript, and the formulation."""
        torch = needs("torch")
        module = _Mean(torch, self._algo.get_module()).module.eval()
        example = torch.zeros((2, self._width), dtype=torch.float32)
        with of_torchscript():
            torch.jit.trace(module, example, check_trace=False).save(str(folder / "policy.pt"))
        self._formulation.write(folder)
        return "policy.pt"

    def _stop(self) -> None:
        if self._algo is not None:
            self._algo.stop()
            self._algo = None


class _Mean:
    """The mean of a module's action distribution as a torch module."""

    def __init__(self, torch: Any, module: Any) -> None:
        squashed = "Squashed" in module.get_inference_action_dist_cls().__name__
        base: Any = torch.nn.Module

        class Mean(base):  # type: ignore[misc]
            def __init__(self) -> None:
                super().__init__()
                self.inner = module

            def forward(self, observations: Any) -> Any:
                given = self.inner.forward_inference({"obs": observations})["action_dist_inputs"]
                mean = given[:, : given.shape[1] // 2]
                return torch.tanh(mean) if squashed else mean

        self.module = Mean()
