"""Information of experiments and designs, against closed forms, NumPy and exhaustive searches."""

import itertools

import numpy as np
import pytest

import smpl
from smpl.analysis.design import DesignOptions, design
from smpl.analysis.information import information

DECAY = """
model Decay
time t : h
episode { step = 1 [h], max_steps = 20, error_reward = 0 }
param k : 1/h = 0.3 in 0.01..5
param b : 1/h = 0.1 in 0.01..5
state x = 2 in 0..100
eq d/dt x = -(k + b)*x
reward r default = 0
level noisy { observe x noise normal(0, 0.05) }
"""
# Each step is a measurement at a level of the action; the start is one at 0.
STATIC = """
model Static
time t : h
episode {{ step = 1 [h], max_steps = 20, error_reward = 0 }}
action s = 0 in 0..10
param v = 2 in 0.1..10
param K = 3 in 0.1..20
state x = 0
eq d/dt x = 0 [1/h]
let rate = {rate}
reward r default = 0
level noisy {{ observe rate noise normal(0, 0.1) }}
"""
LAG = """
model Lag
time t : h
episode { step = 0.5 [h], max_steps = 20, error_reward = 0 }
action u = 0.5 in 0..1
param tau : h = 2 in 0.1..20
param gain = 1.5 in 0.1..20
state y = 0
eq tau * d/dt y = gain*u - y
reward r default = 0
level noisy { observe y noise normal(0, 0.01) }
"""


def compiled(text):
    return smpl.compile(source=text, observation="noisy")


def test_information_is_that_of_the_closed_form():
    """dx/dk = -t x_0 exp(-(k + b) t) at t = 0, 1, ..., 8, with deviations of 0.05."""
    times = np.arange(9.0)
    slopes = -times * 2 * np.exp(-0.4 * times) / 0.05
    found = information(compiled(DECAY), np.zeros((8, 0)), ["k"])
    assert found.matrix[0, 0] == pytest.approx(slopes @ slopes, rel=1e-6)
    assert found.deviation["k"] == pytest.approx(1 / np.linalg.norm(slopes), rel=1e-6)
    assert (found.samples, found.ends, found.derivatives) == (9, (8,), "exact")
    assert found.collinearity == pytest.approx(1.0)


def test_information_bounds_the_spread_of_fits():
    """The interval of a fit is the quantile of the normal distribution times the deviation."""
    model = compiled(DECAY)
    times = np.arange(9.0)
    table = {"step": times, "x": np.full(9, np.nan), "obs.x": 2 * np.exp(-0.4 * times)}
    table["x"][0] = 2.0
    fitted = smpl.fit(model, table, {"k": 0.3})
    found = information(model, table, {"k": fitted.parameters["k"]})
    low, high = fitted.interval["k"]
    assert (high - low) / 2 == pytest.approx(1.959964 * found.deviation["k"], rel=1e-5)


def test_a_sum_of_rates_is_not_two_rates():
    found = information(compiled(DECAY), np.zeros((8, 0)), ["k", "b"])
    assert found.indistinct == (("k", "b"),)
    assert found.deviation == {"k": np.inf, "b": np.inf}
    assert found.collinearity > 1e4
    # Only the sum 0.3 dk/k + 0.1 db/b shows: the other direction is (0.1, -0.3), of length 1.
    assert np.abs(found.directions[1]) == pytest.approx(np.array([0.1, 0.3]) / np.hypot(0.1, 0.3), abs=1e-4)
    assert "only a combination is determined of: k, b" in str(found)


def test_a_parameter_without_effect_is_named():
    text = DECAY.replace("state x", "param idle = 1 in 0..2\nlet shown = idle*x\nstate x")
    found = information(compiled(text), np.zeros((4, 0)), ["k", "idle"])
    assert found.silent == ("idle",)
    assert found.deviation["idle"] == np.inf
    assert np.isfinite(found.deviation["k"])
    assert "no effect on the samples: idle" in str(found)


def test_samples_are_those_of_the_sensor():
    """Every third step: at 0, 3 and 6; the reading of the start is one of them."""
    text = DECAY.replace("observe x noise", "observe x every 3 noise")
    times = np.array([0.0, 3.0, 6.0])
    slopes = -times * 2 * np.exp(-0.4 * times) / 0.05
    found = information(compiled(text), np.zeros((8, 0)), ["k"])
    assert found.samples == 3
    assert found.matrix[0, 0] == pytest.approx(slopes @ slopes, rel=1e-5)


