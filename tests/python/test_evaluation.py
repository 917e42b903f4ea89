"""Statistics, scores and reports of evaluations."""

import errno
import json
import re
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from smpl.controllers import Constant, Proportional
from smpl.evaluate import compare_controllers, main
from smpl.evaluation import evaluate, per_episode, pooled
from smpl.learning import Plan, Task
from smpl.learning.scores import Score, Summary, compare, score, settling_time
from smpl.learning.statistics import bootstrap, interquartile_mean, probability_of_improvement
from smpl.support import style
from tank import TANK


def summaries(rewards):
    made = []
    for index, values in enumerate(map(np.asarray, rewards)):
        middle = values.mean()
        made.append(
            Summary(
                index, index, len(values), values.sum(), middle, ((values - middle) ** 2).sum(), values[-1], "", "",
                False, 0.0, {}, 0, float("nan"), np.zeros(2),
            )
        )  # fmt: skip
    return made


def test_the_interquartile_mean_is_the_trimmed_mean_of_scipy():
    stats = pytest.importorskip("scipy.stats", reason="SciPy is not installed")
    generator = np.random.default_rng(0)
    for count in (1, 2, 3, 4, 5, 7, 8, 100, 101):
        values = generator.normal(size=(3, count))
        np.testing.assert_allclose(interquartile_mean(values), stats.trim_mean(values, 0.25, axis=1), rtol=1e-12)
    assert interquartile_mean([1e9, 1.0, 2.0, -1e9]) == 1.5


def test_bootstrap_intervals_are_those_of_scipy_and_cover_the_mean_as_they_promise():
    stats = pytest.importorskip("scipy.stats", reason="SciPy is not installed")
    values = np.random.default_rng(1).exponential(size=80)
    theirs = stats.bootstrap((values,), np.mean, n_resamples=20_000, method="percentile", rng=0).confidence_interval
    ours = bootstrap(values, resamples=20_000)
    # The error of a quantile of 20,000 replicates is about 1 % of their deviation.
    np.testing.assert_allclose(ours, theirs, atol=0.05 * values.std() / np.sqrt(80))
    inside = 0
    for seed in range(200):
        low, high = bootstrap(np.random.default_rng(seed).normal(size=50), seed=seed, resamples=500)
        inside += low <= 0 <= high
    assert 0.88 <= inside / 200 <= 0.99  # 95 % less the known optimism of percentiles at 50 values
    assert np.isnan(bootstrap([])).all() and bootstrap([3.0]) == (3.0, 3.0)


def test_the_probability_of_improvement_is_the_statistic_of_mann_and_whitney():
    stats = pytest.importorskip("scipy.stats", reason="SciPy is not installed")
    generator = np.random.default_rng(2)
    x, y = generator.integers(0, 10, 30), generator.integers(2, 12, 40)
    expected = stats.mannwhitneyu(x, y).statistic / (30 * 40)
    assert probability_of_improvement(x, y) == pytest.approx(expected, rel=1e-12)


def test_pooling_over_steps_gives_the_published_figures_of_a_fermentation_that_never_finishes():
    # Published: -1.9900 / 14.0014, which is 200 steps of -1 and one of -200 in each episode of 201.
    made = Score("pg", summaries([[-1.0] * 200 + [-200.0]] * 7))
    mean, deviation, steps = made.pooled()
    assert (round(mean, 4), round(deviation, 4), steps) == (-1.99, 14.0014, 7 * 201)


def test_pooling_is_over_all_steps_whatever_the_lengths():
    generator = np.random.default_rng(3)
    rewards = [generator.normal(1e6 * index, 1.0, length) for index, length in enumerate((1, 5, 300, 2))]
    together = np.concatenate(rewards)
    mean, deviation, _ = Score("x", summaries(rewards)).pooled()
    assert mean == pytest.approx(together.mean(), rel=1e-14) and deviation == pytest.approx(together.std(), rel=1e-12)


