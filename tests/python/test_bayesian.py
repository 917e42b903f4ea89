"""Bayesian optimisation against closed forms and functions whose optima are published."""

import time

import numpy as np
import pytest

import smpl
from smpl.controllers import BayesianOptimization
from smpl.controllers.bayesian import expected_improvement, recipe_return

sklearn = pytest.importorskip("sklearn")


def branin(points):
    """Branin and Hoo; its least value is 0.397887."""
    x, y = points.T
    return -((y - 5.1 * x**2 / (4 * np.pi**2) + 5 * x / np.pi - 6) ** 2 + 10 * (1 - 1 / (8 * np.pi)) * np.cos(x) + 10)


BOX = {"x": (-5.0, 10.0), "y": (0.0, 15.0)}


def test_the_expected_improvement_is_that_of_a_normal_variable():
    rng = np.random.default_rng(0)
    drawn = rng.normal(0.3, 0.7, 400_000)
    exact = np.maximum(drawn - 0.5, 0).mean()
    found = expected_improvement(np.array([0.3, 1.0, 0.0]), np.array([0.7, 0.0, 0.0]), 0.5)
    np.testing.assert_allclose(found, [exact, 0.5, 0.0], atol=3e-3)


def test_the_optimum_of_branin_is_found_in_few_evaluations():
    search = BayesianOptimization(BOX, initial=8, seed=1, candidates=500)
    search.run(branin, 25)
    assert search.best[1] == pytest.approx(-0.397887, abs=0.05)
    random = branin(np.random.default_rng(1).uniform([-5, 0], [10, 15], (25, 2))).max()
    assert search.best[1] > random


def test_a_search_that_was_stopped_goes_on_as_one_that_was_not(tmp_path):
    options = {"initial": 4, "batch": 2, "seed": 3, "candidates": 200}
    whole = BayesianOptimization(BOX, **options)
    whole.run(branin, 10)
    file = tmp_path / "search.csv"
    BayesianOptimization(BOX, file=file, **options).run(branin, 6)
    with file.open("a") as text:
        text.write("1.0,2.0,-3")  # stopped in the middle of a line
    later = BayesianOptimization(BOX, file=file, **options)
    assert len(later.values) == 6
    later.run(branin, 10)
    np.testing.assert_array_equal(later.points, whole.points)
    np.testing.assert_array_equal(later.values, whole.values)
    with pytest.raises(ValueError, match="is of another search: its columns are x, y, value"):
        BayesianOptimization({"a": (0, 1)}, file=file)


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize("refit", [0.0, 0.5])
def test_the_point_asked_for_has_the_largest_expected_improvement_given_all_that_is_known(refit):
    """Compared with a Gaussian process written out here; its hyperparameters are scikit-learn's of the first ones."""
    from sklearn.gaussian_process import GaussianProcessRegressor, kernels

    x = np.array([0.1, 0.35, 0.6, 0.9, 0.2, 0.75, 0.5])
    y = np.sin(7 * x) + x
    search = BayesianOptimization([0.0], [1.0], initial=3, candidates=50, refit=refit)
    search.tell(x[:, None], y)
    (asked,) = search.ask(1)
    first = 5 if refit else 7  # 3, ceil(1.5 * 3) = 5, ceil(1.5 * 5) = 8
    mean, deviation = y[:first].mean(), y[:first].std()
    kernel = kernels.ConstantKernel(1.0, (1e-2, 1e2)) * kernels.Matern(0.5, (1e-2, 1e2), nu=2.5)
    kernel = kernel + kernels.WhiteKernel(1e-4, (1e-8, 1e0))
    fitted = GaussianProcessRegressor(kernel).fit(x[:first, None], (y[:first] - mean) / deviation).kernel_
    size, length, noise = np.exp(fitted.theta)

    def covariance(a, b):
        r = np.sqrt(5) * np.abs(a[:, None] - b[None]) / length
        return size * (1 + r + r**2 / 3) * np.exp(-r)

    def gain(points):
        inverse = np.linalg.inv(covariance(x, x) + (noise + 1e-10) * np.eye(len(x)))
        across = covariance(points, x)
        targets = (y - mean) / deviation
        variance = size + noise - np.einsum("ij,jk,ik->i", across, inverse, across)
        return expected_improvement(across @ inverse @ targets, np.sqrt(variance), targets.max(), 0.01)

    grid = np.linspace(0, 1, 20001)
    best = gain(grid)
    assert gain(asked)[0] >= best.max() * (1 - 1e-6)
    assert best.max() > 1.5 * np.median(best)


