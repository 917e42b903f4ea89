"""Pictures and text of episodes, headless."""

import sys

import numpy as np
import pytest

import smpl


@pytest.mark.parametrize("name", ["reactor", "beer"])
def test_a_picture_is_an_image_in_bytes(name):
    env = smpl.Env(name, render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    env.step(np.zeros(env.action_space.shape))
    second = env.render()
    assert second.dtype == np.uint8 and second.ndim == 3 and second.shape[2] == 3
    assert first.shape == second.shape and not np.array_equal(first, second)


def test_a_picture_is_drawn_without_matplotlib(monkeypatch):
    for module in ("matplotlib", "matplotlib.figure", "matplotlib.backends.backend_agg"):
        monkeypatch.setitem(sys.modules, module, None)
    env = smpl.Env("reactor", render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(5):
        env.step(np.zeros(2))
    picture = env.render()
    assert picture.dtype == np.uint8 and picture.shape[2] == 3
    assert np.any(np.all(picture == (31, 119, 180), axis=2)), "no curve was drawn"


def test_text_names_states_actions_and_the_end():
    env = smpl.Env("reactor", render_mode="ansi", normalize=False)
    env.reset(seed=0)
    assert "c_A" in env.render()
    env.step([40.0, 0.1])
    text = env.render()
    assert "T_c" in text and "40" in text and "action_box" in text


def test_rendering_without_a_mode_gives_nothing():
    env = smpl.Env("reactor")
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None
