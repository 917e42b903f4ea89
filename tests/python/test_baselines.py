"""The baselines by their names."""

import numpy as np
import pytest

import smpl
from smpl.controllers import Nominal, baseline, baselines
from smpl.evaluation import run_episode


@pytest.mark.parametrize(
    ("environment", "name", "model"),
    [
        ("reactor", "pid", "reactor"),
        ("smpl/Beer-v0", "profile", "beer"),
        ("Beer", "isothermal", "beer"),
        ("pensim", "recipe", "pensim"),
        ("atropine", "mpc", "atropine"),
        ("atropine", "zero", "atropine"),
        ("mab", "nominal", "mab"),
    ],
)
def test_a_baseline_plays_its_environment(environment, name, model):
    env = smpl.Env(model, max_steps=2)
    episode = run_episode(env, baseline(environment, name), 0)
    assert episode.steps == 2 and not episode.failure


def test_the_recipe_begins_with_the_published_values():
    env = smpl.Env("pensim", normalize=False, max_steps=16)
    episode = run_episode(env, baseline("pensim", "recipe"), 0)
    # discharge, Fs, Foil, Fg, pressure, Fw; the sugar feed holds 8 L/h for 15 steps.
    np.testing.assert_allclose(episode.actions[0], [0, 8, 22, 30, 0.6, 0], rtol=1e-6)
    assert episode.actions[14:, 1].tolist() == [8.0, 15.0]


def test_the_recipe_has_the_published_numbers_and_ranges():
    """57 numbers: 6 discharge, 21 Fs, 10 Foil, 6 Fg, 8 pressure, 5 Fw and the feed of phenylacetic acid."""
    from smpl.controllers.pensim import Recipe

    recipe = Recipe(smpl.compile("pensim", settings={"paa_schedule": "hours"}))
    kinds = [name.split()[0] for name in recipe.names]
    assert {kind: kinds.count(kind) for kind in kinds} == {
        "discharge": 6, "Fs": 21, "Foil": 10, "Fg": 6, "pressure": 8, "Fw": 5, "Fpaa_start": 1,
    }  # fmt: skip
    ranges = dict(zip(recipe.names, zip(recipe.low, recipe.high, strict=True), strict=True))
    for name, published in {
        "discharge until 102 h": (3600, 4100),
        "Fs until 24 h": (135, 151),
        "Fs until 80 h": (104.4, 127.6),
        "Foil until 4 h": (21, 24.2),
        "Fg until 8 h": (29, 33),
        "Fg until 200 h": (67.5, 76),
        "pressure until 100 h": (0.99, 1.2),
        "Fw until 75 h": (450, 510),
        "Fpaa_start": (4.5, 5.5),
    }.items():
        assert ranges[name] == pytest.approx(published), name


def test_isothermal_takes_its_temperature():
    assert baseline("beer", "isothermal", temperature=14.0).action(smpl.Env("beer")).tolist() == [14.0]


def test_what_is_not_there_is_named():
    assert baselines("reactor") == ("pid", "mpc", "full_information")
    with pytest.raises(ValueError, match="baseline 'lqr' of reactor: there are pid, mpc, full_information"):
        baseline("reactor", "lqr")
    with pytest.raises(ValueError, match="no environment 'reaktor'; did you mean 'reactor'"):
        baseline("reaktor", "pid")


@pytest.mark.parametrize(
    ("environment", "steps", "options"),
    [
        ("reactor", 20, {}),
        ("beer", 200, {"samples": 16, "every": 24}),
        ("pensim", 10, {"samples": 4, "horizon": 10}),
        ("atropine", 2, {"samples": 4, "horizon": 2, "iterations": 1}),
        ("mab", 1, {"horizon": 4}),
        ("mab_plant", 1, {"samples": 4, "horizon": 1}),
    ],
)
def test_full_information_is_not_worse_than_the_nominal_policy(environment, steps, options):
    if environment in ("reactor", "mab"):
        pytest.importorskip("casadi", reason="CasADi is not installed")
    env = smpl.Env(environment, normalize=False, max_steps=steps)
    nominal, best = (
        run_episode(env, one, 1) for one in (Nominal(), baseline(environment, "full_information", **options))
    )
    assert not best.failure
    # A horizon of one step of the culture does not see what it costs later.
    slack = 0.1 * abs(nominal.rewards.sum()) if environment == "mab" else 1e-9
    assert best.rewards.sum() >= nominal.rewards.sum() - slack