def test_samples_after_a_failure_do_not_count():
    """x falls below 0.5 within the fourth step: exp(-0.4 t) = 0.25 at 3.47."""
    found = information(compiled(DECAY + "fail low when x < 0.5\n"), np.zeros((8, 0)), ["k"])
    assert found.ends == (4,)
    assert found.samples == 5


def test_a_prior_adds_its_information():
    model = compiled(DECAY)
    alone = information(model, np.zeros((8, 0)), ["k", "b"])
    # A measurement of b with a deviation of 0.01 makes k determined as well.
    prior = np.diag([0.0, 1 / 0.01**2])
    found = information(model, np.zeros((8, 0)), ["k", "b"], prior=prior)
    np.testing.assert_allclose(found.matrix, alone.matrix + prior, rtol=1e-9)
    covariance = np.linalg.inv(found.matrix)
    assert found.deviation["k"] == pytest.approx(covariance[0, 0] ** 0.5, rel=1e-6)
    assert found.correlation[0, 1] == pytest.approx(
        covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]), rel=1e-6
    )
    again = information(model, np.zeros((8, 0)), ["k", "b"], prior=found)
    np.testing.assert_allclose(again.matrix, 2 * alone.matrix + prior, rtol=1e-9)


def test_experiments_add_up():
    """Two runs, one with an unknown start: the start is one more number, and information is a sum."""
    model = compiled(LAG)
    first, second = np.full((6, 1), 1.0), np.linspace(0, 1, 6)[:, None]
    both = information(model, [first, second], ["tau", "gain"])
    parts = [information(model, one, ["tau", "gain"]).matrix for one in (first, second)]
    np.testing.assert_allclose(both.matrix, parts[0] + parts[1], rtol=1e-9)
    known = information(model, first, ["tau"])
    unknown = information(model, first, ["tau"], initial=["y"])
    assert unknown.names == ("tau", "run 0: y")
    assert unknown.deviation["tau"] > known.deviation["tau"]


def test_the_design_of_michaelis_and_menten_has_its_two_known_levels():
    """D-optimal for v s/(K + s) on 0..s_max: half at s_max, half at K s_max/(2 K + s_max).

    R. G. Duggleby, Journal of Theoretical Biology 81 (1979) 671-684; here 3*10/16 = 1.875.
    """
    model = compiled(STATIC.format(rate="v*s/(K + s)"))
    found = design(model, 6, ["v", "K"])
    levels = np.sort(found.actions[:, 0])
    np.testing.assert_allclose(levels, [1.875] * 3 + [10.0] * 3, atol=0.02)
    assert found.information.samples == 7  # with that of the start, whose rate is 0
    assert found.gain == np.inf


def test_the_design_of_a_line_has_both_ends():
    """With a of N samples at 0 and b at 10 the determinant is a b 10^2 / sigma^4; here N is 6."""
    found = design(compiled(STATIC.format(rate="v*s + K")), 5, ["v", "K"])
    assert sorted(found.actions[:, 0].tolist()) == [0, 0, 10, 10, 10]
    assert np.linalg.det(found.information.matrix) == pytest.approx(3 * 3 * 10**2 / 0.1**4, rel=1e-6)


def closed_form(inputs, tau=2.0, gain=1.5, step=0.5, sigma=0.01):
    """Information about (tau, gain) of a lag, by the exact steps of its sensitivities."""
    y, of_tau, of_gain, rows = 0.0, 0.0, 0.0, []
    decay = np.exp(-step / tau)
    for u in inputs:
        # d/dt s = -(s + dy/dt)/tau for tau, -(s - u)/tau for the gain; dy/dt decays with tau too.
        slope = (gain * u - y) / tau
        of_tau = decay * (of_tau - slope * step / tau)
        of_gain = u + (of_gain - u) * decay
        y = gain * u + (y - gain * u) * decay
        rows.append([of_tau, of_gain])
    slopes = np.array(rows) / sigma
    return slopes.T @ slopes


