"""The example of Stable-Baselines3 learns; skipped where that is not installed."""

import pytest

pytest.importorskip("stable_baselines3")

from smpl.examples.ppo_reactor import evaluate, train


def test_ppo_learns_to_keep_the_reactor_from_igniting():
    before, after = (evaluate(train(steps, seed=1)[1], episodes=50) for steps in (0, 40_000))
    # Without control every start ignites within three minutes, which costs 1000.
    assert before.failures > 0.9 and before.mean_return < -900
    assert after.failures < 0.2 and after.mean_length > 80
    assert after.mean_return > before.mean_return + 500
