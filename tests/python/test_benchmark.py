"""The benchmark: runs as folders, resumed, and one table."""

import json
import re
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from smpl.benchmark import SUBJECTS, Run, benchmark, main, runs
from smpl_benchmarks.benchmark import finished
from smpl_benchmarks.configuration import over, read, settings
from smpl_benchmarks.pages import markdown, place_in
from smpl_benchmarks.places import places
from smpl_benchmarks.records import Result, keep, recorded
from smpl_benchmarks.tables import table
from tank import TANK

ROOT = Path(__file__).resolve().parents[2]


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
    text = (tmp_path / "table.md").read_text(encoding="utf-8")
    assert text.count("#### ") == 1 and text.count("| control |") == len(SUBJECTS["Beer"].controllers)


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


def test_records_are_all_that_the_table_needs_and_are_not_run_again(tmp_path):
    records = tmp_path / "records"
    first = benchmark(tmp_path / "first", env="Beer", seeds=2, results=records)
    names = sorted(SUBJECTS["Beer"].controllers)
    assert [path.name for path in records.iterdir()] == ["smoke-control.jsonl"]
    lines = (records / "smoke-control.jsonl").read_text().splitlines()
    about = [json.loads(line)["configuration"] for line in lines]
    assert [(one["env"], one["controller"], one["number"]) for one in about] == [
        ("Beer", name, k) for name in names for k in (0, 1)
    ]
    assert max(map(len, lines)) < 4000
    again = benchmark(tmp_path / "second", env="Beer", seeds=2, results=records, resume=True)
    assert not list((tmp_path / "second").glob("control"))
    for before, after in zip(first["rows"], again["rows"], strict=True):
        assert after.pop("seconds") == pytest.approx(before.pop("seconds"))
        for key in ("return_mean", "return_iqm", "return_interval", "regret"):
            assert after.pop(key) == pytest.approx(before.pop(key), rel=1e-7)
        assert after == before
    assert [row["changed"] for row in again["rows"]] == [[]] * len(names)
    # One that is missing is made, and nothing else.
    missing = [i for i, one in enumerate(about) if (one["controller"], one["number"]) == ("profile", 1)]
    (records / "smoke-control.jsonl").write_text("".join(f"{x}\n" for i, x in enumerate(lines) if i not in missing))
    benchmark(tmp_path / "third", env="Beer", seeds=2, results=records, resume=True)
    assert [path.parent.name for path in (tmp_path / "third").glob("*/*/*/*")] == ["profile"]
    again = (records / "smoke-control.jsonl").read_text().splitlines()
    assert [i for i, (one, other) in enumerate(zip(lines, again, strict=True)) if one != other] == missing


def test_a_record_of_other_settings_is_run_again_and_marked_until_then(tmp_path):
    benchmark(tmp_path / "first", env="Beer", algorithms=["profile", "nominal"], results=tmp_path)
    path = tmp_path / "smoke-control.jsonl"
    content = {one["configuration"]["controller"]: one for one in map(json.loads, path.read_text().splitlines())}
    content["profile"]["configuration"]["episodes"] = 9
    content["nominal"]["configuration"]["checksum"] = "another"
    path.write_text("".join(json.dumps(one) + "\n" for one in content.values()))
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- table -->\nold\n<!-- end of table -->\nafter\n")
    shown = ["--table", "--env", "Beer", "--results", str(tmp_path), "--page", str(page), "--quiet"]
    assert main([*shown, "--out", str(tmp_path / "second")]) == 0
    text = page.read_text()
    assert "| profile* |" in text and "| nominal* |" in text and "a change of: episodes, model." in text
    assert text.startswith("before\n<!-- table -->\n\n#### Beer\n\n| suite |")
    assert text.endswith("<!-- end of table -->\nafter\n")
    arguments = {"env": "Beer", "algorithms": ["profile", "nominal"], "results": tmp_path}
    third = benchmark(tmp_path / "third", resume=True, **arguments)
    # The settings decide what is run again; another text of the model may say the same.
    assert [path.parent.name for path in (tmp_path / "third").glob("*/*/*/*")] == ["profile"]
    assert {row["controller"]: row["changed"] for row in third["rows"]} == {"profile": [], "nominal": ["model"]}