@pytest.mark.parametrize("criterion", ["D", "A", "E"])
def test_a_dynamic_design_is_not_worse_than_all_sequences_of_two_levels(criterion):
    """All 2^10 sequences of 0 and 1, with the information from a closed form."""
    scale = np.outer([2.0, 1.5], [2.0, 1.5])

    def value(matrix):
        eigenvalues = np.maximum(np.linalg.eigvalsh(matrix * scale), 1e-9)
        return {
            "D": np.log(eigenvalues).mean(),
            "A": -np.log((1 / eigenvalues).mean()),
            "E": np.log(eigenvalues[0]),
        }[criterion]

    best = max(value(closed_form(inputs)) for inputs in itertools.product((0.0, 1.0), repeat=10))
    found = design(compiled(LAG), 10, ["tau", "gain"], criterion=criterion)
    np.testing.assert_allclose(found.information.matrix, closed_form(found.actions[:, 0]), rtol=1e-5)
    assert value(closed_form(found.actions[:, 0])) >= best - 1e-2
    nominal = value(closed_form(np.full(10, 0.5)))
    assert found.gain == pytest.approx(np.exp(value(closed_form(found.actions[:, 0])) - nominal), rel=1e-4)


def test_sequences_that_cannot_be_simulated_do_not_change_the_derivatives_of_others():
    """A tank that runs empty ends the search of a step; differences across an end are not derivatives."""
    text = """
model Tank
time t : min
param A : m^2 = 0.5
param k : m^2.5/min = 0.1
action q : m^3/min = 0.1 in 0..0.3
state h : m = 1 in 0..2
eq d/dt h = (q - k*sqrt(h)) / A
level noisy { observe h noise normal(0, 0.01) }
reward r default = 0
fail overflow when outside bounds(h)
episode { step = 1 [min], max_steps = 20, error_reward = 0 }
"""
    model = compiled(text)
    found = design(model, 20, ["A", "k"], hold=5)
    again = information(model, found.actions, ["A", "k"])
    assert found.information.derivatives == again.derivatives == "exact"
    np.testing.assert_allclose(found.information.matrix, again.matrix, rtol=1e-6)
    assert found.nominal.silent == ("A",)  # at rest the level does not depend on it


def test_a_design_keeps_its_limits_and_blocks(tmp_path):
    options = DesignOptions(hold=3, limits={"u": (0.2, 0.8)}, candidates=4, rounds=2)
    found = design(compiled(LAG), 8, ["tau", "gain"], options)
    values = found.actions[:, 0]
    assert values.min() >= 0.2
    assert values.max() <= 0.8
    assert [len(set(values[i : i + 3])) for i in (0, 3, 6)] == [1, 1, 1]
    found.write(tmp_path / "plan.csv")
    lines = (tmp_path / "plan.csv").read_text().splitlines()
    assert lines[0] == "u"
    np.testing.assert_array_equal([float(line) for line in lines[1:]], values)


def test_a_design_is_reproducible():
    one, two = (design(compiled(LAG), 6, ["tau"], candidates=5, rounds=1, seed=3) for _ in range(2))
    np.testing.assert_array_equal(one.actions, two.actions)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: information(m, np.zeros((4, 2)), ["tau"]), r"expected finite actions \(H, 1\)"),
        (lambda m: information(m, np.ones((4, 1)), ["taux"]), "parameters"),
        (lambda m: information(m, np.ones((4, 1)), ["tau"], outputs=["y"], noise={"y": -1}), "deviation above 0"),
        (lambda m: information(m, np.ones((4, 1)), ["tau"], prior=np.eye(2)), r"expected a finite matrix \(1, 1\)"),
        (lambda m: design(m, 4, ["tau"], criterion="G"), "expected one of D, A, E"),
        (lambda m: design(m, 4, ["tau"], limits={"u": (0.5, 2)}), "expected a range in 0 to 1"),
        (lambda m: design(m, 4, ["tau"], limits={"u": 3}), r"expected \(low, high\)"),
        (lambda m: design(m, 4, ["tau"], keep=["u"]), "keep names all actions"),
        (lambda m: design(m, 0, ["tau"]), "steps"),
    ],
)
def test_wrong_arguments_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call(compiled(LAG))


def test_an_output_without_a_deviation_is_refused():
    with pytest.raises(ValueError, match=r"y of the level .* has no standard deviation: give noise"):
        information(smpl.compile(source=LAG), np.ones((4, 1)), ["tau"], outputs=["y"])


def test_a_model_without_actions_has_no_design():
    with pytest.raises(ValueError, match="Decay has no action to choose"):
        design(compiled(DECAY), 4, ["k"])


