"""Starts: conditions, blocks, failed starts as data, stored starts, trims, and steps repeated by the other method."""

import json
import math
import subprocess
import sys

import numpy as np
import pytest
import scipy.optimize

import smpl

GAS = """
model vessel
time t : s
param V : m^3 = 1 in 0.1..10
param R : J/mol/K = 8.314462618
action F : mol/s = 0 in -1..1
state N : mol = 40 in 0..1000
state T : K = 300 in 200..800
var p : Pa = 1e5
eq p*V = N*R*T
eq d/dt N = F
eq d/dt T = (300 [K] - T)/100 [s]
{conditions}
observe p in 0..1e6
episode {{ step = 1 [s], max_steps = 3 }}
"""
GAS_CONSTANT = 8.314462618


def env(source, **options):
    return smpl.Env(smpl.compile(source=source), **options)


def start(source, **options):
    """Values at the start by name."""
    made = env(source)
    made.reset(seed=1, options=options or None)
    inner = made.unwrapped
    names, values = (*inner.state_names, *inner.algebraic_names), (*inner.state, *inner.algebraic)
    return dict(zip(names, values, strict=True))


def command(*arguments):
    """Standard output of the command `smpl`."""
    words = [sys.executable, "-m", "smpl", *map(str, arguments)]
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout


def test_a_pressure_determines_the_amount_of_gas():
    found = start(GAS.format(conditions="initial eq p = 2 [bar]"))
    assert found["N"] == pytest.approx(2e5 / GAS_CONSTANT / 300, rel=1e-12)
    assert (found["T"], found["p"]) == (300, pytest.approx(2e5, rel=1e-12))


def test_free_names_the_state_that_a_condition_determines():
    found = start(GAS.format(conditions="initial eq p = 2 [bar] free T").replace("N : mol = 40", "N : mol = 50"))
    assert (found["N"], found["T"]) == (50, pytest.approx(2e5 / GAS_CONSTANT / 50, rel=1e-12))


def test_conditions_hold_for_the_parameters_of_the_episode():
    found = start(GAS.format(conditions="initial eq p = 2 [bar]"), parameters={"V": 3.0})
    assert found["N"] == pytest.approx(3 * 2e5 / GAS_CONSTANT / 300, rel=1e-12)


def test_a_given_state_drops_the_condition_that_frees_it():
    source = GAS.format(conditions="initial eq p = 2 [bar]")
    found = start(source, state={"N": 60.0})
    assert (found["N"], found["p"]) == (60, pytest.approx(60 * GAS_CONSTANT * 300, rel=1e-12))
    found = start(source, state={"T": 400.0})
    assert found["N"] == pytest.approx(2e5 / GAS_CONSTANT / 400, rel=1e-12)


CSTR = """
model cstr
time t : min
action F : 1/min = 0.5 in 0..2
state c = 0.9 in 0..2
state T = 1.0 in 0..3
state m = 0.1 in 0..5
eq d/dt c = F*(1 - c) - 2 [1/min]*exp(-1/T)*c
eq d/dt T = F*(0.5 - T) + 3 [1/min]*exp(-1/T)*c
eq d/dt m = (c - m)/2 [min]
{conditions}
observe c in 0..2
episode {{ step = 1 [min], max_steps = 3 }}
"""


def rates(c, temperature):
    reaction = math.exp(-1 / temperature) * c
    return np.array([0.5 * (1 - c) - 2 * reaction, 0.5 * (0.5 - temperature) + 3 * reaction])


def test_part_of_the_plant_starts_at_rest():
    found = start(CSTR.format(conditions="initial steady for (c, T)"))
    right = scipy.optimize.fsolve(lambda x: rates(*x), [0.9, 1.0], xtol=1e-14)
    assert [found["c"], found["T"]] == pytest.approx(right, rel=1e-9)
    assert found["m"] == 0.1


def delayed_pair(gain, of):
    """x' = 3 - x + gain*y, y' = x - y, where each reads the other one as `of` says."""
    return f"""
time t : s
state x = 1 in 0..1000
state y = 1 in 0..1000
discrete kept = y
eq d/dt x = (3 - x + {gain}*{of("y")})/1 [s]
eq d/dt y = ({"x" if "kept" in of("y") else of("x")} - y)/1 [s]
initial steady for (x, y)
observe x
episode {{ step = 0.5 [s], max_steps = 4 }}
"""


