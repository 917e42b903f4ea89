"""The benchmark's comparison: the same test episodes, intervals over training seeds, selection by validation."""

import dataclasses
import json
import math

import numpy as np
import pytest

import smpl
from smpl.benchmark import Run, benchmark, main, runs
from smpl.learning.plan import Plan, Task
from smpl.learning.scores import score
from smpl_benchmarks import controls, paper, tune_controls
from smpl_benchmarks.common import Row, check_same, common_rows, reference_of
from smpl_benchmarks.comparison import claim, compare
from smpl_benchmarks.data_curve import data_runs
from smpl_benchmarks.places import places
from smpl_benchmarks.records import Result, keep, place
from smpl_benchmarks.significance import (
    improvement,
    performance_profile,
    stratified_bootstrap,
    student,
    supported,
)
from smpl_benchmarks.subjects import SUBJECTS
from smpl_benchmarks.tracks import RANGES


def result(suite, controller, number, returns, validation=None, **scores):
    run = Run(suite, "paper", "Tank", controller, number, number * 1_000_000, len(returns), {})
    counts = {"failures": 0, "successes": 0, "seconds": 1.0, "steps": 10, "mean": 0.0, "std": 0.0}
    curve = [] if suite == "control" or validation is None else [{"steps": 1.0, "mean": validation, "failures": 0.0}]
    checked = {} if suite != "control" or validation is None else {"validation": {"mean": validation}}
    return Result(run, {"returns": returns, **counts, **checked, **scores}, curve, {})


# Gains over nominal per seed: tuned 1, 2, 3; learner 3, 5, 7; best on the test but not in validation: lucky 9, 9, 9.
FOUND = [
    *(result("control", "nominal", k, [0.0, 2.0], -9.0) for k in range(3)),
    *(result("control", "tuned", k, [1.0 + k, 3.0 + k], 1.0) for k in range(3)),
    *(result("control", "slow", k, [4.0]) for k in range(3)),
    *(result("online", "PPO", k, [3.0 + 2 * k, 5.0 + 2 * k], 5.0) for k in range(3)),
    *(result("online", "lucky", k, [9.0, 11.0], 0.0) for k in range(3)),
    result("online", "once", 0, [50.0, 50.0], 50.0),
]


def test_profile_and_improvement_are_the_hand_worked_ones():
    # Entries 1, 2, 3, 4: all above 0, two above 2, none above 4.
    assert performance_profile([[1, 2], [3, 4]], [0, 2, 4]).tolist() == [1.0, 0.5, 0.0]
    # Pairs (1, 0), (1, 2), (2, 0), (2, 2): won, lost, won, tied.
    assert improvement([1, 2], [0, 2]) == 2.5 / 4
    # Two tasks: 1 on the first, 1/2 on the second.
    assert improvement([[1, 7], [2, 7]], [[0, 7], [0, 7]]) == 0.75


def test_intervals_over_seeds_are_the_hand_worked_ones():
    # Mean 2, standard deviation 1, quantile 4.3027 of two degrees of freedom, sqrt(3) = 1.7321.
    assert student([1, 2, 3]) == pytest.approx((2 - 4.3027 / math.sqrt(3), 2 + 4.3027 / math.sqrt(3)))
    assert student([5.0]) == (-math.inf, math.inf)
    # A replicate of equal runs is the same matrix: 1 and 3 on the two tasks.
    assert stratified_bootstrap([[1, 3], [1, 3]]) == (2.0, 2.0)
    # Three seeds: all-lowest and all-highest replicates have probability 1/27 each, more than 2.5 %.
    assert stratified_bootstrap([1, 2, 3]) == (1.0, 3.0)


def test_a_bootstrap_of_three_seeds_alone_supports_nothing():
    assert stratified_bootstrap([0.1, 2, 4])[0] > 0 > student([0.1, 2, 4])[0]
    assert [supported(one) for one in ([0.1, 2, 4], [3, 3.1, 3.2], [-3, -3.1, -3.2], [0, 0, 0])] == [0, 1, -1, 0]