# A heated kettle with a decay: the rate, its activation and the loss of heat.
KETTLE = """
model Kettle
time t : min
episode { step = 2 [min], max_steps = 100, error_reward = -500 }
param k_0 : 1/min = 0.08 in 0.001..1
param E : K = 6000 in 1000..20000
param UA : kJ/(min K) = 12 in 1..100
action Q : kJ/min = 600 in 0..1500
action F : L/min = 1 in 0..5
state c : mol/L = 1 in 0..5
state T : degC = 60 in 0..120
let k : 1/min = k_0 * exp(E * (1/(333.15 [K]) - 1/kelvin(T)))
eq d/dt c = F/(50 [L])*(2 [mol/L] - c) - k*c
eq d/dt T = F/(50 [L])*(20 [degC] - T) + (Q - UA*(T - 20 [degC])) / (209 [kJ/K])
reward r default = 0
fail boil when T > 100 [degC]
observe c, T
level noisy {
  observe T noise normal(0, 0.2)
  observe c every 3 delay 1 noise normal(0, 0.01)
}
"""


@pytest.mark.parametrize("criterion", ["D", "A", "E"])
def test_the_search_reaches_the_best_of_a_grid(criterion):
    """Rows are the best of 3^8 sequences of levels 0, 1/2, 1, found by an own integration and differences."""
    model, names = compiled(KETTLE), ["k_0", "E", "UA"]
    middle = {"D": [1500.0, 750.0], "A": [750.0, 1500.0], "E": [750.0, 1500.0]}[criterion]
    grid = np.repeat([[middle[0], 5.0], [1500.0, 0.0], [1500.0, 0.0], [middle[1], 0.0]], 2, axis=0)
    scale = np.array([0.08, 6000.0, 12.0])

    def value(found):
        sizes = np.linalg.eigvalsh(found.matrix * np.outer(scale, scale))
        return {"D": np.prod(sizes) ** (1 / 3), "A": 3 / np.sum(1 / sizes), "E": sizes[0]}[criterion]

    plan = design(model, 8, names, hold=2, criterion=criterion)
    assert value(plan.information) >= 0.999 * value(information(model, grid, names))
    assert plan.gain == pytest.approx(value(plan.information) / value(plan.nominal), rel=1e-6)
    assert "steps 0 to 1: Q = " in str(plan) and f"criterion {criterion}: " in str(plan)


def test_the_information_of_the_kettle_is_that_of_differences():
    scipy = pytest.importorskip("scipy.integrate")
    actions = np.array([[600.0, 1.0]] * 5 + [[1200.0, 2.0]] * 5 + [[300.0, 0.5]] * 6)

    def samples(values):
        k_0, E, UA = values
        rows = [np.array([1.0, 60.0])]
        for Q, F in actions:

            def rates(_, y, Q=Q, F=F):
                k = k_0 * np.exp(E * (1 / 333.15 - 1 / (y[1] + 273.15)))
                heat = F / 50 * (20 - y[1]) + (Q - UA * (y[1] - 20)) / 209
                return [F / 50 * (2 - y[0]) - k * y[0], heat]

            rows.append(scipy.solve_ivp(rates, (0, 2), rows[-1], rtol=1e-10, atol=1e-12).y[:, -1])
        found = np.array(rows)
        return np.concatenate([found[:, 1] / 0.2, found[::3, 0] / 0.01])

    point, steps = np.array([0.08, 6000.0, 12.0]), np.diag([8e-6, 0.6, 1.2e-3])
    slope = np.stack(
        [(samples(point + one) - samples(point - one)) / (2 * one.max()) for one in steps], axis=1
    )  # fmt: skip
    found = information(compiled(KETTLE), actions, ["k_0", "E", "UA"])
    np.testing.assert_allclose(found.matrix, slope.T @ slope, rtol=1e-5)


def test_a_level_without_noise_names_what_to_give():
    model = smpl.compile(source=KETTLE)
    message = r"c, T of the level 'default' .*: give noise=\{'c': \.\.\., 'T': \.\.\.\}, .*levels: noisy, full"
    for call in (lambda: information(model, np.ones((3, 2)), ["k_0"]), lambda: design(model, 3, ["k_0"])):
        with pytest.raises(ValueError, match=message):
            call()
