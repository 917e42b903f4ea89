"""The best steady states and recipes, against optima that are known."""

import time

import numpy as np
import pytest

import smpl
from smpl import optimize
from smpl.evaluation import run_episode
from smpl.optimize import Search

# A -> B -> C in a stirred tank: c_B is largest at the residence time 1/sqrt(k_1 k_2), where it is
# c_f / (1 + sqrt(k_2/k_1))^2 (O. Levenspiel, Chemical Reaction Engineering, chapter 8).
SERIES = """model Series "A -> B -> C in a stirred tank"
time t : min
param k_1 : 1/min    = 1.0
param k_2 : 1/min    = 0.25
param c_f : kmol/m^3 = 2.0
param V   : m^3      = 1.0  in 0.1..10
action q : m^3/min = 1.0 in 0.01..5
state c_A : kmol/m^3 = 1    in 0..10
state c_B : kmol/m^3 = 0.5  in 0..10
eq d/dt c_A = q/V*(c_f - c_A) - k_1*c_A
eq d/dt c_B = k_1*c_A - k_2*c_B - q/V*c_B
observe c_A, c_B
reward made default = value(q*c_B)
constraint thin when c_B < 0.6 [kmol/m^3]
episode { step = 1 [min], max_steps = 20 }
solver { rtol = 1e-9 }
"""
BEST = 2 / (1 + 0.5) ** 2

# A tank that is filled: the return over H steps is H (1 - (u - 0.3)^2 - (w - a)^2), largest at u = 0.3 and w = a.
TANK = """model Tank "a parabola to climb"
time t : s
param a = 0.7 in 0..1
param b = 0.2 in 0..1
action u = 0 in 0..1
action w = 0 in 0..1
state x = 0 in -inf..inf
initial x ~ normal(0, 1)
eq d/dt x = (u - x) / 1 [s]
disturbance d = 0 ~ normal(0, 0.1)
observe x in -100..100
reward high default = 1 - (u - 0.3)^2 - (w - a)^2 - (b - 0.5)^2 + d
episode { step = 1 [s], max_steps = 6 }
"""


@pytest.fixture(scope="module")
def series():
    return smpl.compile(source=SERIES)


@pytest.fixture(scope="module")
def tank():
    return smpl.compile(source=TANK)


@pytest.mark.parametrize(("name", "best"), [("q", 0.5), ("V", 2.0)])
def test_the_residence_time_of_a_series_reaction_is_found(series, name, best):
    found = optimize.steady(series, maximize="c_B", vary=[name])
    assert found.value == pytest.approx(BEST, rel=1e-10)
    assert found.inputs[name] == pytest.approx(best, rel=1e-4)
    assert found.stable
    assert found.converged
    assert found.active == ()
    short = optimize.steady(series, maximize="c_B", vary=[name], max_iterations=1)
    assert not short.converged
    assert "not an optimum yet" in str(short)


def test_a_search_that_runs_out_of_time_gives_the_best_point_that_keeps_the_limits(series, monkeypatch):
    # c_A = c_f/(1 + V) at q = 1 and c_B = V c_A/(1 + V/4): the start V = 1 has c_A = 1 and c_B = 0.8.
    solved = smpl.Model.steady_state

    def slow(model, *arguments, **named):
        time.sleep(0.15)
        return solved(model, *arguments, **named)

    monkeypatch.setattr(smpl.Model, "steady_state", slow)
    found = optimize.steady(series, maximize="c_B", vary=["V"], limits={"c_A": (0.3, 1.5)}, seconds=0.2)
    assert not found.converged
    assert found.evaluations <= 2
    assert "time limit" in str(found)
    assert 0.3 <= found.limits["c_A"] <= 1.5
    assert 0.8 <= found.value <= BEST
    with pytest.raises(smpl.SimulationError, match=r"no steady state that keeps all limits .* time limit"):
        optimize.steady(series, maximize="c_B", vary=["V"], limits={"c_A": (0.05, 0.1)}, seconds=0.1)
    with pytest.raises(ValueError, match="seconds"):
        optimize.steady(series, maximize="c_B", vary=["V"], seconds=0)