def test_students_quantiles_are_those_of_scipy():
    stats = pytest.importorskip("scipy.stats", reason="SciPy is not installed")
    for count in (2, 3, 10, 21):
        values = np.arange(count, dtype=float)
        half = stats.t.ppf(0.975, count - 1) * values.std(ddof=1) / math.sqrt(count)
        assert student(values) == pytest.approx((values.mean() - half, values.mean() + half), rel=1e-4)


def test_definitions_agree_with_rliable():
    library = pytest.importorskip("rliable.library", reason="rliable is not installed")
    metrics = pytest.importorskip("rliable.metrics", reason="rliable is not installed")
    from smpl.learning.statistics import interquartile_mean

    generator = np.random.default_rng(1)
    first, second = generator.normal(size=(7, 3)), generator.normal(0.5, size=(5, 3))
    assert interquartile_mean(first.ravel()) == pytest.approx(metrics.aggregate_iqm(first))
    assert improvement(first, second) == pytest.approx(metrics.probability_of_improvement(first, second))
    profile = [float(np.mean(first > tau)) for tau in (-1, 0, 1)]
    assert performance_profile(first, [-1, 0, 1]).tolist() == profile
    theirs = library.StratifiedBootstrap(first, random_state=np.random.RandomState(0))
    ends = theirs.conf_int(metrics.aggregate_iqm, reps=2000, method="percentile").ravel()
    assert stratified_bootstrap(first, interquartile_mean) == pytest.approx(tuple(ends), abs=0.08)


def test_rows_without_the_common_episodes_are_left_out_by_name():
    rows, left = common_rows(FOUND, 2)
    assert [row.controller for row in rows] == ["nominal", "tuned", "PPO", "lucky"]
    assert left == {
        "control slow": "1 + 1 + 1 of 3 x 2 episodes",
        "online once": "2 of 3 x 2 episodes",
    }
    # On one episode of each block the slow controller has its place.
    assert "slow" in [row.controller for row in common_rows(FOUND, 1)[0]]


def test_a_table_of_different_episodes_is_refused():
    rows = common_rows(FOUND, 2)[0]
    for change, what in (
        ({"starts": (0, 1, 2)}, "episodes"),
        ({"returns": np.zeros((3, 1))}, "episodes"),
        ({"arguments": {"scenario": "legacy"}}, "arguments"),
    ):
        with pytest.raises(ValueError, match=f"rows of different {what} in one table: PPO has .*nominal"):
            check_same([rows[0], dataclasses.replace(rows[2], **change)])


def test_the_reference_is_the_best_control_of_each_episode():
    rows = [Row("control", name, np.array([values]), (0,), {}) for name, values in (("a", [1, 5]), ("b", [4, 2]))]
    assert reference_of(rows).returns.tolist() == [[4, 5]]


def test_validation_selects_and_the_test_decides():
    found = claim(compare("Tank", FOUND))
    # `lucky` has the highest return in the test and is not selected.
    assert (found.learned.controller, found.control.controller) == ("PPO", "tuned")
    # Differences 2, 3, 4: Student's interval is 3 - 2.484 to 3 + 2.484.
    assert found.difference == 3 and found.bootstrap == (2, 4) and found.sign == 1
    assert found.student == pytest.approx((3 - 2.4842, 3 + 2.4842), abs=1e-4)
    # Gains 3, 5, 7 against 1, 2, 3: eight pairs of nine are won and one is tied.
    assert found.probability == pytest.approx(8.5 / 9)


def test_a_claim_needs_validation_scores():
    bare = [dataclasses.replace(one, curve=[], scores={**one.scores, "validation": None}) for one in FOUND]
    assert claim(compare("Tank", bare)) is None
    assert "nothing is claimed" in places(bare)["claim Tank"]


def test_places_of_the_page_are_made_from_records():
    found = places(FOUND)
    assert (
        found["best"].splitlines()[2].startswith("| Tank | 3 x 2 | 1 | tuned | +2 (+1 to +3) | PPO | +5 (+3 to +7) |")
    )
    assert "**above**" in found["best"]
    lines = found["comparison Tank"].splitlines()
    assert [line.split(" | ")[1] for line in lines[2:6]] == ["lucky", "PPO", "tuned", "nominal"]
    assert "Not re-scored on these episodes" in found["comparison Tank"] and "online once" in found["comparison Tank"]
    assert "`PPO` is above `tuned`" in found["claim Tank"]
    # The slow controller counts for the reference: 4 on the first episodes, where `tuned` has 1, 2 and 3.
    assert "| reference | 4 | +4 | 0 |" in found["reference Tank"]