@pytest.mark.parametrize("gain", [0.5, 0.95, -3])
@pytest.mark.parametrize("of", ["delay({}, 2 [s])", "sampled({})", "initial({})", "kept"])
def test_part_of_the_plant_rests_where_it_acts_through_a_dead_time_a_sample_or_a_discrete_variable(of, gain):
    source = delayed_pair(gain, of.format)
    found = start(source)
    assert [found["x"], found["y"]] == pytest.approx([3 / (1 - gain)] * 2, rel=1e-12)
    model = smpl.compile(source=source)
    env = smpl.Env(model)
    env.reset(seed=0)
    for _ in range(4):
        env.step(np.zeros(0))
    assert env.state == pytest.approx([3 / (1 - gain)] * 2, rel=1e-12)


def test_an_integrator_behind_a_dead_time_starts_at_rest():
    """The level itself is not in the condition, only what it was."""
    source = """
time t : s
state level = 1 in 0..100
eq d/dt level = (4 - 2*delay(level, 3 [s]))/1 [s]
initial steady for level
observe level
"""
    assert start(source)["level"] == pytest.approx(2, rel=1e-12)


@pytest.mark.parametrize("of", ["sampled", "initial", "previous"])
def test_a_condition_reads_first_values_that_no_equation_reads(of):
    source = f"""
time t : s
state x = 1 in 0..10
state y = 2 in 0..10
eq d/dt x = (3 - x)/1 [s]
eq d/dt y = (x - y)/1 [s]
initial eq x = 1.5*{of}(y) + 0.25*{of}(x) free x
observe x
"""
    assert start(source)["x"] == pytest.approx(4, rel=1e-12)


def test_a_declared_value_that_reads_what_a_condition_determines_is_refused():
    source = """
time t : s
state x = 1 in 0..10
state z = 2*x in 0..100
eq d/dt x = (3 - x)/1 [s]
eq d/dt z = -z/10 [s]
initial steady for x
{more}
observe x
"""
    with pytest.raises(
        smpl.SimulationError, match="the declared value of `z` reads `x`, which a condition at the start determines"
    ):
        start(source.format(more=""))
    assert start(source.format(more="initial eq z = 2*x"))["z"] == pytest.approx(6, rel=1e-12)
    assert start(source.format(more=""), state={"z": 5})["z"] == 5
    assert start(source.format(more=""), state={"x": 1.5})["z"] == 2


def test_a_rate_is_given_at_the_start():
    found = start(CSTR.format(conditions="initial d/dt T = 0.6 [1/min]"))
    right = scipy.optimize.brentq(lambda temperature: rates(0.9, temperature)[1] - 0.6, 0.1, 1, xtol=1e-14)
    assert (found["c"], found["T"]) == (0.9, pytest.approx(right, rel=1e-9))


def test_a_loop_of_conditions_frees_an_array():
    source = """
time t : s
set tanks = 1..4
param p_0[i in tanks] : kPa = 10*i
state h[i in tanks] : m = 1 in 0..20
var p[i in tanks] : kPa = 1
eq p[i] + (p[i]/10 [kPa])^3 * 1 [kPa] = h[i]*9.81 [kPa/m] for i in tanks
eq d/dt h[i] = -h[i]/10 [s] for i in tanks
initial eq p[i] = p_0[i] for i in tanks
observe h[1] in 0..20
episode { step = 1 [s], max_steps = 3 }
"""
    found = start(source)
    for i in range(1, 5):
        assert found[f"h[{i}]"] == pytest.approx((10 * i + i**3) / 9.81, rel=1e-12)


