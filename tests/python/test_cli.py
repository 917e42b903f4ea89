"""The console script is the command line of the runtime."""

import csv
import json
import re
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


SUMS = """
set s = 1..20
domain z in 0..1 cells 5
param k[s] = 0.5 in 0..1
state c[z] = 1
eq d/dt c[z] = -sum((k[i] + c[z]) / (1 + (k[i] + c[z])^2) for i in s) / 1 [s] for z
"""


def test_the_flat_model_says_what_depends_on_the_counter_of_a_sum(tmp_path):
    (tmp_path / "m.eq").write_text(SUMS)
    result = run("compile", str(tmp_path / "m.eq"), "--emit", "ir")
    assert result.returncode == 0, result.stderr
    # What the sum uses twice depends on the cell `i` and on the counter `j` of the sum.
    part = re.search(r"^  (%\d+)(.*) = (.*k\[j\].*)$", result.stdout, re.MULTILINE)
    assert part and part[2] == "(j)" and "c[i]" in part[3], result.stdout
    row = next(line for line in result.stdout.splitlines() if "# row of c[i]" in line)
    assert f"sum(j in 0..20: {part[1]}(j) / (1.0 + {part[1]}(j)^2))" in row


def test_the_interface_says_where_each_name_is(tmp_path):
    (tmp_path / "m.eq").write_text(
        "set s = { a, b }\ndomain z in 0..1 cells 3\nstate c[s, z] = 1\nlet y : 1 = c[b,2]\nparam k[s] = 0.5\n"
        "action u = 0 in 0..1\neq d/dt c[i, z] = -k[i]*c[i, z] / 1 [s] for i in s, z\n"
    )
    result = run("compile", str(tmp_path / "m.eq"), "--emit", "json")
    interface = json.loads(result.stdout)
    places = {
        e["name"]: (e["array"], e["element"]) for kind in ("states", "parameters", "actions") for e in interface[kind]
    }
    names = [("a", 1), ("a", 2), ("a", 3), ("b", 1), ("b", 2), ("b", 3)]
    assert places == {
        **{f"c[{i},{k}]": ("c", at) for at, (i, k) in enumerate(names)},
        "k[a]": ("k", 0),
        "k[b]": ("k", 1),
        "u": ("u", 0),
    }
    assert [(e["name"], e["array"], e["element"]) for e in interface["algebraics"]] == [("y", "out", 0)]