def test_derivatives_are_exact(series):
    # d(q c_B)/dq of the closed form, at the upper end of the range.
    found = optimize.steady(series, maximize="q*c_B", vary={"q": (0.1, 4.0)})
    assert found.inputs["q"] == 4.0
    assert found.active == ("range of q",)

    def value(q):
        return q * 2.0 * q / ((q + 1.0) * (q + 0.25))

    step = 1e-5
    assert found.value == pytest.approx(value(4.0), rel=1e-12)
    assert found.gradient["q"] == pytest.approx((value(4 + step) - value(4 - step)) / (2 * step), rel=1e-8)


def test_limits_are_kept_and_said_to_be_active(series):
    # The least flow with c_B >= 0.7 is the smaller root of 0.7 (q + 1)(q + 0.25) = 2 q.
    found = optimize.steady(series, minimize="q", vary={"q": (0.02, 4.0)}, limits={"c_B": (0.7, None)})
    expected = min(np.roots([0.7, 0.7 * 1.25 - 2, 0.175]).real)
    assert found.inputs["q"] == pytest.approx(expected, rel=1e-7)
    assert found.limits["c_B"] == pytest.approx(0.7, rel=1e-8)
    assert found.active == ("c_B",)


def test_two_inputs_with_an_equality(series):
    # With c_A = 0.5 the residence time is 3: what is left is the size, which c_B does not see and the product does.
    found = optimize.steady(series, maximize="q*c_B", vary={"q": (0.1, 2.0), "V": None}, limits={"c_A": 0.5})
    assert found.inputs["V"] / found.inputs["q"] == pytest.approx(3.0, rel=1e-6)
    assert found.inputs["q"] == pytest.approx(2.0, rel=1e-6)


def test_fixed_states_stay_at_rest():
    found = optimize.steady(
        "reactor",
        maximize="q_out*(c_Af - c_A)",
        vary=["T_c", "q_out"],
        fixed={"h": 0.6},
        limits={"T": (None, 60.0)},
    )
    # The level rests only where the outflow is the inflow; the temperature is what stops the rest.
    assert found.inputs["q_out"] == pytest.approx(0.1, rel=1e-8)
    assert found.states["T"] == pytest.approx(60.0, rel=1e-8)
    assert found.states["h"] == 0.6
    # On the line of rest the energy balance gives the coolant in closed form.
    x = found.states
    volume = np.pi * 0.219**2 * 0.6 + 1e-8
    rate = 7.2e10 * np.exp(-8750 / (x["T"] + 273.15)) * x["c_A"]
    wall = 2 * 54.94 / (0.219 * 1000 * 0.239)
    coolant = x["T"] - (0.1 / volume * (76.85 - x["T"]) + 5e4 / (1000 * 0.239) * rate) / wall
    assert found.inputs["T_c"] == pytest.approx(coolant, rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "error", "told"),
    [
        ({"maximize": "c_X", "vary": ["q"]}, ValueError, "'c_X': unknown name `c_X`"),
        ({"maximize": "c_B + q", "vary": ["q"]}, ValueError, "cannot be added"),
        ({"maximize": "c_B } #", "vary": ["q"]}, ValueError, "is not an expression"),
        ({"maximize": "c_B", "vary": ["z"]}, ValueError, "unknown 'z'"),
        ({"maximize": "c_B", "vary": {"q": (6, 7)}}, ValueError, "6 to 5"),
        ({"maximize": "c_B", "vary": ["k_1"]}, ValueError, "finite range"),
        ({"maximize": "c_B", "vary": []}, ValueError, "names nothing"),
        ({"maximize": "c_B", "minimize": "c_A", "vary": ["q"]}, ValueError, "either"),
        ({"maximize": "c_B", "vary": ["q"], "limits": {"c_B": (5, None)}}, smpl.SimulationError, "c_B is"),
        ({"maximize": "c_B", "vary": ["q"], "limits": {"c_B": (2, 1)}}, ValueError, "low below high"),
        ({"maximize": "c_B", "vary": ["q"], "start": {"V": 1}}, ValueError, "unknown 'V'"),
    ],
)
def test_what_cannot_be_done_is_said(series, arguments, error, told):
    with pytest.raises(error, match=told):
        optimize.steady(series, **arguments)