def test_regret_and_gain_are_leads_on_the_same_episodes():
    def result(controller, returns):
        run = Run("control", "short", "Beer", controller, 0, 0, len(returns), {})
        counts = {"failures": 0, "successes": 0, "seconds": 1.0}
        return Result(run, {"returns": returns, "steps": 10, "mean": 0.0, "std": 0.0, **counts}, [], {})

    returns = {"full_information": [5.0, 7.0], "profile": [2.0, 3.0, -100.0], "nominal": [1.0, 4.0, -10.0]}
    found = [result(*one) for one in returns.items()]
    every = [one.run for one in found]
    rows = table(every, {one.run.name: one for one in found}, {}, {})["rows"]
    assert [row["regret"] for row in rows] == [0.0, 3.5, 3.5]
    assert [row["gain"] for row in rows] == [3.5, -30.0, 0.0]
    assert [row["better"] for row in rows] == [[2, 2], [1, 3], [0, 3]]
    assert rows[0]["gain_interval"] == [3.0, 4.0] and rows[2]["gain_interval"] == [0.0, 0.0]
    rows = table(every[:2], {one.run.name: one for one in found[:2]}, {}, {})["rows"]
    assert [(row["gain"], row["better"]) for row in rows] == [(None, None)] * 2


def test_a_page_may_have_a_place_for_each_process(tmp_path):
    content = benchmark(tmp_path / "runs", env="Beer", algorithms=["profile", "nominal"])
    page = tmp_path / "page.md"
    place = "<!-- table: {} -->\nold {}\n<!-- end of table -->\n".format
    page.write_text("# A\n" + place("best", 1) + "# B\n" + place("Beer", 2) + "# C\n" + place("Reactor", 3))
    place_in(page, content, {"best": "| process | episodes | nominal |\n| Beer | 2 | 1 |\n"})
    best, beer, reactor = page.read_text().split("# ")[1:]
    assert best.startswith("A\n<!-- table: best -->\n\n| process | episodes | nominal |") and "\n| Beer | " in best
    assert beer.startswith("B\n<!-- table: Beer -->\n\n| suite |") and beer.count("| control | profile |") == 1
    # What was not run stays.
    assert reactor == "C\n" + place("Reactor", 3)
    assert markdown(content).count("| control |") == beer.count("| control |") == 2


def test_a_learned_run_is_shown_from_its_record_alone(tmp_path):
    for package in ("yaml", "matplotlib"):
        pytest.importorskip(package)
    (run,) = runs("online", "short", "Beer", 1, ["PPO"])
    scores = {"mean": 1.25, "std": 2.0, "steps": 160, "returns": [99.0, 101.0], "failures": 0, "successes": 2}
    rows = [{"steps": 10.0 * k, "mean": -1.0 / k, "failures": 0.0} for k in (1, 2, 3)]
    whole = {**scores, "seconds": 7.5, "lengths": [80, 80], "diverged": 4}
    keep(Result(run, whole, rows, run.described()), tmp_path / "records")
    found = recorded(run, tmp_path / "records")
    assert found.curve == [pytest.approx(row, rel=1e-7) for row in rows] and "lengths" not in found.scores
    content = benchmark(tmp_path / "out", "online", "short", run_nothing=True, results=tmp_path / "records")
    (row,) = content["rows"]
    assert (row["mean"], row["std"], row["return_mean"], row["seeds"]) == (1.25, 2.0, 100.0, 1)
    assert row["published"] == (1.0688, 20.70) and row["changed"] == ["model"]  # no checksum is recorded
    assert "| PPO*† |" in markdown(content) and "† training diverged" in markdown(content)
    drawn = sorted(path.name for path in (tmp_path / "out/figures").iterdir())
    assert drawn == ["Beer-curves.png", "Beer-scores.png"]


