"""The examples of the pages on control run, and say what the pages say."""

import contextlib
import io
import re
from pathlib import Path

import numpy as np
import pytest

import smpl
from smpl.controllers import LQG, LQR, ExtendedKalmanFilter, MovingHorizonEstimator
from smpl.controllers.tuning import tune
from smpl.evaluation import run_episode

ROOT = Path(__file__).resolve().parents[2]
PROBLEMS = ROOT / "tests" / "problems"
TANKS = {  # Johansson 2000, tables I and II: levels, inputs, gains, time constants
    (): ([12.4, 12.7, 1.8, 1.4], 3.0, [[2.6, 1.5], [1.4, 2.8]], [62, 90, 23, 30]),
    ("nonminimum_phase",): ([12.6, 13.0, 4.8, 4.9], 3.15, [[1.5, 2.5], [2.5, 1.6]], [63, 91, 39, 56]),
}


@pytest.mark.parametrize("page", ["control.md", "plants.md"])
def test_the_examples_of_the_page_run(page, tmp_path, monkeypatch):
    pytest.importorskip("scipy")
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```$", text, re.S | re.M)
    if page == "control.md":
        try:
            import sklearn  # noqa: F401
        except ImportError:
            blocks = [block for block in blocks if "BayesianOptimization" not in block]
    try:
        import casadi  # noqa: F401
    except ImportError:
        blocks = [block for block in blocks if "NMPC" not in block]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tests").symlink_to(ROOT / "tests")
    scope = {}
    with contextlib.redirect_stdout(io.StringIO()):
        for block in blocks:
            exec(compile(block, page, "exec"), scope)
    assert len(blocks) >= 2


@pytest.mark.parametrize("variants", TANKS)
def test_the_four_tanks_have_the_published_gains_and_time_constants(variants):
    levels, volts, gains, times = TANKS[variants]
    model = smpl.compile(PROBLEMS / "four_tanks.eq", variants=variants)
    u = np.array([volts, volts])
    y = model.steady_state(u)
    np.testing.assert_allclose(y, levels, atol=0.2)
    A, B, C, D = model.linearize(y, u)
    np.testing.assert_allclose(D - C @ np.linalg.solve(A, B), gains, atol=0.08)
    np.testing.assert_allclose(sorted(-1 / np.linalg.eigvals(A).real), sorted(times), rtol=0.02)


@pytest.mark.parametrize(("variants", "zeros"), [((), [-0.060, -0.018]), (("nonminimum_phase",), [-0.057, 0.013])])
def test_the_zeros_of_the_four_tanks_are_where_the_paper_has_them(variants, zeros):
    linalg = pytest.importorskip("scipy.linalg")
    model = smpl.compile(PROBLEMS / "four_tanks.eq", variants=variants)
    regulator = LQR(model)
    A, B, C, D = regulator.system
    pencil = np.block([[A, B], [C, D]])
    found = linalg.eigvals(pencil, np.diag([1.0] * 4 + [0.0] * 2))
    finite = np.sort(found[np.isfinite(found) & (np.abs(found) < 1e3)].real)
    np.testing.assert_allclose(finite, zeros, atol=2e-3)


def test_the_reactor_of_van_de_vusse_rests_where_the_paper_has_it():
    model = smpl.compile(PROBLEMS / "van_de_vusse.eq")
    difference = model.steady_state([14.19, -1113.5]) - [2.14, 1.09, 114.2, 112.9]
    # To the digits that are printed.
    assert (np.abs(difference) <= [5e-3, 5e-3, 0.05, 0.05]).all()


def test_a_loop_tuned_from_the_file_brings_the_reactor_to_another_temperature():
    pytest.importorskip("scipy")
    model = smpl.compile(PROBLEMS / "van_de_vusse.eq")
    loop = tune(model, "T", "Q_K", closed_loop=0.03, set_point=116.0)
    episode = run_episode(smpl.Env(model, normalize=False), loop, 0, {"start": "steady"})
    assert episode.states[-1, 2] == pytest.approx(116.0, abs=0.02)


@pytest.mark.parametrize("kind", [ExtendedKalmanFilter, MovingHorizonEstimator])
def test_the_four_tanks_are_held_by_an_estimate_from_two_noisy_levels(kind):
    pytest.importorskip("scipy")
    model = smpl.compile(PROBLEMS / "four_tanks.eq", observation="noisy")
    env = smpl.Env(model, normalize=False, max_steps=60)
    estimator = kind(env, deviation={"h_3": 1.0, "h_4": 1.0})
    episode = run_episode(env, LQG(LQR(smpl.compile(PROBLEMS / "four_tanks.eq")), estimator), 1)
    np.testing.assert_allclose(episode.states[-1], env.steady_state, atol=0.6)