def test_too_many_conditions_are_refused_by_line():
    source = GAS.format(conditions="initial eq p = 2 [bar]\ninitial eq p = 3 [bar]\ninitial d/dt T = 0")
    with pytest.raises(smpl.SimulationError, match="too many conditions at the start") as refused:
        env(source)
    assert ":14" in str(refused.value) and ":13" in str(refused.value)


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ("initial eq V = 2 [m^3]", "neither a state nor a variable occurs"),
        ("initial eq p = 2 [K]", "pressure"),
        ("initial eq N + T*1 [mol/K] = 4 [mol] free V", "V"),
        ("initial steady for p", "p"),
        ("initial steady for (N, T) for i in 1..2", "takes no loop"),
    ],
)
def test_conditions_that_cannot_be_are_diagnosed(condition, message):
    with pytest.raises(smpl.CompileError, match=message):
        smpl.compile(source=GAS.format(conditions=condition))


FAILED = """
model z
time t : s
state x = 2 in 0..10
var z = 0 in 0..5
var w = 1 in 0..5
eq d/dt x = -x/1 [s]
eq z*z + w = -x
eq w = z + 1
observe x in 0..10
episode { step = 1 [s], max_steps = 3 }
"""


def test_a_failed_start_is_data():
    made = env(FAILED)
    with pytest.raises(smpl.SimulationError) as failed:
        made.reset(seed=1)
    report = failed.value.start
    assert report["block"] == (1, 1)
    assert [u["name"] for u in report["unknowns"]] == ["z"]
    assert report["unknowns"][0]["bounds"] == (0, 5)
    # z*z + z + 1 + 2 has its least value of 2.75 at z = -1/2.
    assert report["equations"][0]["residual"] == pytest.approx(2.75, abs=0.01)
    assert {t["method"] for t in report["tried"]} >= {
        "Newton's method from the guess",
        "Newton's method inside of the bounds",
    }
    assert report["help"] and report["help"] in str(failed.value)
    assert smpl.SimulationError("text").start is None


def test_a_solution_outside_of_the_bounds_is_reported():
    source = FAILED.replace("eq z*z + w = -x", "eq z + w = -x")
    with pytest.raises(smpl.SimulationError, match=r"a solution has z = -1\.5, outside its bounds 0\.\.5") as failed:
        env(source).reset(seed=1)
    assert failed.value.start["other_solutions"][0] == pytest.approx([-1.5])


# Hard starts: equations in z with x = 2, a guess, and the solution (by brentq on the interval).
HARD = {
    "a guess of zero below a logarithm": ("ln(z) = -x", "z = 0 in 0..5", lambda z: math.log(z) + 2, (1e-9, 5)),
    "a root from zero": ("sqrt(z) = x", "z = 0 in 0..9", lambda z: math.sqrt(z) - 2, (0, 9)),
    "a flat exponential": ("exp(z) = 1e3*x", "z = -40 in -50..50", lambda z: math.exp(z) - 2e3, (-50, 50)),
    "an arctangent far away": (
        "atan(10*(z - x)) = 0.3",
        "z = 400 in -1000..1000",
        lambda z: math.atan(10 * (z - 2)) - 0.3,
        (-1000, 1000),
    ),
    "a wall of a tangent hyperbolicus": (
        "tanh(8*(z - 3)) = x/4",
        "z = -9 in -10..10",
        lambda z: math.tanh(8 * (z - 3)) - 0.5,
        (-10, 10),
    ),
    "a cubic beyond its turning point": (
        "z^3 - 3*z = 10*x",
        "z = 0.9 in -10..10",
        lambda z: z**3 - 3 * z - 20,
        (1, 10),
    ),
    "a quotient with a pole": ("1/z + z/100 = x", "z = 0 in 0..40", lambda z: 1 / z + z / 100 - 2, (1e-6, 10)),
    "a pH": ("10^(-z) - 10^(z - 14) = 1e-9*x", "z = 1 in 0..14", lambda z: 10**-z - 10 ** (z - 14) - 2e-9, (0, 14)),
}


@pytest.mark.parametrize("name", HARD)
def test_hard_starts_are_solved(name):
    equation, guess, function, interval = HARD[name]
    source = f"""
time t : s
state x = 2 in 0..10
var {guess}
eq {equation}
eq d/dt x = -x/1 [s]
observe x in 0..10
episode {{ step = 0.01 [s], max_steps = 3 }}
"""
    right = scipy.optimize.brentq(function, *interval, xtol=1e-15, rtol=1e-14)
    assert start(source)["z"] == pytest.approx(right, rel=1e-7)


