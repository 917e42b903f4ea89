"""The benchmark: runs as folders, resumed, and one table."""

import json
from itertools import pairwise

import pytest

from smpl.benchmark import SUBJECTS, benchmark, main, runs


def test_runs_are_folders_with_configuration_and_scores_and_make_one_table(tmp_path):
    table = benchmark(tmp_path, env="Beer", seeds=2)
    folders = sorted(tmp_path.glob("control/Beer/*/seed-*"))
    assert len(folders) == 2 * len(SUBJECTS["Beer"].controllers)
    configuration = json.loads((tmp_path / "control/Beer/isothermal/seed-1/configuration.json").read_text())
    assert configuration["seed"] == 1_000_000 and len(configuration["checksum"]) == 64
    scores = [json.loads((tmp_path / f"control/Beer/isothermal/seed-{k}/scores.json").read_text()) for k in (0, 1)]
    (row,) = [row for row in table["rows"] if row["controller"] == "isothermal"]
    assert row["seeds"] == 2 and row["episodes"] == len(scores[0]["returns"]) + len(scores[1]["returns"])
    # Equal numbers of steps: the pooled mean is the mean of both.
    assert scores[0]["steps"] == scores[1]["steps"]
    assert row["mean"] == pytest.approx((scores[0]["mean"] + scores[1]["mean"]) / 2, rel=1e-12)
    assert json.loads((tmp_path / "table.json").read_text())["rows"] == json.loads(json.dumps(table["rows"]))
    assert (tmp_path / "table.md").read_text().count("| Beer |") == len(SUBJECTS["Beer"].controllers)


def test_what_is_finished_is_not_run_again(tmp_path):
    benchmark(tmp_path, env="Reactor")
    with pytest.raises(ValueError, match="give --resume"):
        benchmark(tmp_path, env="Reactor")
    (tmp_path / "control/Reactor/random/seed-0/scores.json").unlink()  # as if it had been killed there
    kept = tmp_path / "control/Reactor/pid/seed-0/scores.json"
    before = kept.stat().st_mtime_ns
    benchmark(tmp_path, env="Reactor", resume=True)
    assert kept.stat().st_mtime_ns == before
    assert (tmp_path / "control/Reactor/random/seed-0/scores.json").is_file()
    with pytest.raises(ValueError, match=r"another run .*budget"):
        benchmark(tmp_path, budget="short", env="Reactor", resume=True, seeds=1)


def test_a_table_of_what_is_finished_runs_nothing(tmp_path):
    with pytest.raises(ValueError, match="no finished run"):
        benchmark(tmp_path, env="Beer", run_nothing=True)
    benchmark(tmp_path, env="Beer", algorithms=["profile"])
    table = benchmark(tmp_path, env="Beer", seeds=3, run_nothing=True)
    assert [(row["controller"], row["seeds"]) for row in table["rows"]] == [("profile", 1)]
    assert not (tmp_path / "control/Beer/isothermal").exists()


def test_a_controller_whose_package_is_missing_is_skipped_by_name(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(__import__("sys").modules, "casadi", None)
    assert main(["--env", "smpl/Reactor-v0", "--out", str(tmp_path), "--quiet"]) == 0
    printed = capsys.readouterr().out
    assert "mpc" in printed and "pip install 'smpl[mpc]'" in printed and "Reactor      control  pid" in printed


def test_every_environment_has_runs_with_seeds_apart():
    every = runs("control", "paper", None, 3)
    assert {one.env for one in every} == set(SUBJECTS)
    spans = sorted({(one.seed, one.seed + one.episodes) for one in every if one.env == "Reactor"})
    assert all(end <= begin for (_, end), (begin, _) in pairwise(spans))


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--suite", "ofline"], "suite is 'ofline'; there are: control, offline, online, all"),
        (["--algorithm", "pdi"], "algorithm is 'pdi'; there are: empc, isothermal, mpc, nominal, oracle, pid"),
        (["--budget", "huge"], "budget is 'huge'; there are: smoke, short, paper"),
        (["--env", "Rector"], "env is 'Rector'; there are: Reactor, Beer"),
        (["--seeds", "0"], "seeds is 0"),
    ],
)
def test_bad_input_of_the_benchmark_is_told_in_a_line(arguments, says, capsys, tmp_path):
    assert main([*arguments, "--out", str(tmp_path), "--quiet"]) == 2
    assert says in capsys.readouterr().err
