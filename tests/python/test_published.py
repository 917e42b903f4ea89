"""The published figures, in a table made by a command."""

import json
from dataclasses import replace

import numpy as np
import pytest

from smpl import Env
from smpl.controllers import baseline
from smpl.evaluation import run_episode
from smpl.learning import Task
from smpl_benchmarks import published


def test_rows_that_have_no_chance_in_them_are_the_published_ones(tmp_path):
    table = {row["row"]: row for row in published.published(tmp_path, ["beer-profile", "beer-endless"])}
    # The printed 55; two hundred steps of -1 and one of -200.
    assert table["beer-profile"]["return"] == 55.0
    assert table["beer-endless"]["mean"] == pytest.approx(-400 / 201, rel=1e-12)
    assert table["beer-endless"]["std"] == pytest.approx(14.0014, abs=5e-5)
    text = (tmp_path / "table.md").read_text(encoding="utf-8")
    assert "| beer-endless | a batch that never ends (PG in table 2) | -1.99 / 14.0014 | -1.99005 / 14.0014 |" in text


def test_the_recipe_yields_what_is_published(tmp_path):
    (row,) = published.published(tmp_path, ["pensim-recipe"])
    assert row["return"] == pytest.approx(3640.12, abs=0.006)


def test_starts_at_random_are_repeated_and_what_is_there_is_not_run_again(tmp_path, monkeypatch):
    (row,) = published.published(tmp_path, ["reactor-pid"], scale=0.11)
    assert row["episodes"] == 330
    assert len(row["means"]) == 3
    # About a tenth of the starts run away: -1000 in one step of some ninety each.
    assert 0.05 < row["failures"] / row["episodes"] < 0.16
    assert row["std"] == pytest.approx(35.09, rel=0.3)
    files = sorted(tmp_path.glob("reactor-pid/*.csv"))
    assert [file.name for file in files] == [f"repetition-{i}.csv" for i in range(3)]
    text = files[0].read_text(encoding="utf-8")
    files[0].write_text("".join(text.splitlines(keepends=True)[:101]), encoding="utf-8")
    ran = []
    original = published._part

    def counted(row, repetition, first, count, workers):
        ran.append((repetition, first, count))
        return original(row, repetition, first, count, workers)

    monkeypatch.setattr(published, "_part", counted)
    (again,) = published.published(tmp_path, ["reactor-pid"], scale=0.11)
    assert ran == [(0, 100, 10)]
    assert again["means"] == row["means"]
    assert files[0].read_text(encoding="utf-8") == text
    (shown,) = published.published(tmp_path, ["reactor-pid"], scale=0.11, run=False)
    assert shown["stds"] == row["stds"]


def test_a_row_on_a_grid_starts_where_its_part_of_the_grid_is():
    """Starts 5 and 6 of ten values a state from 0.7 to 1.3 times the steady state, the first state varying fastest."""
    (row,) = (one for one in published.ROWS if one.name == "reactor-data")
    part = published._part(replace(row, controller="pid"), 0, 5, 2, 1)
    env = Env(Task.of("smpl/Reactor-v0", **row.arguments).model, normalize=False)
    env.reset(seed=0)
    for i, found in zip((5, 6), part, strict=True):
        factors = np.array([0.7 + 0.6 * i / 9, 0.7, 0.7])
        episode = run_episode(env, baseline("reactor", "pid"), 0, {"state": factors * env.steady_state})
        assert found["steps"] == episode.steps
        assert found["mean"] == pytest.approx(episode.rewards.mean(), rel=1e-6)


def test_what_is_missing_is_said(tmp_path, monkeypatch):
    def refuse(env, name, **options):
        raise ImportError("not there yet")

    monkeypatch.setattr(published, "baseline", refuse)
    (row,) = published.published(tmp_path, ["mab-mpc"])
    assert row["skipped"] == "not there yet"
    assert "skipped: not there yet" in (tmp_path / "table.md").read_text(encoding="utf-8")
    assert json.loads((tmp_path / "table.json").read_text(encoding="utf-8"))["rows"][0]["row"] == "mab-mpc"


def test_the_search_over_recipes_is_summarised_from_its_points(tmp_path):
    pytest.importorskip("sklearn")
    (row,) = published.published(tmp_path, ["pensim-gpei"], searches=2)
    assert (row["searches"], row["episodes"]) == (2, 12)
    # Ten random recipes of the data set: 3077 to 3813 kg, that is 2.7 to 3.4 kg a step.
    assert 2.6 < row["mean"] < 3.5
    assert row["best"] > 3300
    (tmp_path / "pensim-gpei" / "batches.csv").unlink()
    (again,) = published.published(tmp_path, ["pensim-gpei"], run=False)
    assert again["mean"] == pytest.approx(row["mean"], rel=1e-12)
    # A row too many, of a search that was stopped before it had its points; and no points at all.
    with (tmp_path / "pensim-gpei" / "batches.csv").open("a") as text:
        text.write("1.0,1.0,1150.0\n")
    (more,) = published.published(tmp_path, ["pensim-gpei"], searches=3)
    assert (more["searches"], more["best"] >= row["best"], more["failures"]) == (3, True, 0)
    (tmp_path / "pensim-gpei" / "search.csv").unlink()
    for run in (True, False):
        (last,) = published.published(tmp_path, ["pensim-gpei"], searches=3, run=run)
        assert {**last, "seconds": 0} == {**more, "seconds": 0}


def test_the_command_and_its_errors(tmp_path, capsys):
    assert published.main(["beer-profile", "--out", str(tmp_path), "--quiet"]) == 0
    assert "55" in capsys.readouterr().out
    assert published.main(["nothing", "--out", str(tmp_path), "--quiet"]) == 1
    assert "reactor-pid" in capsys.readouterr().err