def test_a_steady_state_is_a_stored_start(tmp_path):
    model = tmp_path / "cstr.eq"
    model.write_text(CSTR.format(conditions=""))
    stored, run = tmp_path / "s.csv", tmp_path / "run.csv"
    command("steady", model, "--out", stored)
    command("simulate", model, "--init", stored, "--out", run)
    first, *_, last = np.genfromtxt(run, delimiter=",", names=True)
    assert [first["c"], first["T"], first["m"]] == pytest.approx([last["c"], last["T"], last["m"]], rel=1e-7)
    assert rates(first["c"], first["T"]) == pytest.approx([0, 0], abs=1e-9)


def test_guesses_of_algebraic_variables_choose_the_solution():
    source = """
time t : s
state x = 4 in 0..10
var z = 1
eq z*z = x
eq d/dt x = 0
observe z in -10..10
episode { step = 1 [s], max_steps = 3 }
"""
    assert start(source)["z"] == pytest.approx(2)
    assert start(source, state={"z": -1.0})["z"] == pytest.approx(-2)


# Three tanks that level out: IDA does not get past the two ties at once.
TANKS = """
time t : s
state h1 = 3 in 0..5
state h2 = 1 in 0..5
state h3 = 2 in 0..5
let q12 = sign(h1 - h2)*sqrt(abs(h1 - h2))
let q23 = sign(h2 - h3)*sqrt(abs(h2 - h3))
eq d/dt h1 = -q12/1 [s]
eq d/dt h2 = (q12 - q23)/1 [s]
eq d/dt h3 = q23/1 [s]
observe h1 in 0..5
solver {{ method = ida, retry = {retry} }}
episode {{ step = 20 [s], max_steps = 1 }}
"""


def test_a_step_that_one_method_fails_in_is_taken_by_the_other():
    made = env(TANKS.format(retry="true"))
    made.reset(seed=1)
    _, _, terminated, truncated, info = made.step(np.zeros(0))
    assert (terminated, truncated, info["failure"]) == (False, True, "")
    assert made.unwrapped.state == pytest.approx([2, 2, 2], abs=1e-6)
    assert made.unwrapped.solver_statistics["retries"] == 1
    made = env(TANKS.format(retry="false"))
    made.reset(seed=1)
    *_, info = made.step(np.zeros(0))
    assert info["failure"].startswith("solver")


@pytest.mark.parametrize("order", [5, 4, 3])
@pytest.mark.parametrize("rtol", [1e-7, 1e-8, 1e-9])
def test_algebraic_variables_outside_of_the_error_test_stay_accurate(order, rtol):
    """A stale Jacobian left a part of each correction of z, which grew until Newton's method failed."""
    source = f"""
time t : s
state x = 1
var z = 1
eq sqrt(z) = x
eq d/dt x = -x/1 [s]
observe x in -10..10
solver {{ rtol = {rtol}, atol_factor = 1, max_order = {order}, retry = false }}
episode {{ step = 1 [s], max_steps = 1 }}
"""
    made = env(source)
    made.reset(seed=1)
    *_, info = made.step(np.zeros(0))
    assert info["failure"] == ""
    assert made.unwrapped.algebraic == pytest.approx([math.exp(-2)], abs=100 * rtol)


def test_diagnose_reports_structure_scaling_and_silent_events(tmp_path):
    model = tmp_path / "d.eq"
    model.write_text("""
time t : s
state x = 1e7 in 0..1e9 scale 1
state y = 1 in 0..2
var z = 1
var w = 1
eq z + w*w = y
eq z - w = 0.5
eq d/dt x = -x/10 [s]
eq d/dt y = -1000*(y - 1)/1 [s]
event never when y > 1.5
discrete count = 0
at never { next count = count + 1 }
observe x in 0..1e9
episode { step = 1 [s], max_steps = 5 }
""")
    found = json.loads(command("diagnose", model, "--json"))
    assert (found["states"], found["algebraic"]) == (2, sum(b["size"] for b in found["blocks"]))
    assert [s["name"] for s in found["badly_scaled"]] == ["x"]
    assert found["silent_events"] == ["never"]
    assert found["slowest"] == pytest.approx([-0.1, 0]) and found["fastest"] == pytest.approx([-1000, 0])
    assert found["wrong_entries"] == [] and found["start_failure"] is None
    text = command("diagnose", model)
    assert "never" in text and "-1000" in text