def test_states_that_the_equations_leave_free_are_named():
    with pytest.raises(ValueError, match="give 1 of h in fixed"):
        optimize.steady("reactor", maximize="T", vary=["T_c"])


def test_equations_that_read_other_instants_are_refused():
    model = smpl.compile(
        source="""model M
        time t : s
        action u = 0.5 in 0..1
        state x = 3 in 0..10
        eq d/dt x = (u - x + 2*(previous(x) - x))/1 [s]
        episode { step = 1 [s], max_steps = 5 }
        """
    )
    with pytest.raises(ValueError, match="write what they are at rest"):
        optimize.steady(model, minimize="sq(x - 0.3)", vary=["u"])


def parabola(points):
    return -((points - np.array([0.3, -0.7])) ** 2).sum(axis=1)


@pytest.mark.parametrize(
    ("method", "count", "close"), [("cma", 300, 1e-8), ("differential_evolution", 600, 1e-4), ("bayes", 30, 1e-2)]
)
def test_a_search_finds_the_top_and_goes_on_where_it_stopped(tmp_path, method, count, close):
    pytest.importorskip({"cma": "cma", "differential_evolution": "scipy", "bayes": "sklearn"}[method])
    state = np.random.get_state()[1].copy()  # noqa: NPY002
    whole = Search([-1, -2], [1, 2], method=method, seed=3)
    whole.run(parabola, count)
    assert whole.best[1] > -close
    assert np.array_equal(np.random.get_state()[1], state)  # noqa: NPY002
    file = tmp_path / "search.csv"
    Search([-1, -2], [1, 2], method=method, seed=3, file=file).run(parabola, count // 2)
    file.write_text(file.read_text(encoding="utf-8") + "0.1,0.", encoding="utf-8")  # stopped while it wrote
    evaluated = []

    def counted(points):
        evaluated.extend(points)
        return parabola(points)

    rest = Search([-1, -2], [1, 2], method=method, seed=3, file=file)
    rest.run(counted, count)
    assert len(evaluated) == count - count // 2
    np.testing.assert_array_equal(rest.points, whole.points)
    np.testing.assert_array_equal(rest.values, whole.values)


def test_a_file_of_another_search_is_refused(tmp_path):
    file = tmp_path / "search.csv"
    Search([0, 0], [1, 1], method="differential_evolution", file=file).run(parabola, 20)
    with pytest.raises(ValueError, match="another point"):
        Search([0, 0], [1, 1], method="differential_evolution", seed=1, file=file).run(parabola, 20)
    with pytest.raises(ValueError, match="its columns"):
        Search([0, 0], [1, 1], names=["a", "b"], file=file)


def test_a_value_that_is_not_finite_counts_as_the_worst():
    def half(points):
        return np.where(points[:, 0] > 0, parabola(points), np.nan)

    search = Search([-1, -2], [1, 2], method="differential_evolution", seed=0)
    search.run(half, 400)
    assert search.best[1] > -1e-2


def test_the_top_of_an_episode_is_found(tank):
    found = optimize.episode(tank, vary={"u": None, "w": None}, method="differential_evolution", evaluations=800)
    assert found.value == pytest.approx(6 * (1 - 0.09), abs=1e-3)
    assert found.inputs["u"][0] == pytest.approx(0.3, abs=0.02)
    assert found.inputs["w"][0] == pytest.approx(0.7, abs=0.02)


def test_parameters_and_moves_are_found_by_covariance_matrix_adaptation(tank):
    pytest.importorskip("cma")
    found = optimize.episode(tank, vary={"u": None, "w": None, "b": (0.1, 0.9)}, moves=2, evaluations=900)
    assert found.names == ("u[1]", "u[2]", "w[1]", "w[2]", "b")
    assert found.value == pytest.approx(6.0, abs=1e-5)
    assert found.parameters["b"] == pytest.approx(0.5, abs=1e-2)


@pytest.mark.parametrize("vary", [{"u": None}, {"u": None, "b": None}])
def test_each_start_is_the_episode_of_its_seed(tank, vary):
    found = optimize.episode(tank, vary=vary, seeds=[3, 4, 5], method="differential_evolution", evaluations=40)
    for seed, value in zip([3, 4, 5], found.each, strict=True):
        env = smpl.Env(tank, normalize=False)
        episode = run_episode(env, found.controller, seed, {"parameters": found.parameters})
        assert episode.total == pytest.approx(value, abs=1e-6)  # actions of an environment have single precision


def test_violations_are_paid_for(series):
    free = optimize.episode(series, vary={"q": (0.1, 4.0)}, evaluations=200)
    kept = optimize.episode(series, vary={"q": (0.1, 4.0)}, evaluations=200, penalty=1e3)
    assert free.inputs["q"][0] > 3.9
    # c_B = 0.6 at the larger root of 0.6 (q + 1)(q + 0.25) = 2 q, when the start is forgotten; the start is below.
    assert kept.inputs["q"][0] < 3.0


def test_a_recipe_is_saved_for_the_command(tank, tmp_path):
    found = optimize.episode(
        tank, vary={"u": None}, moves=3, shape="linear", method="differential_evolution", evaluations=6
    )
    found.save(tmp_path / "recipe.csv")
    table = np.genfromtxt(tmp_path / "recipe.csv", delimiter=",", names=True)
    assert table.dtype.names == ("u", "w")
    np.testing.assert_array_equal(table["u"], found.actions[:, 0])
    np.testing.assert_allclose(np.diff(found.actions[:, 0], 2)[[0, 2]], 0, atol=0.5)


def test_own_moves_and_own_goals(tank):
    def ramp(inputs):
        return np.stack([np.linspace(0, inputs["top"][0], 6), np.full(6, 0.7)], axis=1)

    found = optimize.episode(
        tank,
        vary={"top": (0.0, 1.0)},
        actions=ramp,
        goal=lambda rollout: -((rollout.states[:, -1, 0] - 0.4) ** 2),
        evaluations=200,
    )
    assert found.value == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"vary": {"X": (0, 1)}}, "unknown 'X'"),
        ({"vary": {"u": (3, 4)}}, "3 to 1"),
        ({"vary": ["u"], "method": "x"}, "there are: cma"),
        ({"vary": ["u"], "moves": 0}, "moves is 0"),
        ({"vary": ["u"], "shape": "s"}, "hold, linear"),
        ({"vary": ["u"], "start": {"u": [1, 2]}}, "shape"),
        ({"vary": ["u"], "seeds": []}, "seeds is empty"),
        ({"vary": ["u"], "method": "cma"}, "two numbers"),
        ({"vary": ["u"], "actions": lambda inputs: [[1.0]]}, r"expected \(6, 2\)"),
        ({"vary": ["u"], "goal": lambda rollout: 1.0}, "goal has shape"),
        ({"vary": ["u"], "base": [[0.0]]}, "base has shape"),
    ],
)
def test_what_an_episode_cannot_be_optimised_by_is_said(tank, arguments, told):
    if arguments.get("method") == "cma":
        pytest.importorskip("cma")
    with pytest.raises(ValueError, match=told):
        optimize.episode(tank, evaluations=10, **arguments)


def test_pictures_of_searches(series, tank, tmp_path):
    pytest.importorskip("matplotlib")
    for place, found in enumerate(
        (
            optimize.steady(series, maximize="c_B", vary=["q"]),
            optimize.episode(tank, vary={"u": None}, moves=3, method="differential_evolution", evaluations=30),
        )
    ):
        found.figure().savefig(tmp_path / f"{place}.png")
        assert (tmp_path / f"{place}.png").stat().st_size > 5000


@pytest.mark.parametrize("method", ["cma", "differential_evolution", "bayes"])
def test_a_search_ends_at_its_time_limit(method):
    pytest.importorskip({"cma": "cma", "differential_evolution": "scipy", "bayes": "sklearn"}[method])
    search, begin = Search([0, 0], [1, 1], method=method, seed=1), time.perf_counter()
    search.run(lambda points: time.sleep(0.1) or -np.sum(points**2, axis=1), 10**6, seconds=0.5)
    assert 2 <= len(search.values) < 10**4 and time.perf_counter() - begin < 20
    assert search.best[1] == -np.sum(search.points**2, axis=1).min()