# Ten seeds: PPO has the gains 3, 5, ... 21 over nominal, and 2, 3, ... 11 over the control.
MANY = [
    *FOUND,
    *(result("control", "nominal", k, [0.0, 2.0], -9.0) for k in range(3, 10)),
    *(result("control", "tuned", k, [1.0 + k, 3.0 + k], 1.0) for k in range(3, 10)),
    *(result("online", "PPO", k, [3.0 + 2 * k, 5.0 + 2 * k], 5.0) for k in range(3, 10)),
    *(result("online", "lucky", k, [9.0, 11.0], 0.0) for k in range(3, 5)),
]


def test_rows_of_ten_seeds_have_a_table_next_to_those_of_three():
    found, of_three = places(MANY), places(FOUND)
    assert all(found[one] == of_three[one] for one in ("comparison Tank", "reference Tank", "published"))
    lines = found["seeds"].splitlines()
    # Without two seeds at each end, 7, 9, ... 17 remain: mean 12. Differences 2, 3, ... 11 have the mean 6.5 and the
    # deviation 3.0277; Student's quantile of nine degrees of freedom is 2.2622.
    half = 2.2622 * math.sqrt(110 / 12) / math.sqrt(10)
    ppo, tuned = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:4])
    assert ppo[:5] == ["Tank", "online", "PPO", "10 x 2", "13"] and ppo[5].startswith("+12 (+")
    assert ppo[6:8] == ["+12", "+3"] and ppo[8] == f"+6.5 ({6.5 - half:+.4g} to {6.5 + half:+.4g}), **above**"
    assert tuned[1:3] == ["control", "tuned"] and tuned[6:] == ["+5.5", "+1", ""]
    assert (
        lines[-1]
        == "Not on all blocks, and therefore not compared: Tank online lucky (2 + 2 + 2 + 2 + 2 of 10 x 2 episodes)."
    )


def test_a_claim_has_all_blocks_that_both_selected_rows_have():
    one = claim(compare("Tank", MANY))
    assert one.difference == 6.5 and one.nominal.returns.shape == (10, 2) and one.sign == 1
    assert places(MANY)["best"].splitlines()[2].startswith("| Tank | 10 x 2 | 1 | tuned | +5.5 (")
    assert "On the 10 x 2 test episodes their returns differ by +6.5 per episode" in places(MANY)["claim Tank"]


@pytest.mark.parametrize("control", ["tuned", "nominal"])
def test_ten_seeds_without_controls_on_their_blocks_are_not_compared(control):
    few = [one for one in MANY if one.run.controller != control or one.run.number < 3]
    assert claim(compare("Tank", few)).difference == 3
    text = places(few)["seeds"]
    assert f"Tank control {control} (2 + 2 + 2 of 10 x 2 episodes)" in text
    assert ("| Tank | online | PPO |" in text) == (control == "tuned") and "above" not in text
    if control == "nominal":
        assert text.startswith("No row is compared on more than 3 training seeds.")