def test_a_score_is_that_of_the_episodes_run_one_by_one():
    env_arguments = {"scenario": "legacy", "reward": "setpoint_change"}
    plan, (proportional,) = compare_controllers("smpl/Reactor-v0", ["pid"], 40, **env_arguments)
    episodes = evaluate(plan.task.env(), Proportional(), 40)
    report = proportional.report()
    assert report["mean"] == pytest.approx(pooled(episodes).mean, rel=1e-12)
    assert report["std"] == pytest.approx(pooled(episodes).deviation, rel=1e-12)
    assert report["episode_mean"] == pytest.approx(per_episode(episodes).mean, rel=1e-12)
    assert report["penalized_episode_mean"] == pytest.approx(per_episode(episodes, -1000.0).mean, rel=1e-12)
    np.testing.assert_allclose(report["returns"], [episode.total for episode in episodes], rtol=1e-12)
    assert (
        report["failures"]
        == sum(bool(episode.failure) for episode in episodes)
        == report["failures_by_cause"]["state_box"]
    )


def test_the_published_row_of_the_proportional_controller_is_reproduced():
    # Published -1.0823 / 35.0924; measured with the original -1.127 / 35.75, -1.121 / 36.06, -0.894 / 32.61 with
    # 102, 100 and 83 failures of 1000 sampled starts.
    _, (one,) = compare_controllers("smpl/Reactor-v0", ["pid"], 1000, scenario="legacy", reward="setpoint_change")
    report = one.report()
    assert abs(report["failures"] - 95) < 4 * np.sqrt(95 * 0.905)
    # A failure adds a step of -1000: the deviation is little more than 1000 sqrt(failures / steps).
    share = np.sqrt(report["failures"] / report["steps"])
    assert 1000 * share < report["std"] < 1080 * share
    assert -1.6 < report["mean"] < -0.6


def test_settling_is_the_time_after_the_last_step_outside_of_the_band():
    plan = Plan.of(Task.of("reactor"), Constant([26.85, 0.1]), 1)
    env = plan.task.env()
    (one,) = evaluate(env, Proportional(), starts=[[0.9, 50.0, 0.7]])
    steady, width = env.steady_state, np.array([0.02, 2.0, 0.02])
    found = settling_time(one, steady, width)
    near = [all(abs(x - s) <= w for x, s, w in zip(row, steady, width, strict=True)) for row in one.states]
    last = max(k for k, inside in enumerate(near) if not inside)
    assert found == one.times[last + 1] > 0
    assert np.isnan(settling_time(one, steady + 1, width))


def test_where_nothing_is_steady_nothing_settles(tmp_path):
    path = tmp_path / "tank.eq"
    # The level rises by 0.1 m/s whatever it is.
    path.write_text(TANK.replace("0.2 [m^2.5/s]*sqrt(h)", "0.1 [m^3/s]") + "steady { q = 0.2 }\n", encoding="utf-8")
    _, (found,) = compare_controllers(path, ["nominal"], 2)
    report = found.report()
    assert (report["settled"], report["settling_time"]) == (None, None)
    assert report["returns"] == pytest.approx([-0.01 * sum(k * k for k in range(1, 7))] * 2, rel=1e-6)


def test_processes_and_batches_do_not_change_a_score():
    plan = Plan.of(Task.of("beer", max_steps=20), "nominal", 20, seed=5)
    one, two = score(plan, 1), score(plan, 2)
    assert one.summaries[-1].index == 19
    for a, b in zip(one.summaries, two.summaries, strict=True):
        assert repr(a) == repr(b)


def test_the_command_prints_a_table_and_writes_three_reports(tmp_path, capsys):
    arguments = ["smpl/Reactor-v0", "--controller", "pid", "--controller", "constant:26.85,0.1", "--controller", "pid"]
    arguments += ["--episodes", "30", "--seed", "15", "--out", str(tmp_path), "--quiet", "--starts", "grid:0.3:4"]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert re.search(r"^pid +-?\d", printed, re.M) and re.search(r"^pid 2 ", printed, re.M)
    report = json.loads((tmp_path / "report.json").read_text())
    first, second = report["controllers"]["pid"], report["controllers"]["pid 2"]
    assert first["returns"] == second["returns"] and len(first["returns"]) == 30
    assert report["comparisons"]["pid 2"]["difference"] == 0
    difference = report["comparisons"]["constant:26.85,0.1"]["difference"]
    other = report["controllers"]["constant:26.85,0.1"]["returns"]
    assert difference == pytest.approx(np.mean(other) - np.mean(first["returns"]), rel=1e-12)
    page, text = (tmp_path / "report.html").read_text(), (tmp_path / "report.md").read_text()
    assert "| pid |" in text and "<td>pid</td>" in page
    assert not re.search(r'(src|href)="(?!data:)', page)  # nothing outside of the file
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    assert page.count("data:image/png;base64,") >= 3 and (tmp_path / "trajectories.png").is_file()