@pytest.mark.parametrize("name", ["nominal", "random", "pid"])
def test_a_controller_of_ones_own_does_not_take_the_name_of_one_of_the_model(name, tmp_path):
    config = tmp_path / "own.yaml"
    config.write_text(
        f"processes: {{Own: {{model: {ROOT / 'models/reactor.eq'}, controllers: {{{name}: 'constant:26,0.1'}}}}}}"
    )
    with pytest.raises(ValueError, match=f"controllers: '{name}' is of Reactor already .*: give yours another name"):
        runs("control", "smoke", "Own", 1, config=config)


def test_a_controller_of_another_version_is_another_run(tmp_path, monkeypatch):
    pytest.importorskip("yaml")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    config = tmp_path / "own.yaml"
    own = f"model: {ROOT / 'models/reactor.eq'}, controllers: {{mine: 'own_law:Law'}}"
    config.write_text(f"processes: {{Own: {{{own}}}}}")
    text = "class Law:\n    version = 1\n    def action(self, env):\n        return [26.85, 0.1]\n"
    (tmp_path / "own_law.py").write_text(text)
    given = {"env": "Own", "algorithms": ["mine"], "config": config, "workers": 1}
    benchmark(tmp_path / "out", **given)
    benchmark(tmp_path / "out", **given, resume=True)
    (tmp_path / "own_law.py").write_text(text.replace("26.85", "27.0").replace("= 1", "= 2"))
    monkeypatch.delitem(sys.modules, "own_law")
    with pytest.raises(ValueError, match=r"is another run .*identity"):
        benchmark(tmp_path / "out", **given, resume=True)
    config.write_text(config.read_text().replace("own_law:Law", "own_law:Lwa"))
    with pytest.raises(ValueError, match="controller 'own_law:Lwa' is not there"):
        runs("control", "smoke", "Own", 1, config=config)


@pytest.mark.parametrize(
    ("process", "marked"),
    [
        ("{formulation: {centre: nominal, reach: 0.5}, data: {controller: random}}", True),
        ("{formulation: {centre: nominal, reach: 0.5}, data: {controller: centre}}", False),
        ("{formulation: {reward_scale: 0.5}, data: {controller: random}}", False),
    ],
)
def test_a_formulation_of_which_only_rewards_are_learned_is_marked(process, marked, tmp_path):
    pytest.importorskip("yaml")
    pytest.importorskip("matplotlib")
    config = tmp_path / "own.yaml"
    config.write_text(
        f"processes: {{Own: {{model: {ROOT / 'models/reactor.eq'}, **: 0}}}}".replace("**: 0", process[1:-1])
    )
    (run,) = runs("offline", "short", "Own", 1, ["BC"], config)
    scores = {"mean": 1.0, "std": 2.0, "steps": 2, "returns": [1.0, 1.0], "failures": 0, "successes": 2, "seconds": 1.0}
    keep(Result(run, scores, [], run.described()), tmp_path / "records")
    found = benchmark(
        tmp_path / "out", "offline", "short", env="Own", algorithms=["BC"], config=config, run_nothing=True,
        results=tmp_path / "records",
    )  # fmt: skip
    text = markdown(found)
    assert ("| BC*‡ |" in text and "of the formulation the rewards count" in text) == marked


@pytest.mark.parametrize(
    "text",
    [
        "{", "[]", "{}", '{"configuration": {}, "scores": {}, "curve": [1]}',
        '{"configuration": {"env": "Beer", "controller": "profile", "number": 0}, "scores": {}, "curve": {"a": [], '
        '"b": [1]}}',
    ],
)  # fmt: skip
def test_a_damaged_record_is_named(text, tmp_path, capsys):
    path = tmp_path / "smoke-control.jsonl"
    path.write_text(text)
    given = ["--env", "Beer", "--algorithm", "profile", "--results", str(tmp_path), "--resume", "--quiet"]
    assert main([*given, "--out", str(tmp_path / "runs")]) == 1
    assert f"error: {path}, line 1, is not a record of a run" in capsys.readouterr().err


