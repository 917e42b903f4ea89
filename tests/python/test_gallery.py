"""Every plant of the gallery as an environment: its start, its task, its baseline, its page."""

import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import smpl
from plants import rest
from smpl.controllers import Nominal, baseline
from smpl.controllers.gallery import LOOPS, RECIPES
from smpl.evaluation import run_episode
from smpl.registry import GALLERY

ROOT = Path(__file__).resolve().parents[2]
# Batches and plants without a nominal point; the start of Tennessee Eastman is rounded as printed.
NOT_AT_REST = {"tennessee_eastman", *RECIPES}
# Steps of an episode that are played where a whole one takes long.
SHORT = {"bsm1": 200, "tennessee_eastman": 600}
PLANTS = sorted(GALLERY.items())


def test_every_model_of_the_gallery_is_registered():
    files = {path.stem for path in (ROOT / "models" / "gallery").glob("*.eq")}
    assert files == set(GALLERY.values())
    assert {f"smpl/{name}-v0" for name in GALLERY} <= set(gymnasium.registry)


@pytest.mark.parametrize(("name", "model"), PLANTS)
def test_the_model_is_called_as_its_environment(name, model):
    assert smpl.compile(model).name == name


@pytest.mark.parametrize("name", GALLERY)
def test_the_checker_of_gymnasium_accepts_the_environment(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(f"smpl/{name}-v0").unwrapped)


@pytest.mark.parametrize("model", sorted(set(GALLERY.values()) - NOT_AT_REST))
def test_an_episode_starts_at_rest(model):
    compiled = smpl.compile(model)
    start, actions = rest(compiled), np.tile(compiled.native.defaults("action"), (3, 1))
    run = compiled.rollout(start, actions)
    scale = np.maximum(np.abs(start), 1e-3 * np.abs(start).max())
    assert (np.abs(run.states[0] - start) <= 1e-6 * scale).all()


@pytest.mark.parametrize("model", sorted(GALLERY.values()))
def test_the_task_has_a_constraint_a_failure_and_a_disturbance(model):
    env = smpl.Env(model)
    assert set(env.constraint_names) - {"action_box"}
    assert env.model.disturbance_names or env.model.native.parameters_are_drawn
    assert "online" in env.model.levels


@pytest.mark.parametrize(("model", "name"), [*((m, "pid") for m in LOOPS), *((m, "recipe") for m in RECIPES)])
def test_the_baseline_does_better_than_nominal_actions(model, name):
    played = []
    for controller in (Nominal(), baseline(model, name)):
        env = smpl.Env(model, normalize=False, max_steps=SHORT.get(model))
        played.append([run_episode(env, controller, seed) for seed in range(3)])
    alone, regulated = played
    assert not any(episode.failure for episode in regulated)
    if not any(episode.failure for episode in alone):
        assert sum(e.rewards.sum() for e in regulated) > sum(e.rewards.sum() for e in alone)


@pytest.mark.parametrize(("name", "model"), PLANTS)
def test_every_plant_has_a_row_and_a_page(name, model):
    row = f"[`smpl/{name}-v0`](gallery/{model}.md)"
    assert row in (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    assert (ROOT / "docs" / "gallery" / f"{model}.md").is_file()
