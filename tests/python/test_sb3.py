"""The example of Stable-Baselines3 learns; skipped where that is not installed."""

import copy

import pytest

pytest.importorskip("stable_baselines3")

from ppo_reactor import evaluate, train
from smpl.learning import Task
from smpl.learning.formulation import Formulation
from smpl_benchmarks.online import StableBaselinesTrainer


def test_ppo_learns_to_keep_the_reactor_from_igniting():
    before, after = (evaluate(train(steps, seed=1)[1], episodes=50) for steps in (0, 40_000))
    # Without control every start ignites within three minutes, which costs 1000.
    assert before.failures > 0.9 and before.mean_return < -900
    assert after.failures < 0.2 and after.mean_length > 80
    assert after.mean_return > before.mean_return + 500


def test_a_package_does_not_write_into_the_hyperparameters():
    """CrossQ adds to `policy_kwargs`; the runs of a benchmark share them."""
    pytest.importorskip("sb3_contrib", reason="sb3-contrib is not installed")
    hyperparameters = {"policy_kwargs": {"net_arch": {"pi": [8], "qf": [8]}}, "buffer_size": 100}
    before = copy.deepcopy(hyperparameters)
    trainer = StableBaselinesTrainer("CrossQ", Task.of("reactor"), Formulation(), hyperparameters, 2)
    trainer.begin(0)
    assert hyperparameters == before