def test_rows_of_a_track_are_compared_with_controls_on_its_episodes():
    def moved(one, track, **changed):
        return dataclasses.replace(one, run=dataclasses.replace(one.run, track=track, env="Beer", **changed))

    # The track `raw` has the task of the main tables, `generalisation` its own episodes.
    learned = [one for one in FOUND if one.run.controller == "PPO"]
    main = [moved(one, "residual", budget="short") for one in FOUND if one.run.suite == "control"]
    found = [*main, *(moved(one, track) for one in learned for track in ("raw", "generalisation"))]
    counts = {"smoke": 1, "short": 2, "paper": 2}
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(SUBJECTS, "Beer", dataclasses.replace(SUBJECTS["Beer"], episodes=counts))
        bare = places(found)["tracks"]
        whole = places([*found, *(moved(one, "generalisation") for one in FOUND[:6])])["tracks"]
    rows = [line for line in bare.splitlines() if line.startswith("| ")][2:]
    assert rows == [
        "| raw | Beer | PPO | 3 x 2 | 6 | +5 (+3 to +7) | +3 (+0.5158 to +5.484), **above** |  | 0 |",
        "| raw | Beer | tuned | 3 x 2 | 3 | +2 (+1 to +3) |  |  | 0 |",
    ]
    assert "not compared: generalisation Beer PPO (no nominal policy)." in bare
    assert "--suite control --budget short --track generalisation --env Reactor --env Beer --out" in bare
    assert "--suite control --budget short --track raw" not in bare
    assert "| generalisation | Beer | PPO | 3 x 2 | 6 | +5 (+3 to +7) |" in whole
    assert "--track generalisation --env Reactor --out" in whole


def test_controls_run_on_the_episodes_of_a_track(tmp_path, monkeypatch):
    pytest.importorskip("yaml")
    counts = {"smoke": 1, "short": 2, "paper": 2}
    monkeypatch.setitem(SUBJECTS, "Reactor", dataclasses.replace(SUBJECTS["Reactor"], episodes=counts, validation=0))
    given = {"budget": "short", "env": "Reactor", "seeds": 1, "workers": 1, "results": tmp_path}
    benchmark(tmp_path, **given, algorithms=["nominal"], track="generalisation")
    (line,) = (tmp_path / "short-control-generalisation.jsonl").read_text().splitlines()
    task = Task.of("smpl/Reactor-v0", scenario="legacy", reward="setpoint_change")
    ranges = {"U": [49.4, 60.4], "T_f": [75.1, 78.6]}
    drawn, fixed = (
        score(Plan.of(task, "nominal", 2, randomize=one), 1, kept=0).returns.tolist() for one in (ranges, None)
    )
    assert json.loads(line)["scores"]["returns"] == pytest.approx(drawn, rel=1e-6) != pytest.approx(fixed, rel=1e-3)
    # Slow controls do not run in a track; `raw` has the controls of the main tables.
    assert {one.controller for one in runs("control", "short", "Beer", 1, track="partial")} == {
        *("profile", "isothermal", "nominal", "constant", "open_loop"),
    }
    assert {one.track for one in runs("control", "short", "Beer", 1, track="raw")} == {"residual"}
    # Those that read states without noise are not rivals of policies that see measurements.
    assert not {one.controller for one in runs("control", "short", "Reactor", 1, track="partial")} & {"lqr", "pid"}
    assert {one.controller for one in runs("control", "short", "Atropine", 1, track="partial")} == {
        "nominal",
        "constant",
    }