def test_the_report_has_figures_of_one_width_and_intervals_on_one_line(tmp_path):
    image = pytest.importorskip("matplotlib.image", reason="matplotlib is not installed")
    arguments = ["smpl/Reactor-v0", "--controller", "pid", "--controller", "random", "--episodes", "3", "--quiet"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    page = (tmp_path / "report.html").read_text()
    assert re.search(r"td\{[^}]*white-space:nowrap", page) and style.FONTS in page
    assert re.search(r"<td>[\d.]+ [nµm]?s</td>", page)
    widths = {image.imread(path).shape[1] for path in tmp_path.glob("*.png")}
    assert len(widths) == 1


def test_a_controller_far_off_leaves_the_second_panel_to_the_others():
    pytest.importorskip("matplotlib", reason="matplotlib is not installed")
    from smpl.learning.pictures import _far

    times = np.arange(3.0)

    def band(low, high):
        return times, np.full(3, low), np.full(3, low), np.full(3, high)

    assert _far([band(0.0, 1.0), band(0.5, 2.0), band(-900.0, 5.0)]) == {2}
    assert _far([band(0.0, 1.0), None, band(-900.0, 5.0)]) == {2}
    assert _far([band(0.0, 1.0), band(0.5, 2.0), band(-3.0, 3.0)]) == set()
    assert _far([band(0.0, 1.0)]) == set()


@pytest.mark.parametrize(
    ("value", "unit", "written"),
    [
        (4.9637e-6, "s", "4.964 µs"),
        (4.2e6, "J/kg", "4.2 MJ/kg"),
        (2_433_073.0, "mg/h", "2.433 kg/h"),
        (26.85, "degC", "26.85 °C"),
        (12.0, "min", "12 min"),
        (7e-4, "L/min", "700 µL/min"),
        (5e6, "m^3/s", "5\u00d710⁶ m³/s"),  # the power is one of the prefix too
        (5e6, "min", "5\u00d710⁶ min"),
        (-28.32715, "1", "\u221228.33"),
        (1999.9994, "1", "2000"),
        (30, "1", "30"),
        (0.0, "kg", "0 kg"),
        (float("nan"), "1", "\u2013"),
    ],
)
def test_numbers_have_significant_digits_and_prefixes_in_place_of_powers(value, unit, written):
    assert style.quantity(value, unit) == written


def test_colours_of_figures_are_those_of_run_pictures():
    source = (Path(__file__).parents[2] / "runtime/tools/src/picture/colour.rs").read_text()
    for name in ("BLUE", "VERMILION", "GREEN", "ORANGE", "PURPLE", "SKY", "INK", "GREY", "AXIS", "GRID"):
        parts = re.search(rf"const {name}: Colour = Colour\((\d+), (\d+), (\d+)\)", source).groups()
        assert getattr(style, name) == "#" + "".join(f"{int(part):02x}" for part in parts), name


def test_a_full_disk_is_told_with_the_file_that_did_not_fit(tmp_path, monkeypatch, capsys):
    real = Path.write_bytes

    def full(path, data):
        if path.name == ".report.md.tmp":
            real(path, data[:10])
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    given = ["reactor", "--controller", "pid", "--episodes", "1", "--max-steps", "3", "--quiet", "--out", str(tmp_path)]
    assert main(given) == 1
    assert re.search(r"No space left on device: '.*/report\.md'", capsys.readouterr().err)
    assert (tmp_path / "report.json").is_file() and not list(tmp_path.glob("*report.md*"))
    assert not list(tmp_path.glob(".*"))


def test_regret_is_relative_to_the_full_information_controller():
    scores = [
        score(Plan.of(Task.of("beer", max_steps=5), name, 4), 1)
        for name in ("full_information=isothermal", "constant:11")
    ]
    found = compare(scores[1], scores[0])
    assert found["regret"] == pytest.approx(np.mean(scores[0].returns) - np.mean(scores[1].returns), rel=1e-12)
    assert found["regret_interval"] == [-found["interval"][1], -found["interval"][0]]
    assert "regret" not in compare(scores[0], scores[1])


def test_without_matplotlib_pictures_are_left_out_with_a_note(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(__import__("sys").modules, "smpl.learning.pictures", None)
    assert (
        main(["beer", "--controller", "isothermal", "--episodes", "2", "--max-steps", "5", "--out", str(tmp_path)]) == 0
    )
    assert "pip install matplotlib" in (tmp_path / "report.html").read_text()
    assert "base64" not in (tmp_path / "report.html").read_text()
    capsys.readouterr()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["reactor", "--controller", "nobody", "--episodes", "1"], "Reactor has: nominal, random, lqr, pid, mpc"),
        (["rector", "--controller", "pid", "--episodes", "1"], "did you mean 'reactor'"),
        (["reactor", "--controller", "pid", "--episodes", "0"], "episodes is 0"),
        (["reactor", "--controller", "pid", "--episodes", "1", "--reward", "x"], "setpoint"),
        (["reactor", "--controller", "pid", "--episodes", "1", "--scenario", "x"], "legacy"),
        (["reactor", "--policy", "no.pt", "--episodes", "1"], "policy file 'no.pt' is not there"),
        (["beer", "--controller", "constant:1,2", "--episodes", "1"], "action"),
        (["reactor", "--controller", "pid", "--episodes", "1", "--set", "U"], "expected NAME=VALUE"),
        (["reactor", "--controller", "pid", "--episodes", "1", "--workers", "0"], "workers is 0"),
    ],
)
def test_bad_input_of_an_evaluation_is_told_in_a_line(arguments, says, capsys):
    assert main([*arguments, "--quiet"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("error: ") and says in error


def test_an_environment_of_ones_own_is_named_with_the_module_that_registers_it(tmp_path, monkeypatch, capsys):
    (tmp_path / "registers_a_tank.py").write_text(
        "import gymnasium\n"
        "gymnasium.register('own/Tank-v0', entry_point='smpl.envs:Env', kwargs={'model': 'reactor', 'max_steps': 4})\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert main(["registers_a_tank:own/Tank-v0", "--episodes", "2", "--quiet", "--out", str(tmp_path / "own")]) == 0
    assert main(["reactor", "--max-steps", "4", "--episodes", "2", "--quiet", "--out", str(tmp_path / "plain")]) == 0
    own, plain = (json.loads((tmp_path / name / "report.json").read_text()) for name in ("own", "plain"))
    assert own["controllers"]["nominal"]["returns"] == plain["controllers"]["nominal"]["returns"]
    gymnasium.registry.pop("own/Tank-v0")
    capsys.readouterr()
    for env, says in (
        ("smpl/Rector-v0", "there is no environment 'smpl/Rector-v0'; there are: smpl/"),
        ("no_such_module:own/Tank-v0", "no_such_module"),
    ):
        assert main([env, "--episodes", "1", "--quiet"]) == 1
        assert says in capsys.readouterr().err


def test_controllers_are_called_what_one_says(tmp_path, capsys):
    given = ["--controller", "still=constant:26.85,0.1", "--controller", "as always=nominal", "--episodes", "2"]
    assert main(["reactor", *given, "--max-steps", "3", "--quiet", "--out", str(tmp_path)]) == 0
    report = json.loads((tmp_path / "report.json").read_text())
    assert list(report["controllers"]) == ["still", "as always"]
    assert report["controllers"]["still"]["returns"] == report["controllers"]["as always"]["returns"]
    capsys.readouterr()
    assert main(["reactor", "--controller", "mine=pdi", "--episodes", "2", "--quiet"]) == 1
    assert "controller is 'pdi'" in capsys.readouterr().err