def test_points_are_random_until_two_values_are_known():
    search = BayesianOptimization([0.0], [1.0], initial=1, batch=4)
    assert search.ask().shape == (4, 1)
    search.tell([[0.5]], [1.0])
    assert search.ask().shape == (4, 1)


def test_values_that_are_not_finite_count_as_the_worst():
    search = BayesianOptimization([0.0], [1.0], initial=3, candidates=100)
    search.run(lambda points: np.where(points[:, 0] > 0.5, np.nan, points[:, 0]), 12)
    assert 0.3 < search.best[1] <= 0.5
    assert np.isnan(search.values).any()


def test_the_temperature_of_the_beer_is_found():
    """Of constant temperatures the table of the model's page has 14 degC as the best: 51.6, against 13 with 11.6."""
    model = smpl.compile("beer", scenario="legacy")
    env = smpl.Env(model, normalize=False)
    env.reset(options={"start": "nominal"})
    objective = recipe_return(model, env.state, lambda point: np.full((201, 1), point[0]))
    assert objective(np.array([[13.0]]))[0] == 12.0
    search = BayesianOptimization({"T": (12.0, 15.5)}, initial=4, batch=2, candidates=100, decimals=2)
    search.run(objective, 14)
    assert search.best[1] > 50 and 13.8 < search.best[0][0] < 15


def test_a_box_that_is_none_is_refused():
    with pytest.raises(ValueError, match="refit is 2, expected a share from 0 to 1"):
        BayesianOptimization([0.0], [1.0], refit=2)
    with pytest.raises(ValueError, match="expected \\(d,\\) and low below high"):
        BayesianOptimization([0.0, 1.0], [1.0, 1.0])
    search = BayesianOptimization([0.0], [1.0])
    with pytest.raises(ValueError, match="nothing was evaluated yet"):
        _ = search.best
    with pytest.raises(ValueError, match=r"points has shape \(1, 2\), values \(1,\), expected \(n, 1\) and \(n,\)"):
        search.tell([[0.0, 1.0]], [1.0])


def test_a_search_ends_at_its_time_limit_and_keeps_what_it_has():
    search = BayesianOptimization(BOX, initial=3, seed=1, candidates=50)
    begin = time.perf_counter()
    search.run(lambda points: time.sleep(0.2) or branin(points), 10_000, seconds=1.0)
    assert 3 <= len(search.values) < 30 and time.perf_counter() - begin < 5
    assert search.best[1] == branin(search.points).max()
    with pytest.raises(ValueError, match="seconds is 0, expected seconds above 0"):
        search.run(branin, 100, seconds=0)


def test_a_process_that_cannot_be_computed_is_a_counted_fallback(monkeypatch):
    search = BayesianOptimization(BOX, initial=3, seed=1, candidates=50)
    search.run(branin, 3)

    def fails(self, *arguments):
        raise np.linalg.LinAlgError("the kernel is not positive definite")

    monkeypatch.setattr(BayesianOptimization, "_most_promising", fails)
    point = search.ask(2)
    assert point.shape == (2, 2) and (point >= search.low).all() and (point <= search.high).all()
    assert search.fallbacks == 2 and search.last_status == "the kernel is not positive definite"
