"""Analytic policy gradient with short horizons and a value function, `SHAC` (extra `torch`).

J. Xu, V. Makoviychuk, Y. Narang, F. Ramos, W. Matusik, A. Garg, M. Macklin, Accelerated policy
learning with parallel differentiable simulation, ICLR 2022. The policy ascends the exact gradient
of the rewards of a window plus the value of its last state. The value is fitted to returns of
TD(lambda), computed with a target that follows it slowly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from smpl.learning.environments import Curriculum, FormulatedVectorEnv
from smpl.learning.formulation import Formulation
from smpl.learning.plan import Task
from smpl.learning.policy_files import of_torchscript
from smpl.support.arguments import FloatArray
from smpl.support.optional import load
from smpl.vector import AutoresetMode
from smpl_benchmarks.hyperparameters import Checked
from smpl_benchmarks.windows import Piece, Window, collect, pieces

NAME = "SHAC"
Tensor = Any
# Most steps of the episodes that scale the observations of networks, and the least deviation.
_STATISTICS, _LEAST = 200, 0.01


@dataclass(frozen=True)
class Hyperparameters(Checked):
    """Hyperparameters of `SHAC`.

    Attributes:
        horizon: steps of a window.
        gamma, gae_lambda: discount of a step, and lambda of the returns for the value.
        actor_rate, critic_rate: learning rates at the beginning; they fall linearly to a tenth.
        hidden: units of both hidden layers.
        log_std_init: logarithm of the standard deviation of actions before `tanh`.
        critic_epochs, critic_batches: passes over a window for the value, and their batches.
        target: share of the target that stays in an update.
        max_grad_norm: largest norm of a gradient.
        num_envs: environments of the batch; those of the suite if 0.
    """

    NAME: ClassVar[str] = NAME
    COUNTS: ClassVar[tuple[str, ...]] = ("horizon", "hidden", "critic_epochs", "critic_batches")

    horizon: int = 16
    gamma: float = 0.99
    gae_lambda: float = 0.95
    actor_rate: float = 2e-3
    critic_rate: float = 2e-3
    hidden: int = 64
    log_std_init: float = -1.0
    critic_epochs: int = 16
    critic_batches: int = 4
    target: float = 0.2
    max_grad_norm: float = 1.0
    num_envs: int = 0


class ShortHorizonTrainer:
    """The algorithm `SHAC` on a native batch.

    Args:
        task: the environment.
        formulation: as the learner sees it.
        hyperparameters: see `Hyperparameters`.
        num_envs: environments of the native batch.
        curriculum: parameters that move with training.

    Raises:
        ImportError: PyTorch is missing.
        ValueError: an unknown hyperparameter, or a formulation with a history.
        NotImplementedError: the centre of the formulation asks the running model.
    """

    def __init__(
        self,
        task: Task,
        formulation: Formulation,
        hyperparameters: Mapping[str, Any],
        num_envs: int,
        curriculum: Mapping[str, Any] | None = None,
    ) -> None:
        self._torch = load("torch", NAME)
        self.hyper = Hyperparameters.of(hyperparameters)
        if formulation.history != 1:
            raise ValueError(f"history is {formulation.history}, expected 1: {NAME} derives by one observation")
        self._formulation = formulation
        self.batch = FormulatedVectorEnv(
            task.model, self.hyper.num_envs or num_envs, formulation=formulation,
            curriculum=Curriculum(curriculum) if curriculum else None,
            autoreset_mode=AutoresetMode.SAME_STEP, **task.arguments,
        )  # fmt: skip
        if self.batch.form.needs == "model":
            raise NotImplementedError(
                f"centre is {formulation.centre!r}, a policy that asks the running model: {NAME} derives by centres "
                "that are functions of states or observations"
            )
        self._nets: dict[str, Any] = {}
        self._optimisers: dict[str, Any] = {}

    def begin(self, seed: int) -> None:
        """Make a new learner."""
        torch, hyper = self._torch, self.hyper
        torch.manual_seed(seed % 2**31)
        inputs, learned = len(self.batch.observation_names), len(self.batch.form.learned)
        actor, critic, target = (_network(torch, inputs, hyper.hidden, size) for size in (learned, 1, 1))
        with torch.no_grad():
            actor[-1].weight.mul_(0.01)
            actor[-1].bias.zero_()
        mean, deviation = self._seen(seed)
        for one in (actor, critic):
            _standardise(torch, one[0], mean, deviation)
        target.load_state_dict(critic.state_dict())
        spread = torch.nn.ParameterList([torch.full((learned,), hyper.log_std_init, dtype=torch.float64)])
        self._nets = {"actor": actor, "spread": spread, "critic": critic, "target": target}
        rates = {"actor": hyper.actor_rate, "critic": hyper.critic_rate}
        self._optimisers = {
            name: torch.optim.Adam(self._trained(name), rate, betas=(0.7, 0.95)) for name, rate in rates.items()
        }

    def _trained(self, name: str) -> list[Tensor]:
        """Parameters of the actor or the critic that are trained."""
        parts = [self._nets["actor"], self._nets["spread"]] if name == "actor" else [self._nets["critic"]]
        return [one for part in parts for one in part.parameters() if one.requires_grad]

    def _seen(self, seed: int) -> tuple[FloatArray, FloatArray]:
        """Mean and deviation of observations under random actions near the centre."""
        generator = np.random.default_rng([seed, 8])
        seen, _ = self.batch.reset(seed=seed)
        rows = [seen]
        for _ in range(min(self.batch.model.max_steps, _STATISTICS)):
            rows.append(self.batch.step(0.3 * generator.uniform(-1, 1, self.batch.action_space.shape))[0])
        every = np.concatenate(rows).astype(np.float64)
        return every.mean(axis=0), np.maximum(every.std(axis=0), _LEAST)

    def load(self, folder: Path) -> None:
        """Make the learner of a checkpoint."""
        self.begin(0)
        found = self._torch.load(folder / "learner.pt", weights_only=True)
        for name, one in {**self._nets, **self._optimisers_by_name()}.items():
            one.load_state_dict(found[name])

    def save(self, folder: Path) -> None:
        """Write networks and optimisers."""
        every = {**self._nets, **self._optimisers_by_name()}
        self._torch.save({name: one.state_dict() for name, one in every.items()}, folder / "learner.pt")

    def _optimisers_by_name(self) -> dict[str, Any]:
        return {f"optimiser {name}": one for name, one in self._optimisers.items()}

    def export(self, folder: Path) -> str:
        """Write the policy without exploration, and its formulation."""
        torch = self._torch
        mean = torch.nn.Sequential(*self._nets["actor"], torch.nn.Tanh())
        copy = _network(torch, mean[0].in_features, self.hyper.hidden, mean[-2].out_features, torch.nn.Tanh())
        copy.load_state_dict(mean.state_dict())
        with of_torchscript():
            torch.jit.script(copy.float()).save(str(folder / "policy.pt"))
        self._formulation.write(folder)
        return "policy.pt"

    def train(self, steps: int, seed: int, progress: float) -> None:
        """Go on by steps of the process, with new episodes."""
        torch, hyper = self._torch, self.hyper
        torch.manual_seed(seed % 2**31)
        for name, rate in (("actor", hyper.actor_rate), ("critic", hyper.critic_rate)):
            for group in self._optimisers[name].param_groups:
                group["lr"] = rate * (1 - 0.9 * progress)
        self.batch.progress = progress
        seen, _ = self.batch.reset(seed=seed)
        size = hyper.horizon, self.batch.num_envs, len(self.batch.form.learned)
        for _ in range(max(1, round(steps / (hyper.horizon * self.batch.num_envs)))):
            noise = torch.randn(*size, dtype=torch.float64)
            window = self.window(seen, noise)
            self._ascend(window, noise)
            self._fit(window)
            seen = self.batch.form.observe(self.batch.rows.memory, self.batch.rows.observations)

    def window(self, seen: Any, noise: Tensor) -> Window:
        """A window of the batch with the present policy."""
        torch = self._torch

        def act(observations: Any, step: int) -> FloatArray:
            with torch.no_grad():
                chosen = self._act(torch.as_tensor(np.asarray(observations, dtype=np.float64)), noise[step])
            return np.asarray(chosen.numpy(), dtype=np.float64)

        return collect(self.batch, seen, act, self.hyper.horizon)

    def _act(self, seen: Tensor, noise: Tensor) -> Tensor:
        spread = next(iter(self._nets["spread"]))
        return self._torch.tanh(self._nets["actor"](seen) + noise * spread.exp())

    def objective(self, window: Window, noise: Tensor) -> Tensor:
        """Discounted rewards of a window and the value of its end, a mean over environments."""
        parts = pieces(window, self.batch)
        total = self._torch.zeros((), dtype=self._torch.float64)
        for one in parts:
            total = total + self._piece(one, noise[one.first :, one.places]).sum()
        return total / self.batch.num_envs

    def _piece(self, piece: Piece, noise: Tensor) -> Tensor:
        """Values of the environments of a piece, with derivatives by the policy."""
        torch = self._torch
        seen, seen_by, rewards, rewards_by, actions, moved, centred = (
            torch.as_tensor(one)
            for one in (
                *(piece.seen, piece.seen_by, piece.rewards, piece.rewards_by),
                *(piece.actions, piece.moved, piece.centred),
            )
        )
        count, length = moved.shape[:2]
        shifts: list[Tensor] = []
        value = torch.zeros(count, dtype=torch.float64)

        def along(by: Tensor, base: Tensor) -> Tensor:
            """A quantity at what has been chosen so far, which is its value."""
            if not shifts:
                return base
            before = torch.cat(shifts, dim=-1)
            return base + (by[..., : before.shape[-1]] @ before.unsqueeze(-1)).squeeze(-1)

        for step in range(length):
            chosen = self._act(along(seen_by[:, step], seen[:, step]), noise[step])
            own = (moved[:, step] @ (chosen - actions[:, step]).unsqueeze(-1)).squeeze(-1)
            shifts.append(along(centred[:, step], own))
            earned = along(rewards_by[:, step].unsqueeze(-2), rewards[:, step, None])
            value = value + self.hyper.gamma**step * earned[:, 0]
        end = self._nets["target"](along(seen_by[:, length], seen[:, length]))[:, 0]
        return value + self.hyper.gamma**length * end

    def _ascend(self, window: Window, noise: Tensor) -> None:
        optimiser = self._optimisers["actor"]
        optimiser.zero_grad()
        value = self.objective(window, noise)
        # A window may consist of ends of episodes alone.
        if value.requires_grad:
            (-value / self.hyper.horizon).backward()
            self._step("actor")

    def _step(self, name: str) -> None:
        norm = self._torch.nn.utils.clip_grad_norm_(self._trained(name), self.hyper.max_grad_norm)
        if not bool(norm.isfinite()):
            raise ValueError(f"the gradient of the {name} is not finite")
        self._optimisers[name].step()

    def returns(self, window: Window) -> FloatArray:
        """Returns of TD(lambda) at each step, by the target of the value."""
        torch, hyper = self._torch, self.hyper
        with torch.no_grad():
            ahead = self._nets["target"](torch.as_tensor(window.following))[..., 0].numpy()
        ahead = np.where(window.terminated, 0.0, ahead)
        found = np.empty_like(window.rewards, dtype=np.float64)
        later = ahead[-1]
        for step in reversed(range(len(found))):
            mixed = (1 - hyper.gae_lambda) * ahead[step] + hyper.gae_lambda * later
            found[step] = window.rewards[step] + hyper.gamma * np.where(window.done[step], ahead[step], mixed)
            later = found[step]
        return found

    def _fit(self, window: Window) -> None:
        """Fit the value, and move its target."""
        torch, hyper, critic = self._torch, self.hyper, self._nets["critic"]
        seen = torch.as_tensor(window.seen.reshape(-1, window.seen.shape[-1]))
        wanted = torch.as_tensor(self.returns(window).reshape(-1))
        for _ in range(hyper.critic_epochs):
            for rows in torch.randperm(len(seen)).chunk(hyper.critic_batches):
                self._optimisers["critic"].zero_grad()
                (critic(seen[rows])[:, 0] - wanted[rows]).square().mean().backward()
                self._step("critic")
        with torch.no_grad():
            for old, new in zip(self._nets["target"].parameters(), critic.parameters(), strict=True):
                old.mul_(hyper.target).add_((1 - hyper.target) * new)


def _network(torch: Any, inputs: int, hidden: int, outputs: int, *last: Any) -> Any:
    """Two hidden layers in double precision, behind a fixed layer that scales observations."""
    layers = (
        torch.nn.Linear(inputs, inputs),
        torch.nn.Linear(inputs, hidden),
        torch.nn.ELU(),
        torch.nn.Linear(hidden, hidden),
        torch.nn.ELU(),
    )
    return torch.nn.Sequential(*layers, torch.nn.Linear(hidden, outputs), *last).double()


def _standardise(torch: Any, layer: Any, mean: FloatArray, deviation: FloatArray) -> None:
    """Make a layer subtract a mean and divide by a deviation; it is not trained."""
    with torch.no_grad():
        layer.weight.copy_(torch.diag(torch.as_tensor(1 / deviation)))
        layer.bias.copy_(torch.as_tensor(-mean / deviation))
    for one in layer.parameters():
        one.requires_grad_(False)