TRIM = """
model plant
time t : s
action Q : kW = 10 in 0..1000
action F : kg/s = 1 in 0.1..5
state T : K = 320 in 250..500
state h : m = 1 in 0.01..5
var p : bar = 1 in 0..50
eq ln(p/1 [bar]) = 11.7 - 3800 [K]/(T - 46 [K])
eq d/dt T = (Q - F*4.18 [kJ/kg/K]*(T - 300 [K]) - 5e-3 [kW/K]*(T - 300 [K]))/(h*400 [kJ/m/K])
eq d/dt h = (F - 0.8 [kg/s]*sqrt(h/1 [m]))/100 [kg/m]
{steady}
observe T in 250..500
episode {{ step = 1 [s], max_steps = 3 }}
"""
BOILING = 46 + 3800 / (11.7 - math.log(8.5))


def test_trim_finds_actions_for_given_states_and_variables():
    model = smpl.compile(source=TRIM.format(steady=""))
    y, u = model.trim({"p": 8.5, "h": 2.0}, ["Q", "F"])
    found = dict(zip(model.unknown_names, y, strict=True))
    flow = 0.8 * math.sqrt(2)
    assert u == pytest.approx([(flow * 4.18 + 5e-3) * (BOILING - 300), flow], rel=1e-9)
    assert [found["T"], found["h"], found["p"]] == pytest.approx([BOILING, 2, 8.5], rel=1e-9)
    with pytest.raises(ValueError, match="as many"):
        model.trim({"p": 8.5}, ["Q", "F"])
    with pytest.raises(ValueError, match="unknown 'G'"):
        model.trim({"p": 8.5}, ["G"])


def test_a_steady_block_frees_actions():
    source = TRIM.format(steady="steady { p = 8.5 [bar], h = 2 [m], free Q, F }")
    made = env(source)
    flow = 0.8 * math.sqrt(2)
    assert made.unwrapped.steady_action == pytest.approx([(flow * 4.18 + 5e-3) * (BOILING - 300), flow], rel=1e-9)
    made.reset(seed=1, options={"start": "steady"})
    assert made.unwrapped.state == pytest.approx([BOILING, 2], rel=1e-9)


@pytest.mark.parametrize(
    ("steady", "message"),
    [
        ("steady { p = 8.5 [bar], free Q, F }", "2 actions are free, 1 states and conditions are given"),
        ("steady { p = 8.5 [bar], free T }", "T"),
        ("steady { Q }", "needs `= value`"),
    ],
)
def test_trims_that_cannot_be_are_diagnosed(steady, message):
    with pytest.raises(smpl.CompileError, match=message):
        smpl.compile(source=TRIM.format(steady=steady))


def test_the_command_trims(tmp_path):
    model, stored = tmp_path / "plant.eq", tmp_path / "s.csv"
    model.write_text(TRIM.format(steady=""))
    command("steady", model, "--fix", "p=8.5", "--fix", "h=2", "--free", "Q", "--free", "F", "--out", stored)
    rows = dict(line.split(",")[::2] for line in stored.read_text().splitlines()[1:])
    assert float(rows["F"]) == pytest.approx(0.8 * math.sqrt(2), rel=1e-9)
    assert float(rows["p"]) == pytest.approx(8.5, rel=1e-9)


def test_a_disturbance_that_follows_a_file_is_not_replaced_at_reset(tmp_path):
    (tmp_path / "w.csv").write_text("t [s],T_amb [degC]\n0,10\n9,12\n")
    text = """
time t : s
disturbance T_amb : degC from "w.csv" linear
state x : K = 1
eq d/dt x = (T_amb - 0 [degC] - x)/1 [s]
observe x in 0..50
episode { step = 1 [s], max_steps = 3 }
"""
    (tmp_path / "m.eq").write_text(text)
    with pytest.raises(ValueError, match=r"'T_amb' follows a file; name another one or a number in a scenario"):
        smpl.Env(tmp_path / "m.eq").reset(options={"disturbances": {"T_amb": [1, 2, 3]}})