def test_a_page_without_a_place_for_the_table_is_told(tmp_path, capsys):
    page = tmp_path / "page.md"
    page.write_text("nothing")
    given = ["--env", "Beer", "--algorithm", "profile", "--page", str(page), "--quiet"]
    assert main([*given, "--out", str(tmp_path / "runs")]) == 1
    assert "<!-- table -->" in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()


def test_a_controller_whose_package_is_missing_is_skipped_by_name(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(__import__("sys").modules, "casadi", None)
    assert main(["--env", "smpl/Reactor-v0", "--out", str(tmp_path), "--quiet"]) == 0
    printed = capsys.readouterr().out
    assert "mpc" in printed and "pip install casadi" in printed and "Reactor      control  pid" in printed


def test_a_search_has_no_more_environments_than_episodes_that_count():
    pytest.importorskip("yaml")
    configuration = read()
    given = {"algorithms": {"online": {"ARS": {"n_eval_episodes": 3}}}}
    for expected, one in ((4, configuration), (3, over(configuration, given))):
        assert settings(one, "online", "Beer", "ARS", "short")["num_envs"] == expected
    assert settings(configuration, "online", "Beer", "PPO", "short")["num_envs"] == 32


def test_every_environment_has_runs_with_seeds_apart():
    every = runs("control", "paper", None, 3)
    assert {one.env for one in every} == set(SUBJECTS)
    spans = sorted({(one.seed, one.seed + one.episodes) for one in every if one.env == "Reactor"})
    assert all(end <= begin for (_, end), (begin, _) in pairwise(spans))


def test_a_model_of_ones_own_is_run_by_its_path(tmp_path, monkeypatch, capsys):
    path = tmp_path / "tank.eq"
    path.write_text(TANK, encoding="utf-8")
    found = benchmark(tmp_path / "runs", env=str(path), seeds=2, results=tmp_path / "records")
    rows = {row["controller"]: row for row in found["rows"]}
    assert set(rows) == {"nominal", "random", "lqr", "full"} and {row["env"] for row in found["rows"]} == {"Tank"}
    # A level of 1 m is the steady state of the nominal inflow.
    assert rows["nominal"]["mean"] == pytest.approx(0, abs=1e-12) and rows["nominal"]["published"] is None
    assert rows["full"]["gain"] == pytest.approx(rows["full"]["return_mean"]) and rows["full"]["regret"] is None
    # The records say what was run, not where.
    assert "tank.eq" not in (tmp_path / "records/smoke-control.jsonl").read_text()
    monkeypatch.chdir(tmp_path)
    assert main(["--env", "tank.eq", "--out", "runs", "--resume", "--seeds", "2", "--quiet"]) == 0
    path.write_text(TANK.replace("policy full", "policy fuller"), encoding="utf-8")
    assert main(["--env", "tank.eq", "--out", "runs", "--resume", "--seeds", "2", "--quiet"]) == 1
    assert "is another run (checksum" in capsys.readouterr().err


def test_a_configuration_brings_processes_of_its_own(tmp_path):
    pytest.importorskip("yaml")
    (tmp_path / "models").mkdir()
    (tmp_path / "models/tank.eq").write_text(TANK, encoding="utf-8")
    config = tmp_path / "own.yaml"
    config.write_text(
        "processes: {High: {model: models/tank.eq, arguments: {reward: height}, num_envs: 5, "
        "steps: {short: {search: 7}}}}"
    )
    assert {one.env for one in runs("control", "smoke", None, 1, config=config)} == {*SUBJECTS, "High"}
    (row,) = benchmark(tmp_path / "runs", env="High", config=config, algorithms=["nominal"])["rows"]
    assert row["env"] == "High" and row["mean"] == pytest.approx(1, rel=1e-7)  # actions are single precision
    (one,) = runs("online", "short", "High", 1, ["ARS"], config)
    assert (one.settings["steps"], one.settings["num_envs"], one.arguments) == (7, 4, {"reward": "height"})
    # What a configuration says of a model that is given by its path holds for it too.
    config.write_text("processes: {Tank: {segments: {short: 3}, controllers: {none: 'constant:0'}}}")
    found = benchmark(tmp_path / "own", env=str(tmp_path / "models/tank.eq"), config=config, algorithms=["none"])
    # Without inflow sqrt(h) falls by a tenth a second, from 1 m: after six seconds it is 0.4 m^(1/2).
    levels = [(1 - 0.1 * k) ** 2 for k in range(1, 7)]
    assert found["rows"][0]["return_mean"] == pytest.approx(-sum((h - 1) ** 2 for h in levels), rel=1e-5)
    (one,) = runs("online", "short", str(tmp_path / "models/tank.eq"), 1, ["PPO"], config)
    assert one.env == "Tank" and one.settings["segments"] == 3
    for text, says in (
        ("processes: {Tnk: {segments: {short: 3}}}", "'Tnk'"),
        ("processes: {Beer: {model: models/tank.eq}}", "'model'"),
        ("processes: {a/b: {model: models/tank.eq}}", "'a/b' in processes: expected letters"),
        ("processes: {Tank: {controllers: {'a:b': nominal}}}", "'a:b' in processes: expected letters"),
        ("processes: {Tank: {controllers: nominal}}", "controllers is 'nominal', expected NAME: CONTROLLER"),
        ("processes: {Beer: {controllers: {a: nominal}}}", "'controllers'"),
        ("processes: {Tank: {model: models/other.eq}}", "is called Tank, as a process of the benchmark is"),
    ):
        config.write_text(text)
        with pytest.raises(ValueError, match=says):
            runs("online", "short", str(tmp_path / "models/tank.eq"), 1, ["PPO"], config)


def test_a_configuration_holds_several_models_of_ones_own(tmp_path):
    pytest.importorskip("yaml")
    for name in ("Tank", "Basin"):
        (tmp_path / f"{name}.eq").write_text(TANK.replace("model Tank", f"model {name}"), encoding="utf-8")
    config, path = tmp_path / "own.yaml", str(tmp_path / "Tank.eq")
    config.write_text(
        "processes: {Tank: {model: Tank.eq, num_envs: 3, arguments: {reward: height}}, "
        "Basin: {model: Basin.eq, num_envs: 2, steps: {smoke: {on_policy: 48}}, sizes: {smoke: {validation: 7}}}}"
    )
    for env in ("Tank", path):
        (one,) = runs("online", "short", env, 1, ["PPO"], config)
        assert one.settings["num_envs"] == 3 and one.arguments == {"reward": "height"} and one.model == path
    (one,) = runs("online", "smoke", "Basin", 1, ["PPO"], config)
    assert (one.settings["steps"], one.settings["validation"]) == (48, 7)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "processes: {Basin: {num_envs: 2}}",
            "unknown 'Basin'; there are: .*Beer.*; one of your own has `model: PATH`",
        ),
        ("processes: [1]", r"processes is \[1\], expected a mapping"),
        ("processes: {Beer: 3}", "processes.Beer is 3, expected a mapping"),
        ("processes: {Beer: {steps: 100}}", "processes.Beer.steps is 100, expected a mapping of smoke, short, paper"),
        (
            "processes: {Beer: {steps: {short: {onpolicy: 1}}}}",
            "steps.short: unknown 'onpolicy'; there are: offline, on_",
        ),
        ("processes: {Beer: {steps: {shrot: {}}}}", "Beer.steps: unknown 'shrot'; there are: smoke, short, paper"),
        ("processes: {Beer: {segments: {shrot: 3}}}", "Beer.segments: unknown 'shrot'; there are: smoke"),
        ("processes: {Beer: {sizes: {shrot: {}}}}", "Beer.sizes: unknown 'shrot'"),
        (
            "processes: {Beer: {algorithms: {onlin: {}}}}",
            "Beer.algorithms: unknown 'onlin'; there are: offline, online",
        ),
        ("processes: {Beer: {algorithms: {online: {PP0: {}}}}}", "algorithms.online: unknown 'PP0'; there are: PPO"),
        ("processes: {Beer: {data: {nosie: 3}}}", "data: unknown 'nosie'; there are: controller, noise, episodes"),
        ("budgets: {short: {steps: {onpolicy: 1}}}", "budgets.short.steps: unknown 'onpolicy'"),
        ("processes: {Beer: {formulation: {center: box}}}", "processes.Beer.formulation: .*unknown 'center'"),
        ("processes: {Beer: {formulation: {reach: 3}}}", "processes.Beer.formulation: reach is 3"),
        ("algorithms: {online: {PPO: 3}}", "algorithms.online.PPO is 3, expected a mapping"),
    ],
)
def test_what_a_configuration_cannot_mean_is_told(text, says, tmp_path):
    pytest.importorskip("yaml")
    (tmp_path / "own.yaml").write_text(text)
    with pytest.raises(ValueError, match=says):
        read(tmp_path / "own.yaml")


