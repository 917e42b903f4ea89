"""Results of evaluations are replayed, and the first episode that differs is named."""

import json
import shutil

import pytest

import smpl
from smpl.commands.main import main
from smpl.deploy import export_policy
from smpl.evaluate import main as evaluate


@pytest.fixture
def result(tmp_path):
    out = tmp_path / "run"
    done = ["reactor", "--controller", "lqr", "--controller", "constant:26.85,0.1", "--episodes", "4", "--seed", "7"]
    assert evaluate([*done, "--scenario", "legacy", "--quiet", "--out", str(out)]) == 0
    return out


def changed(folder, change):
    file = folder / "result.json"
    tree = json.loads(file.read_text())
    change(tree)
    file.write_text(json.dumps(tree))


def test_a_result_states_what_was_run(result):
    tree = json.loads((result / "result.json").read_text())
    model = smpl.compile("reactor", scenario="legacy")
    assert (tree["environment"], tree["episodes"], tree["seed"]) == ("reactor", 4, 7)
    assert tree["arguments"] == {"scenario": "legacy"}
    assert tree["model_hash"] == smpl.deploy.model_hash(model)
    assert [one["policy"] for one in tree["controllers"]] == ["lqr", "constant:26.85,0.1"]
    env = smpl.Env(model)
    episode = smpl.evaluation.run_episode(env, smpl.controllers.LQR(model), seed=8)
    assert tree["controllers"][0]["returns"][1] == pytest.approx(episode.total, rel=1e-12)
    assert tree["controllers"][0]["lengths"][1] == episode.steps


def test_a_result_that_agrees_is_accepted(result, capsys):
    assert main(["verify", str(result)]) == 0
    out = capsys.readouterr().out
    assert "lqr: 4 episodes agree" in out and "constant:26.85,0.1: 4 episodes agree" in out
    assert main(["verify", str(result / "result.json"), "--controller", "lqr", "--episodes", "2"]) == 0
    assert "lqr: 2 episodes agree" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("returns", 12.5, "episode 2 (seed 9): return"),
        ("lengths", 3, "episode 2 (seed 9): steps 101, recorded 3"),
        ("failures", "state_box", "episode 2 (seed 9): failure none, recorded state_box"),
    ],
)
def test_the_first_episode_that_differs_is_named(result, capsys, key, value, says):
    def change(tree):
        tree["controllers"][0][key][2:] = [value] * 2

    changed(result, change)
    assert main(["verify", str(result)]) == 1
    assert f"lqr: {says}" in capsys.readouterr().out


def test_a_difference_within_the_tolerance_is_accepted(result):
    def change(tree):
        tree["controllers"][0]["returns"][1] *= 1 + 1e-4

    changed(result, change)
    assert main(["verify", str(result)]) == 1
    assert main(["verify", str(result), "--tolerance", "1e-3"]) == 0


def test_another_version_of_the_model_is_noted(result, capsys):
    changed(result, lambda tree: tree.update(model_hash="0" * 64))
    assert main(["verify", str(result)]) == 0
    assert "the model Reactor has changed since the result was recorded" in capsys.readouterr().err


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_an_exported_policy_replays_the_scores_of_the_original(result, tmp_path, capsys):
    file = export_policy("lqr", "reactor", "c", tmp_path / "lqr.c", scenario="legacy")
    assert main(["verify", str(result), "--controller", "lqr", "--policy", str(file)]) == 0
    assert main(["verify", str(result), "--controller", "constant:26.85,0.1", "--policy", str(file)]) == 1
    assert main(["verify", str(result), "--policy", str(file)]) == 1
    assert "name the one of" in capsys.readouterr().err
    other = export_policy("lqr", "reactor", "c", tmp_path / "other.c")
    assert main(["verify", str(result), "--controller", "lqr", "--policy", str(other)]) == 1
    assert "another version of Reactor" in capsys.readouterr().err


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_the_file_of_a_policy_is_found_next_to_the_result_and_compared(tmp_path, capsys):
    file = export_policy("lqr", "reactor", "c", tmp_path / "lqr.c")
    out = tmp_path / "run"
    done = ["reactor", "--policy", str(file), "--episodes", "2", "--quiet", "--out", str(out)]
    assert evaluate(done) == 0
    file.rename(out / "lqr.c")
    assert main(["verify", str(out)]) == 1
    assert "needs lqr.h next to it" in capsys.readouterr().err
    (tmp_path / "lqr.h").rename(out / "lqr.h")
    assert main(["verify", str(out)]) == 0
    (out / "lqr.c").write_text((out / "lqr.c").read_text() + "\n")
    assert main(["verify", str(out)]) == 0
    assert "has changed since the result was recorded" in capsys.readouterr().err
    (out / "lqr.c").unlink()
    assert main(["verify", str(out)]) == 1
    assert "is not there, nor 'lqr.c' next to the result" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda tree: tree.pop("seed"), "`seed` is missing"),
        (lambda tree: tree.update(smpl_result=9), "`smpl_result` is 9, expected 1"),
        (lambda tree: tree["controllers"][0]["returns"].pop(), "lqr has 3 returns, expected 4"),
        (lambda tree: tree["controllers"][0].update(policy=None), "cannot be replayed"),
        (lambda tree: tree.update(environment="nowhere"), "nowhere"),
    ],
)
def test_invalid_results_are_refused(result, capsys, change, says):
    changed(result, change)
    assert main(["verify", str(result)]) == 1
    assert says in capsys.readouterr().err


def test_missing_results_and_controllers_are_refused(result, tmp_path, capsys):
    assert main(["verify", str(tmp_path / "none")]) == 1
    assert "is not there" in capsys.readouterr().err
    (tmp_path / "text.json").write_text("{")
    assert main(["verify", str(tmp_path / "text.json")]) == 1
    assert "is not a result" in capsys.readouterr().err
    assert main(["verify", str(result), "--controller", "mpc"]) == 1
    assert "the result has no controller 'mpc'; there are: lqr, constant:26.85,0.1" in capsys.readouterr().err
