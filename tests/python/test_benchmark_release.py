"""Releases of data sets: recipes, Minari, d3rlpy, Croissant metadata, data sheet, checksums."""

import json
import os
import shlex

import gymnasium
import numpy as np
import pytest

import smpl
from smpl.benchmark import main
from smpl.collect import main as collect
from smpl_benchmarks.recipes import RECIPES
from smpl_benchmarks.release import check


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    for package in ("minari", "h5py", "pyarrow"):
        pytest.importorskip(package, reason=f"{package} is not installed")
    out = tmp_path_factory.mktemp("release")
    given = ["release", "--env", "Reactor", "--quality", "medium", "--episodes", "3", "--workers", "1"]
    # A relative folder, as in the manual.
    assert main([*given, "--out", os.path.relpath(out)]) == 0
    return out / "reactor/medium-v0"


def test_every_process_has_a_recipe_of_each_quality(capsys):
    envs = ("Reactor", "Beer", "PenSim", "Atropine", "MAb", "MAbPlant")
    assert {(env, quality) for env in envs for quality in ("random", "medium", "expert", "mixed")} <= set(RECIPES)
    assert main(["release", "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(RECIPES) and all(line.startswith("python -m smpl.collect smpl/") for line in lines)
    # The sizes of the paper's sets.
    papers = {env: one.episodes for (env, quality), one in RECIPES.items() if quality == "paper"}
    assert papers == {"Reactor": 125_000, "Atropine": 10_000, "PenSim": 1000, "MAb": 1000}


def test_the_command_of_a_recipe_collects_the_released_episodes(made, tmp_path):
    from dataclasses import replace

    one = replace(RECIPES["Reactor", "medium"], episodes=3)
    words = shlex.split(one.command(str(tmp_path / "again")))
    assert collect([*words[3:], "--quiet", "--workers", "1"]) == 0
    again, released = (smpl.datasets.load(path) for path in (tmp_path / "again", made / "episodes"))
    for here, there in zip(again, released, strict=True):
        np.testing.assert_array_equal(here.actions, there.actions)
        np.testing.assert_array_equal(here.rewards, there.rewards)


def test_a_release_has_sums_licence_and_data_sheet(made):
    names = {line.split("  ")[1] for line in (made / "SHA256SUMS").read_text().splitlines()}
    assert {"DATASHEET.md", "LICENSE", "croissant.json", "episodes/dataset.json"} <= names
    check(made)
    assert main(["release", "--env", "Reactor", "--quality", "medium", "--check", "--out", str(made.parents[1])]) == 0
    sheet = (made / "DATASHEET.md").read_text()
    for section in ("Motivation", "Composition", "Collection", "Uses", "Distribution", "Maintenance"):
        assert f"\n## {section}\n" in sheet
    assert "3 episodes" in sheet and "noise 0.2" in sheet
    kept = (made / "LICENSE").read_bytes()
    try:
        (made / "LICENSE").write_text("other")
        with pytest.raises(ValueError, match="LICENSE is another file"):
            check(made)
    finally:
        (made / "LICENSE").write_bytes(kept)


def test_minari_opens_a_release_with_the_time_limit_of_the_process(made, monkeypatch):
    minari = pytest.importorskip("minari", reason="Minari is not installed")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(made / "minari"))
    dataset = minari.load_dataset("smpl/reactor/medium-v0")
    assert dataset.total_episodes == 3
    env = dataset.recover_environment()
    assert env.spec.max_episode_steps == env.unwrapped.max_steps == 101
    # The reward and scenario of the recipe: the first recorded step comes again.
    episode = next(dataset.iterate_episodes())
    first, _ = env.reset(seed=smpl.datasets.load(made / "episodes")[0].seed)
    np.testing.assert_array_equal(first, episode.observations[0])
    _, reward, *_ = env.step(episode.actions[0])
    assert reward == pytest.approx(episode.rewards[0])
    # The registered environment itself has no limit in its specification: its own counts.
    assert gymnasium.spec("smpl/Reactor-v0").max_episode_steps is None


def test_d3rlpy_opens_a_release(made, monkeypatch):
    datasets = pytest.importorskip("d3rlpy.datasets", reason="d3rlpy is not installed")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(made / "minari"))
    buffer, env = datasets.get_minari("smpl/reactor/medium-v0")
    episodes = list(smpl.datasets.load(made / "episodes"))
    assert [one.size() for one in buffer.episodes] == [one.steps for one in episodes]
    assert env.unwrapped.model.name == "Reactor"
    np.testing.assert_array_equal(buffer.episodes[0].observations, episodes[0].observations[:-1])
    # Our own export is aligned in every episode.
    ours = smpl.datasets.to_d3rlpy(episodes)
    for mine, episode in zip(ours.episodes, episodes, strict=True):
        np.testing.assert_array_equal(mine.actions[: episode.steps], episode.actions)
        np.testing.assert_array_equal(mine.observations[: episode.steps], episode.observations[: episode.steps])


def test_croissant_metadata_names_every_column_and_file(made):
    content = json.loads((made / "croissant.json").read_text())
    columns = {one["name"] for one in content["recordSet"][0]["field"]}
    assert {"episode", "reward", "observation.T", "action.T_c", "physical.q_out", "violation.empty"} <= columns
    about = {one["name"]: one["description"] for one in content["recordSet"][0]["field"]}
    assert about["time"].endswith(", in min")
    assert about["observation.h"].endswith("h; -1 to 1 is 1e-08 to 1.0 m")
    assert about["physical.T_c"].endswith("T_c, 15.0 to 35.0 degC")
    parts = [one for one in content["distribution"] if one["@type"] == "cr:FileObject"]
    assert {one["contentUrl"] for one in parts} == {f"episodes/{one.name}" for one in made.glob("episodes/*.parquet")}
    assert content["license"] and content["citeAs"] and content["conformsTo"].endswith("/1.0")


def test_mlcroissant_reads_the_records(made):
    croissant = pytest.importorskip("mlcroissant", reason="mlcroissant is not installed")
    loaded = croissant.Dataset(jsonld=str(made / "croissant.json"))
    assert not loaded.metadata.ctx.issues.errors
    rows = [row for _, row in zip(range(5), loaded.records("steps"), strict=False)]
    episode = smpl.datasets.load(made / "episodes")[0]
    assert [row["steps/reward"] for row in rows[:3]] == pytest.approx(episode.rewards[:3].tolist())