def test_full_information_of_the_antibody_plant_keeps_what_the_nominal_policy_breaks():
    """A first batch: the nominal one starts the pool with what was in the pipes, below the least concentration.

    Keeping it above costs part of this batch; over an episode the plant recovers more (`python/examples/plant_mpc.py`).
    """
    env = smpl.Env("mab_plant", normalize=False, max_steps=25)
    nominal = run_episode(env, Nominal(), 1)
    best = run_episode(env, baseline("mab_plant", "full_information", samples=4, iterations=1), 1)
    assert nominal.costs.sum() > 0.5
    assert best.costs.sum() == 0.0 and not best.failure
    assert best.total > 0.7 * nominal.total > 7e5


def test_the_economic_controller_of_the_culture_does_not_ask_for_what_a_full_tank_lets_out():
    """The outflow of a tank that has filled in an hour, held for all of the horizon, dilutes the culture."""
    pytest.importorskip("casadi", reason="CasADi is not installed")
    env = smpl.Env("mab", normalize=False, scenario="legacy", variants=("wide_bounds",), max_steps=4)
    episode = run_episode(env, baseline("mab", "empc", horizon=60), 0, {"start": "nominal"})
    assert not episode.failure and episode.steps == 4
    # The published mean is 1350.
    assert np.mean(episode.rewards) == pytest.approx(1350.0, rel=0.03)


def test_a_stopped_run_of_the_full_information_command_resumes(tmp_path, capsys, monkeypatch):
    pytest.importorskip("casadi")
    import full_information as command

    arguments = ["reactor", "beer", "--out", str(tmp_path), "--steps", "6"]
    command.main([*arguments, "--seeds", "1"])
    rows = command.read(tmp_path / "full_information.csv")
    assert [(row["environment"], row["controller"], row["seed"]) for row in rows] == [
        (name, one, "2000") for name in ("reactor", "beer") for one in ("nominal", "full_information")
    ]
    # A beer that is not ready costs 1 a step and 200 in the last one, whoever chooses the temperature.
    assert [float(row["return"]) for row in rows if row["environment"] == "beer"] == [-205.0, -205.0]
    assert "| beer | 1 | -205 | 0, 0 | -205 | 0, 0 | 0 of 1 |" in capsys.readouterr().out
    ran = []
    monkeypatch.setattr(command, "played", lambda *given: ran.append(given) or rows[0])
    command.main([*arguments, "--table"])
    assert not ran
    command.main([*arguments[1:], "--seeds", "2"])
    assert ran == [("beer", "nominal", 2001, 6), ("beer", "full_information", 2001, 6)]


def test_the_table_of_pensim_by_sampling_goes_on(tmp_path, capsys):
    import pensim_mpc
    from full_information import read, write

    given = ["--out", str(tmp_path), "--seeds", "1", "--steps", "30"]
    pensim_mpc.main(given)
    file = tmp_path / "pensim_mpc.csv"
    rows = read(file)
    assert [row["controller"] for row in rows] == ["recipe", "sampling"]
    env = smpl.Env("pensim", normalize=False, max_steps=30)
    assert float(rows[0]["return"]) == pytest.approx(run_episode(env, baseline("pensim", "recipe"), 2000).total)
    first = capsys.readouterr().out
    for row, kg in zip(rows, (100, 120), strict=True):
        row["return"] = str(kg)
    write(file, rows)
    pensim_mpc.main(given)
    assert "2000 | 100 | 120 | 20.0%" in capsys.readouterr().out and "2000 |" in first