def test_several_environments_are_run_and_other_options_stand_once(tmp_path, capsys):
    for name in ("Tank", "Basin"):
        (tmp_path / f"{name}.eq").write_text(TANK.replace("model Tank", f"model {name}"), encoding="utf-8")
    (tmp_path / "Tank2.eq").write_text(TANK, encoding="utf-8")
    paths = [str(tmp_path / f"{name}.eq") for name in ("Tank", "Basin", "Tank2")]
    found = runs("control", "smoke", [paths[0], "Beer", paths[1], "smpl/Beer-v0"], 1, ["nominal"])
    assert [one.env for one in found] == ["Tank", "Beer", "Basin"]
    with pytest.raises(ValueError, match="both called Tank"):
        runs("control", "smoke", [paths[0], paths[2]], 1)
    given = ["--env", paths[0], "--env", paths[1], "--algorithm", "nominal", "--out", str(tmp_path / "runs"), "--quiet"]
    assert main(given) == 0
    assert {path.parts[-3] for path in tmp_path.glob("runs/control/*/*/seed-0")} == {"Tank", "Basin"}
    for command in (
        ["--config", "a", "--config", "b"],
        ["tune", "--env", "Beer", "--env", "MAb", "--algorithm", "PPO"],
    ):
        with pytest.raises(SystemExit):
            main(command)
        assert f"argument {command[-4] if len(command) > 4 else '--config'}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--env", "nowhere.eq"], "nowhere.eq: no such file"),
        (["--suite", "ofline"], "suite is 'ofline'; there are: control, offline, online, all"),
        (
            ["--algorithm", "pdi"],
            "algorithm is 'pdi'; there are: empc, full_information, isothermal, mpc, nominal, pid",
        ),
        (["--budget", "huge"], "budget is 'huge'; there are: smoke, short, paper"),
        (["--env", "Rector"], "env is 'Rector'; there are: Reactor, Beer"),
        (["--seeds", "0"], "seeds is 0"),
        (["--env", "Beer", "--env", "Rector"], "env is 'Rector'; there are: Reactor, Beer"),
    ],
)
def test_bad_input_of_the_benchmark_is_told_in_a_line(arguments, says, capsys, tmp_path):
    assert main([*arguments, "--out", str(tmp_path), "--quiet"]) == 1
    assert says in capsys.readouterr().err


def test_the_table_of_the_book_is_that_of_the_records(tmp_path):
    """Asterisks apart, which come when the text of a model changes; the page of the records has the command."""
    pytest.importorskip("yaml")
    page = tmp_path / "page.md"
    page.write_text((ROOT / "docs/benchmark.md").read_text(encoding="utf-8"), encoding="utf-8")
    shown = page.read_text(encoding="utf-8")
    records = ROOT / "docs/results/benchmark"
    found = benchmark(tmp_path, "all", "short", run_nothing=True, results=records)
    assert len(found["rows"]) >= 10
    place_in(page, found, places(finished("all", None, None, "short", records, tmp_path), records))
    given, made = (
        [re.sub(r"\*(?=[†‡ ])", "", line) for line in text.splitlines() if line.startswith("| ")]
        for text in (shown, page.read_text(encoding="utf-8"))
    )
    assert given == made and len(given) > 100