def test_gains_by_the_size_of_the_data_have_their_difference():
    def sized(size, gains):
        for k, gain in enumerate(gains):
            run = Run("offline", "short", "Reactor", f"PLAS-medium-{size}", k, k * 1_000_000, 2, {}, {}, track="data")
            yield Result(run, {**FOUND[0].scores, "returns": [gain, 2.0 + gain]}, [], {})

    zero = [
        dataclasses.replace(one, run=dataclasses.replace(one.run, env="Reactor", budget="short")) for one in FOUND[:3]
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(SUBJECTS, "Reactor", dataclasses.replace(SUBJECTS["Reactor"], episodes={"short": 2}))
        text = places([*zero, *sized(20, [1, 2, 3]), *sized(2000, [4, 6, 8])])["data"]
    # Differences 3, 4, 5: Student's interval is 4 - 2.484 to 4 + 2.484.
    line = "| Reactor | medium | PLAS | +2 (+1 to +3) |  |  | +6 (+4 to +8) | +4 (+1.516 to +6.484), **above** |"
    assert text.splitlines()[2:] == [line]
    assert places(FOUND)["data"] == "No row was trained on data sets of different sizes.\n"


def test_runs_of_the_suite_of_data_differ_in_their_data_only():
    pytest.importorskip("yaml")
    small, large = (
        one
        for one in data_runs("short", seeds=1, algorithms=["PLAS"])
        if one.controller in ("PLAS-medium-20", "PLAS-medium-2000")
    )
    (plain,) = runs("offline", "short", "Reactor", 1, ["PLAS"])
    assert (small.settings["data"]["episodes"], large.settings["data"]["episodes"]) == (20, 2000)
    assert {**large.settings, "data": None} == {**small.settings, "data": None}
    assert {**small.settings, "data": None} == {**plain.settings, "data": None, "algorithm": "PLAS"}
    assert (small.seed, small.episodes, small.arguments) == (plain.seed, plain.episodes, plain.arguments)
    assert place(small, controls.FILE.parent).name == "short-offline-data.jsonl"
    for what, says in (
        ({"env": "Tank"}, "env is 'Tank'"),
        ({"algorithms": ["PPO"]}, "algorithm is 'PPO'; there are: PLAS"),
    ):
        with pytest.raises(ValueError, match=says):
            data_runs("short", **what)


@pytest.mark.parametrize(("env", "name"), [(env, name) for env, one in RANGES.items() for name in one["test"]])
def test_each_parameter_that_a_track_draws_changes_returns(env, name):
    task = Task.of(f"smpl/{env}-v0", **SUBJECTS[env].arguments)
    control = controls.made(task, env, "open_loop", controls.tuned()[env]["open_loop"]["point"])
    ranges = {name: list(RANGES[env]["test"][name])}
    drawn, fixed = (score(Plan.of(task, control, 20, randomize=one), 1, kept=0).returns for one in (ranges, None))
    assert np.abs(drawn - fixed).max() > 0.5


def test_learners_by_derivatives_without_a_record_have_their_command(monkeypatch):
    monkeypatch.setattr("smpl_benchmarks.further.DERIVED", {"PPO": ("Tank",), "SHAC": ("Tank",), "DiffNMPC": ("Beer",)})
    lines = [line for line in places(FOUND)["tracks"].splitlines() if "residual" in line]
    assert len(lines) == 1 and "--track residual --env Tank --algorithm SHAC" in lines[0]


def test_returns_with_two_texts_of_a_model_are_compared(tmp_path):
    def run(name, number, returns, checksum, suite="control"):
        one = result(suite, name, number, returns)
        configuration = {**one.run.described(), "checksum": checksum}
        return dataclasses.replace(one, configuration=configuration)

    for one in (
        run("nominal", 0, [1.0, 2.0], "a"),
        run("nominal", 1, [4.0, -5.0], "a"),
        run("slow", 0, [1.0], "a"),
        run("PPO", 0, [1.0, 1.0], "a", "online"),
        # Again: the same text; another text, twice; another text with other returns; a learned row.
        run("slow", 0, [9.0], "a"),
        run("nominal", 0, [7.0, 7.0], "b"),
        run("nominal", 0, [1.0, 2.0], "c"),
        run("nominal", 1, [4.0, -4.0, 8.0], "c"),
        run("PPO", 0, [2.0, 2.0], "c", "online"),
    ):
        keep(one, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "paper-control-earlier.jsonl",
        "paper-control.jsonl",
        "paper-online.jsonl",
    ]
    # Returns 1, 2, 4 are the same; -5 and -4 differ by 1 of 5.
    assert places(FOUND, tmp_path, "paper")["checks"].splitlines()[2:] == ["| Tank | nominal | 4 | 3 | 0.2 |"]
    assert "No control was run with two texts" in places(FOUND)["checks"]


def test_the_cost_of_a_row_is_the_shortest_of_its_seeds():
    quick = dataclasses.replace(FOUND[9], scores={**FOUND[9].scores, "seconds": 30.0})
    slow = dataclasses.replace(FOUND[10], scores={**FOUND[10].scores, "seconds": 300.0})
    lines = places([*FOUND[:3], quick, slow])["cost"].splitlines()
    assert lines[0] == "| suite | row | Tank |" and lines[2:] == ["| online | PPO | 0.5 |"]


def test_every_published_figure_is_printed_with_its_mark():
    text = places(FOUND)["published"]
    assert text.count("\n| ") == len(paper.LEARNED) + len(paper.CONTROL) + 1
    assert "| MAb | control | mpc | 1322.5 ± 174.75 | not run | not run | yes: scenario, reward |" in text
    assert f"{paper.ROWS - len(paper.LEARNED)} are not" in text


def test_tracks_have_runs_and_records_of_their_own():
    pytest.importorskip("yaml")
    (plain,) = runs("online", "short", "Reactor", 1, ["PPO"])
    (raw,) = runs("online", "short", "Reactor", 1, ["PPO"], track="raw")
    assert plain.settings["formulation"] and raw.settings["formulation"] == {} and raw.settings["train"] == {}
    assert "track" not in plain.described() and raw.described()["track"] == "raw"
    assert [place(one, controls.FILE.parent).name for one in (plain, raw)] == [
        "short-online.jsonl",
        "short-online-raw.jsonl",
    ]
    (partial,) = runs("online", "short", "Reactor", 1, ["SAC"], track="partial")
    assert partial.task().model.level == "online"
    (general,) = runs("online", "short", "Reactor", 1, ["PPO"], track="generalisation")
    inner, outer = general.settings["curriculum"]["U"][0][1:], general.settings["randomize"]["U"]
    assert outer[0] < inner[0] < inner[1] < outer[1]
    for track, env, says in (
        ("raws", "Beer", "track is 'raws'; there are: residual, raw"),
        ("partial", "MAbPlant", "has no process 'MAbPlant'"),
        ("constrained", "Beer", "is not trained"),
    ):
        with pytest.raises(ValueError, match=says):
            runs("online", "short", env, 1, ["PPO"], track=track)


def test_a_control_is_tuned_on_training_starts_and_then_a_row(tmp_path, monkeypatch, capsys):
    pytest.importorskip("scipy")
    small = dataclasses.replace(controls.CONTROLS["Beer"]["constant"], starts=2, evaluations=8)
    monkeypatch.setitem(controls.CONTROLS, "Beer", {"constant": small})
    out = tmp_path / "controls.json"
    assert main(["controls", "--env", "Beer", "--search", str(tmp_path), "--out", str(out), "--workers", "1"]) == 0
    found = json.loads(out.read_text())["Beer"]["constant"]
    assert found["budget"] == "differential_evolution, 8 x 2 episodes" and "Beer constant:" in capsys.readouterr().out
    # The value is the mean return of that temperature from the training starts: 9 + 7/2 (1 + share) degrees.
    task = Task.of("smpl/Beer-v0", scenario="legacy")
    temperature = smpl.controllers.Constant([9 + 3.5 * (1 + found["point"][0])])
    same = score(Plan.of(task, temperature, 2, seed=tune_controls.TRAINING), 1, kept=0).returns.mean()
    assert found["value"] == pytest.approx(same)
    monkeypatch.setattr(controls, "FILE", out)
    monkeypatch.setattr(controls.tuned, "__defaults__", (out,))
    names = [one.controller for one in runs("control", "short", "Beer", 1)]
    assert "constant" in names and "constant" not in [one.controller for one in runs("control", "smoke", "Beer", 1)]


def test_a_search_that_misses_a_narrow_optimum_keeps_its_start(tmp_path, monkeypatch):
    # The level of the reactor holds only if the outflow is the inflow of 0.1 m^3/min.
    control = controls.CONTROLS["Reactor"]["constant"]
    small = dataclasses.replace(control, starts=2, evaluations=4, method="differential_evolution")
    monkeypatch.setitem(controls.CONTROLS, "Reactor", {"constant": small})
    task = Task.of("smpl/Reactor-v0", **SUBJECTS["Reactor"].arguments)
    found = tune_controls.tune(task, "Reactor", "constant", tmp_path, 1)
    nominal = score(Plan.of(task, "nominal", 2, seed=tune_controls.TRAINING), 1, kept=0).returns.mean()
    assert found["point"] == pytest.approx(control.start, abs=1e-5)
    assert found["value"] == pytest.approx(nominal, rel=1e-6)


def test_a_control_is_scored_on_validation_episodes_of_its_own(tmp_path, monkeypatch):
    counts = {"smoke": 1, "short": 2, "paper": 2}
    subject = dataclasses.replace(SUBJECTS["Beer"], episodes=counts, validation=3)
    monkeypatch.setitem(SUBJECTS, "Beer", subject)
    records = tmp_path / "records"
    given = {"budget": "short", "env": "Beer", "seeds": 3, "algorithms": ["nominal", "isothermal"], "workers": 1}
    benchmark(tmp_path, **given, results=records)
    lines = [json.loads(line)["scores"] for line in (records / "short-control.jsonl").read_text().splitlines()]
    assert ["validation" in one for one in lines] == [True, False, False] * 2
    task = Task.of("smpl/Beer-v0", scenario="legacy")
    again = score(Plan.of(task, "isothermal", 3, seed=500_000_000), 1, kept=0)
    assert lines[0]["validation"] == {
        "mean": pytest.approx(again.pooled()[0]),
        "return": pytest.approx(again.returns.mean()),
        "failures": 0,
        "episodes": 3,
    }


def test_the_page_has_the_budget_that_a_search_had(monkeypatch):
    monkeypatch.setitem(controls.CONTROLS, "Tank", controls.CONTROLS["Reactor"])
    monkeypatch.setattr(controls, "tuned", lambda: {"Tank": {"pi": {"point": [1.0], "budget": "cma, 5 x 2 episodes"}}})
    text = places(FOUND)["controls"]
    assert "| cma, 5 x 2 episodes; not run |" in text
    named = "Controls that were not run: constant, open_loop, pi, lqr, sampling."
    assert named in places(FOUND)["claim Tank"]
    assert f"| {controls.CONTROLS['Reactor']['constant'].budget}; not run |" in text


def test_controls_without_validation_are_named():
    bare = [
        dataclasses.replace(one, scores={**one.scores, "validation": None}) if one.run.controller == "nominal" else one
        for one in FOUND
    ]
    assert "Not selected, without validation scores: nominal." in places(bare)["claim Tank"]
    assert "Not selected" not in places(FOUND)["claim Tank"]


def test_the_share_of_actions_at_a_limit_is_recorded(tmp_path):
    def share(temperature):
        plan = Plan.of(Task.of("smpl/Beer-v0", max_steps=5), smpl.controllers.Constant([temperature]), 2)
        return score(plan, 1, kept=0).report()["at_limit"]

    assert [share(one) for one in (9.0, 12.0, 16.0)] == [1.0, 0.0, 1.0]
    benchmark(tmp_path, env="Beer", algorithms=["isothermal"])
    assert json.loads((tmp_path / "control/Beer/isothermal/seed-0/scores.json").read_text())["at_limit"] == 0.0


def test_longer_training_is_compared_on_the_common_episodes(tmp_path):
    # Two seeds; the first two of four episodes are common. Differences 2 and 0, means 4 and 3.
    for budget, rows in (("short", ([1.0, 3.0], [4.0, 4.0])), ("paper", ([3.0, 5.0, 90.0], [3.0, 5.0, 90.0]))):
        for k, returns in enumerate(rows):
            one = result("online", "PPO", k, returns, 1.0)
            run = dataclasses.replace(one.run, budget=budget)
            keep(dataclasses.replace(one, run=run, configuration=run.described()), tmp_path)
    line = places([], tmp_path)["longer"].splitlines()[-1]
    assert [cell.strip() for cell in line.strip("|").split("|")] == [
        "Tank",
        "PPO (online)",
        "2",
        "1",
        "4",
        "3",
        "+2, +0",
    ]


def test_rows_with_other_drawn_parameters_in_the_test_are_refused():
    def drawn(suite, controller, k, ranges):
        one = result(suite, controller, k, [1.0, 2.0])
        settings = {"randomize": ranges}
        return dataclasses.replace(one, configuration={**one.run.described(), "settings": settings})

    same = [drawn("control", "nominal", k, {"k": [1, 2]}) for k in range(3)]
    assert compare("Tank", [*same, *(drawn("online", "PPO", k, {"k": [1, 2]}) for k in range(3))]) is not None
    with pytest.raises(ValueError, match="different arguments"):
        compare("Tank", [*same, *(drawn("online", "PPO", k, {"k": [1, 3]}) for k in range(3))])
