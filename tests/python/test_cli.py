"""The console script is the command line of the runtime."""

import csv
import subprocess
import sys

import numpy as np

import smpl
from conftest import ROOT


def run(*arguments, cwd=ROOT):
    return subprocess.run([sys.executable, "-m", "smpl", *arguments], capture_output=True, text=True, cwd=cwd)


def test_an_unknown_command_exits_with_two():
    result = run("nonsense")
    assert result.returncode == 2 and "Traceback" not in result.stderr


def test_a_missing_model_exits_with_one():
    result = run("check", "nowhere.eq")
    assert result.returncode == 1 and "nowhere.eq" in result.stderr and "Traceback" not in result.stderr


def test_an_episode_of_the_command_line_is_that_of_reset_with_the_seed(tmp_path):
    out = tmp_path / "episode.csv"
    result = run("simulate", "models/reactor.eq", "--seed", "42", "--steps", "3", "--out", str(out))
    assert result.returncode == 0, result.stderr
    with out.open(newline="") as file:
        rows = list(csv.DictReader(file))
    env = smpl.Env("reactor", normalize=False)
    env.reset(seed=42)
    for row in rows:
        np.testing.assert_array_equal([float(row[name]) for name in env.state_names], env.state)
        env.step(env.model.native.defaults("action"))


def test_a_model_is_never_written_over(tmp_path):
    model = tmp_path / "m.eq"
    text = (ROOT / "models" / "reactor.eq").read_text()
    model.write_text(text)
    (tmp_path / "link.eq").symlink_to("m.eq")
    for out in (str(model), str(tmp_path / "link.eq"), f"{tmp_path}/./m.eq"):
        for arguments in (("simulate", str(model), "--steps", "1", "--out", out), ("compile", str(model), "-o", out)):
            result = run(*arguments)
            assert result.returncode == 1 and "would be overwritten" in result.stderr, arguments
    assert model.read_text() == text


def test_the_trajectory_goes_to_standard_output_where_it_is_asked_to():
    result = run("simulate", "models/pensim.eq", "--steps", "1", "--seed", "3", "--out", "-")
    assert result.returncode == 0, result.stderr
    rows = list(csv.DictReader(result.stdout.splitlines()))
    env = smpl.Env("pensim", normalize=False)
    env.reset(seed=3)
    drawn = [name for name in rows[0] if name.startswith("param.")]
    assert "param.mu_p" in drawn and drawn == list(rows[0])[-len(drawn) :]
    for name in drawn:
        assert float(rows[0][name]) == float(rows[-1][name]) == env.parameters[name.removeprefix("param.")]
