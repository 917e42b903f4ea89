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
