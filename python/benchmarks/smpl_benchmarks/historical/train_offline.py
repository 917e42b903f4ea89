"""Trains MOPO or COMBO in the environment `offline` (Python 3.9, d3rlpy 1.1.1, no smpl)."""

import argparse
import json
import random
from pathlib import Path

import d3rlpy
import numpy as np
import torch


def main() -> None:
    """Go on from a checkpoint, or begin; write the next checkpoint and the policy."""
    parser = argparse.ArgumentParser()
    parser.add_argument("request", type=Path)
    given = json.loads(parser.parse_args().request.read_text())
    torch.set_num_threads(1)
    random.seed(given["seed"])
    np.random.seed(given["seed"] % 2**32)  # noqa: NPY002 (what d3rlpy 1 draws from)
    torch.manual_seed(given["seed"])
    arrays = np.load(given["data"])
    ends = np.clip(arrays["terminals"] + arrays["timeouts"], 0, 1)
    dataset = d3rlpy.dataset.MDPDataset(
        arrays["observations"], arrays["actions"], arrays["rewards"], arrays["terminals"], ends
    )
    before, after = given["before"] and Path(given["before"]), Path(given["after"])
    dynamics = d3rlpy.dynamics.ProbabilisticEnsembleDynamics(**given["dynamics"])
    dynamics.build_with_dataset(dataset)
    if before:
        dynamics.load_model(str(before / "dynamics.pt"))
    elif given["dynamics_steps"]:
        _fit(dynamics, dataset, given["dynamics_steps"])
    algo = getattr(d3rlpy.algos, given["algorithm"])(dynamics=dynamics, **given["hyperparameters"])
    algo.build_with_dataset(dataset)
    if before:
        algo.load_model(str(before / "model.pt"))
        algo._grad_step = json.loads((before / "step.json").read_text())
    if given["steps"]:
        _fit(algo, dataset, given["steps"])
    dynamics.save_model(str(after / "dynamics.pt"))
    algo.save_model(str(after / "model.pt"))
    (after / "step.json").write_text(json.dumps(algo._grad_step))
    algo.save_policy(str(after / "policy.pt"))


def _fit(learner: "d3rlpy.base.LearnableBase", dataset: "d3rlpy.dataset.MDPDataset", steps: int) -> None:
    learner.fit(
        dataset,
        n_steps=steps,
        n_steps_per_epoch=steps,
        save_metrics=False,
        verbose=False,
        show_progress=False,
    )


if __name__ == "__main__":
    main()
