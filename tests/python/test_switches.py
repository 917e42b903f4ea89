"""Events, comparisons and tables whose answers are known: nothing is lost inside of a control step.

All expected values are closed forms, derived next to each model. Every case runs as one control step and as many.
"""

import itertools

import numpy as np
import pytest

import smpl

METHODS = ("ida", "rosenbrock", "explicit", "auto")
methods = pytest.mark.parametrize("method", METHODS)
implicit_methods = pytest.mark.parametrize("method", ("ida", "rosenbrock", "auto"))
counts = pytest.mark.parametrize("count", [1, 3, 10, 100])


def run(text, horizon, count, method, rtol=1e-8):
    """The environment after the control steps, or after the one that fails, and its last `info`."""
    episode = f"episode {{ step = {horizon / count!r}, max_steps = {count} }}\nsolver {{ rtol = {rtol} }}"
    env = smpl.Env(smpl.compile(source=f"time t : 1\n{text}\n{episode}\n"), normalize=False, method=method)
    env.reset(seed=0)
    for _ in range(count):
        _, _, terminated, _, info = env.step([])
        if terminated:
            break
    return env, info


def state(env, name):
    return env.state[env.state_names.index(name)]


def discrete(env, name):
    return env.discrete[env.discrete_names.index(name)]


COUNTER = """
discrete hits = 0
discrete total = 0
event e when {condition}
at e {{ next hits = hits + 1 ; next total = total + t }}
"""


@methods
@counts
@pytest.mark.parametrize(("condition", "time"), [("sin(th) <= -0.5", 7 * np.pi / 6), ("sin(th) > 0.9", np.arcsin(0.9))])
def test_a_failure_happens_when_its_condition_first_holds(condition, time, count, method):
    text = f"state th = 0\neq d/dt th = 1\nfail low event {condition}"
    _, info = run(text, 20.0, count, method)
    assert info["failure"] == "low"
    assert info["time"] == pytest.approx(time, abs=1e-6)


@methods
@counts
@pytest.mark.parametrize("threshold", [0.99, 0.9999])
def test_an_event_near_the_peak_happens_in_each_of_thirty_periods(threshold, count, method):
    horizon = 60 * np.pi
    text = "state x = 0\nstate v = 1\neq d/dt x = v\neq d/dt v = -x" + COUNTER.format(condition=f"x > {threshold}")
    env, _ = run(text, horizon, count, method, rtol=1e-9)
    assert discrete(env, "hits") == 30
    times = np.arcsin(threshold) + 2 * np.pi * np.arange(30)
    assert discrete(env, "total") == pytest.approx(times.sum(), rel=1e-4)


@methods
@counts
@pytest.mark.parametrize(("than", "hits", "total"), [(">", 2, 12), (">=", 2, 12), ("<", 2, 6), ("<=", 2, 6)])
def test_three_crossings_of_a_cubic_are_found(than, hits, total, count, method):
    """y = (t - 2)(t - 6)(t - 10); below zero at the start, which is one of the events there."""
    text = "state z = -8\nstate y = -120\neq d/dt z = 1\neq d/dt y = 3*sq(z) + 12*z - 4"
    env, _ = run(text + COUNTER.format(condition=f"y {than} 0"), 12.0, count, method)
    assert discrete(env, "hits") == hits
    assert discrete(env, "total") == pytest.approx(total, abs=1e-5)


@methods
@pytest.mark.parametrize("width", [0.02, 0.05, 0.1, 0.2, 0.3, 0.4])
@pytest.mark.parametrize("centre", [0.45, 1.5, 2.55])
def test_a_parabola_that_dips_below_zero_for_a_part_of_a_control_step_fails_there(width, centre, method):
    """y = (t - centre)^2 - (width/2)^2, over three control steps of 1."""
    start = centre**2 - width**2 / 4
    text = f"state th = 0\nstate y = {start!r}\neq d/dt th = 1\neq d/dt y = 2*(th - {centre})\nfail dry event y <= 0"
    _, info = run(text, 3.0, 3, method)
    assert info["failure"] == "dry"
    assert info["time"] == pytest.approx(centre - width / 2, abs=1e-5)


@methods
@counts
@pytest.mark.parametrize(
    ("condition", "time"),
    [
        ("th > 3 and sin(th) > 0", 3),
        ("sin(th) < -0.95 and th > 2 or th > 19", 2 * np.pi - np.pi / 2 - np.arccos(0.95)),
        ("abs(th - 7) < 0.05", 6.95),
        ("min(abs(th - 7), abs(th - 3)) < 0.01", 2.99),
        ("exp(-sq((th - 11)/0.05)) > 0.5", 11 - 0.05 * np.sqrt(np.log(2))),
    ],
)
def test_a_phase_ends_when_its_condition_first_holds(condition, time, count, method):
    text = f"state th = 0\neq d/dt th = 1\ndiscrete since = -1\nphase a until {condition} then b {{ next since = t }}"
    env, _ = run(text + "\nphase b", 20.0, count, method)
    assert discrete(env, "since") == pytest.approx(time, abs=1e-5)


ALGEBRAIC = "state x = -1\neq d/dt x = 1\nvar z = 0\neq z^3 + z = x"


@implicit_methods
@counts
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
@pytest.mark.parametrize(("condition", "hits"), [("z >= 0.3", 1), ("sin(13.8338*z) >= 0.265824", 3), ("z < 0.1", 1)])
def test_an_event_of_an_algebraic_variable_happens_once_a_crossing(condition, hits, rtol, count, method):
    """z rises from -0.682 to 0.682; z < 0.1 holds at the start."""
    env, info = run(ALGEBRAIC + COUNTER.format(condition=condition), 2.0, count, method, rtol)
    assert not info["failure"]
    assert discrete(env, "hits") == hits


@implicit_methods
@counts
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-9])
def test_two_phases_with_opposite_conditions_of_an_algebraic_variable_follow_once_each(rtol, count, method):
    text = (
        f"{ALGEBRAIC}\ndiscrete hits = 0\n"
        "phase off until sin(13.8338*z) >= 0.265824 then on { next hits = hits + 1 }\n"
        "phase on until not (sin(13.8338*z) >= 0.265824) then off { next hits = hits + 1 }"
    )
    if method == "ida" and rtol == 1e-4:
        pytest.xfail("a restart corrects z by more than its distance from the threshold, and the event happens twice")
    env, info = run(text, 2.0, count, method, rtol)
    assert not info["failure"]
    assert discrete(env, "hits") == 6


@methods
@counts
@pytest.mark.parametrize(
    ("condition", "hits"),
    [
        ("mod(th, 1) < 0.05", 20),
        ("mod(th, 1) > 0.95", 19),
        ("floor(th/3) >= 4", 1),
        ("window(th) > 0.5", 1),
        ("peak(th) > 0.5", 1),
        ("sin(t) > 0.99", 3),
        ("exp(-sq((t - 7.3)/0.05)) > 0.5", 1),
    ],
)
def test_an_event_of_a_function_that_jumps_or_is_narrow_happens_each_time(condition, hits, count, method):
    text = (
        "table window over q : 1 from { 0: 0, 7.3: 1, 7.31: 0 }\n"
        "table peak over q : 1 linear { 7.3: 0, 7.35: 1, 7.4: 0 }\n"
        "state th = 0\neq d/dt th = 1\n"
    )
    env, _ = run(text + COUNTER.format(condition=condition), 19.5, count, method)
    assert discrete(env, "hits") == hits


@methods
@counts
def test_a_phase_that_is_short_next_to_a_step_ends_at_its_time(count, method):
    """A turn takes asin(0.99)/40 and 0.5."""
    text = (
        "state th = 0\neq d/dt th = 1\ndiscrete hits = 0\n"
        "phase a until sin(40*phase_time) > 0.99 then b { next hits = hits + 1 }\nphase b for 0.5 then a"
    )
    env, _ = run(text, 20.0, count, method)
    turn = np.arcsin(0.99) / 40
    assert discrete(env, "hits") == 1 + (20 - turn) // (turn + 0.5)


FLAT = [
    "max(x - 1.5, 0) > 0",
    "clip(x - 1.5, 0, 1) > 0",
    "floor(x/1.5) > 0",
    "sign(x - 1.5) > -1",
    "(if x > 1.5 then 1 else 0) > 0",
    "x*max(x - 1.5, 0) > 0",
]


@methods
@pytest.mark.parametrize(("step", "count"), [(100, 1), (20, 5), (16, 6), (1, 100)])
@pytest.mark.parametrize("condition", FLAT)
def test_a_function_that_rests_at_its_threshold_is_not_an_event(condition, step, count, method):
    """x rises towards 1, along a line that would be above 1.5 at a tenth of the long steps."""
    env, _ = run("state x = 0\neq d/dt x = 1 - x" + COUNTER.format(condition=condition), step * count, count, method)
    assert discrete(env, "hits") == 0
    _, info = run(f"state x = 0\neq d/dt x = 1 - x\nfail low event {condition}", step * count, count, method)
    assert not info["failure"]


@methods
@pytest.mark.parametrize("size", [3, 20])
@pytest.mark.parametrize(("step", "count"), [(100, 1), (16, 6), (1, 100)])
def test_a_phase_until_any_of_a_range_goes_on_while_none_holds(step, count, size, method):
    text = f"set r = 1..{size}\nstate y[i in r] = 0\neq d/dt y[i] = 1 - y[i]   for i in r\ndiscrete since = -1\n"
    text += "phase a until any(y[i] > 1.5 for i in r) then b { next since = t }\nphase b"
    env, _ = run(text, step * count, count, method)
    assert discrete(env, "since") == -1


@methods
@counts
def test_a_phase_until_any_of_a_range_ends_when_the_first_holds(count, method):
    """y[i] = sin(t + 0.01 i) - sin(0.01 i) passes 0.985 for i = 1 first."""
    text = (
        "set r = 1..20\nstate th = 0\neq d/dt th = 1\nstate y[i in r] = 0\n"
        "eq d/dt y[i] = cos(th + 0.01*i)   for i in r\ndiscrete since = -1\n"
        "phase a until any(y[i] > 0.985 for i in r) then b { next since = t }\nphase b"
    )
    env, _ = run(text, 20.0, count, method)
    assert discrete(env, "since") == pytest.approx(np.arcsin(0.985 + np.sin(0.01)) - 0.01, abs=1e-5)


# Comparisons and tables in rates.

HEATED = """
time t : min
table on over level : 1 {rows}
state level = 0
state T : degC = 20
eq d/dt level = 0.03 [1/min]
eq d/dt T = on(level) * 20 [K/min] - (T - 20 [degC]) / 60 [min]
episode {{ step = {step} [min], max_steps = {count} }}
solver {{ rtol = 1e-8 }}
"""


@methods
@pytest.mark.parametrize("step", [0.5, 1, 5, 6, 10, 15, 30])
@pytest.mark.parametrize(
    ("rows", "points", "outputs"),
    [
        ("from { 0: 0, 0.50: 1, 0.60: 0 }", [0.5, 0.6], [1, 1]),
        ("until { 0: 0, 0.50: 1, 0.60: 0 }", [0, 0.5], [1, 1]),
        ("until { 0.50: 0, 0.60: 1, 0.70: 0 }", [0.5, 0.6], [1, 1]),
        ("linear { 0: 0, 0.50: 1, 0.60: 0 }", [0, 0.5, 0.6], [0, 1, 0]),
        ("linear { 0.50: 0, 0.55: 1, 0.60: 0 }", [0.5, 0.55, 0.6], [0, 1, 0]),
    ],
)
def test_a_table_heats_while_a_rising_level_is_in_its_window(rows, points, outputs, step, method):
    """T - 20 is the convolution of the heating, a function of time, with exp(-t/60)."""
    text = HEATED.format(rows=rows, step=step, count=round(30 / step))
    env = smpl.Env(smpl.compile(source=text), normalize=False, method=method)
    env.reset(seed=0)
    for _ in range(round(30 / step)):
        env.step([])
    nodes, weights = np.polynomial.legendre.leggauss(20)
    expected = 20.0
    for a, b in itertools.pairwise(points):
        levels = 0.5 * (a + b) + 0.5 * (b - a) * nodes
        heat = 20 * np.interp(levels, points, outputs)
        expected += 0.5 * (b - a) / 0.03 * np.sum(weights * heat * np.exp(-(30 - levels / 0.03) / 60))
    assert env.state[env.state_names.index("T")] == pytest.approx(expected, abs=1e-4)


@methods
@counts
@pytest.mark.parametrize(
    ("rate", "expected"),
    [
        ("if k > 11 and k < 15 then 1 else 0", 4),
        ("if k > 11 and k < 13 then 1 else 0", 2),
        ("if k > 11 and k < 11.2 then 1 else 0", 0.2),
        ("if k < 11 or k > 11.02 then 1 else 0", 19.98),
        ("if abs(k - 7.3) < 0.05 then 10 else 0", 1),
        ("max(0, 0.1 - abs(k - 7.3))", 0.01),
        ("min(0, abs(k - 7.3) - 0.1)", -0.01),
        ("clip((k - 7.3)/0.02, 0, 1)", 12.69),
        ("sign(k - 7.3) + sign(7.5 - k)", 0.4),
        ("floor(k/3)", 3 * (1 + 2 + 3 + 4 + 5) + 2 * 6),
        ("mod(k, 0.7)", 28 * 0.245 + 0.08),
        ("if mod(k, 1) < 0.05 then 1 else 0", 1),
        ("round(k/4)", 4 * (1 + 2 + 3 + 4) + 2 * 5),
        ("if sin(k) > 0.99 then 1 else 0", 3 * 2 * np.arccos(0.99)),
        ("if exp(-sq((k - 7.3)/0.05)) > 0.5 then 1 else 0", 0.1 * np.sqrt(np.log(2))),
        ("pulse(k)", 0.1),
        ("peak(k)", 0.1),
    ],
)
def test_a_rate_that_jumps_or_bends_at_a_state_is_integrated(rate, expected, count, method):
    text = (
        "table pulse over q : 1 from { 0: 0, 7.3: 1, 7.4: 0 }\n"
        "table peak over q : 1 linear { 7.3: 0, 7.4: 1, 7.5: 0 }\n"
        f"state k = 0\nstate x = 0\neq d/dt k = 1\neq d/dt x = {rate}"
    )
    env, info = run(text, 20.0, count, method)
    assert not info["failure"]
    # IDA begins anew at order one behind each jump, within its tolerance.
    assert state(env, "x") == pytest.approx(expected, abs=1e-5 if method == "ida" else 2e-6)


def ramp(level):
    """The integral of max(0, t^2 - level) up to t = 20."""
    return (20**3 - level**1.5) / 3 - level * (20 - level**0.5)


@implicit_methods
@counts
@pytest.mark.parametrize(
    ("rate", "expected"), [("sign(z - 0.3)", -1.327 + 0.673), ("if z > 0.3 and z < 0.31 then 1 else 0", 0.012791)]
)
def test_a_rate_that_jumps_at_an_algebraic_variable_is_integrated(rate, expected, count, method):
    """z^3 + z = t - 1: z is 0.3 at t = 1.327, and 0.31 at t = 1.339791."""
    env, info = run(f"{ALGEBRAIC}\nstate y = 0\neq d/dt y = {rate}", 2.0, count, method)
    assert not info["failure"]
    assert state(env, "y") == pytest.approx(expected, abs=2e-6)


@methods
@counts
@pytest.mark.parametrize(
    ("rate", "expected"),
    [
        ("if exp(0.1*t) > 2 then 1 else 0", 20 - 10 * np.log(2)),
        ("if exp(0.1*t) > 2 and exp(0.1*t) < 2.01 then 1 else 0", 10 * np.log(2.01 / 2)),
        ("if t^2 > 50 and t^2 < 51 then 1 else 0", np.sqrt(51) - np.sqrt(50)),
        ("if sqrt(t) > 3 and sqrt(t) < 3.01 then 1 else 0", 3.01**2 - 9),
        ("if ln(1 + t) > 2 and ln(1 + t) < 2.001 then 1 else 0", np.exp(2.001) - np.exp(2)),
        ("if 1/(1 + t) < 0.1 and 1/(1 + t) > 0.0995 then 1 else 0", 1 / 0.0995 - 10),
        ("if tanh(t/10) > 0.5 and tanh(t/10) < 0.501 then 1 else 0", 10 * (np.arctanh(0.501) - np.arctanh(0.5))),
        ("pulse(t^2)", np.sqrt(51) - np.sqrt(50)),
        ("peak(t^2)", 2 * (ramp(50) - 2 * ramp(50.5) + ramp(51))),
        ("floor(t^2/100)", 3 * 20 - 10 * (1 + np.sqrt(2) + np.sqrt(3))),
        ("if sin(t) > 0.99 then 1 else 0", 3 * 2 * np.arccos(0.99)),
    ],
)
def test_a_rate_that_jumps_at_a_nonlinear_function_of_time_is_integrated(rate, expected, count, method):
    text = (
        "table pulse over q : 1 from { 0: 0, 50: 1, 51: 0 }\n"
        "table peak over q : 1 linear { 50: 0, 50.5: 1, 51: 0 }\n"
        f"state x = 0\neq d/dt x = {rate}"
    )
    env, info = run(text, 20.0, count, method)
    assert not info["failure"]
    assert state(env, "x") == pytest.approx(expected, abs=2e-6)


@methods
@pytest.mark.parametrize("count", [1, 4, 20])
@pytest.mark.parametrize("slope", [1, -1])
@pytest.mark.parametrize(
    ("rate", "up", "down"),
    [
        ("if x > 0 then 1 else 0", 20, 0),
        ("if x >= 0 then 1 else 0", 20, 0),
        ("if x < 0 then 1 else 0", 0, 20),
        ("sign(x)", 20, -20),
        ("abs(x)", 200, 200),
        ("steps(x)", 15, 0),
        ("if x > 5 and x <= 6 or x < -5 and x > -7 then 1 else 0", 1, 2),
        ("floor(x/5)", 5 * (1 + 2 + 3), -5 * (1 + 2 + 3 + 4)),
        ("max(x - 10, 0) + min(x + 10, 0)", 50, -50),
    ],
)
def test_levels_at_the_start_and_at_ends_of_control_steps_are_passed_once(rate, up, down, slope, count, method):
    """x = t or -t starts at a level, and passes others where control steps end."""
    text = (
        "table steps over q : 1 from { 0: 0, 5: 1 }\n"
        f"state x = 0\nstate y = 0\neq d/dt x = {slope}\neq d/dt y = {rate}"
    )
    env, info = run(text, 20.0, count, method)
    assert not info["failure"]
    assert state(env, "y") == pytest.approx(up if slope > 0 else down, abs=1e-4)


# Ties, and systems that come to rest.


@methods
@pytest.mark.parametrize("count", [1, 3, 10, 100, 1000])
@pytest.mark.parametrize("inflow", [0.0, 0.05])
@pytest.mark.parametrize("form", ["sign({d})*sqrt(abs({d}))", "if {d} > 0 then sqrt({d}) else -sqrt(-({d}))"])
def test_two_tanks_that_have_levelled_out_stay_level(form, inflow, count, method):
    """h1 - h2 = d has d' = -2 sign(d) sqrt|d|, so that sqrt(d) = 1 - t up to t = 1, and 0 from there on."""
    flow = form.format(d="h1 - h2")
    text = f"state h1 = 1\nstate h2 = 0\neq d/dt h1 = {inflow} - ({flow})\neq d/dt h2 = {inflow} + ({flow})"
    env, info = run(text, 20.0, count, method)
    if form.startswith("if") and info["failure"]:
        pytest.xfail("a tie of a comparison is not always found: the run fails by name")
    assert not info["failure"]
    level = 0.5 + inflow * 20
    np.testing.assert_allclose(env.state, [level, level], atol=1e-5)


@methods
@counts
def test_tanks_in_a_row_that_have_levelled_out_stay_level_or_fail_by_name(count, method):
    """All levels of the row end at their mean, as the volume is constant."""
    text = (
        "set tanks = 1..5\nstate h[i in tanks] = 0.2*i\n"
        "let q[i in 1..4] = sign(h[i] - h[i+1])*sqrt(abs(h[i] - h[i+1]))\n"
        "eq d/dt h[i] = (if i == 1 then 0 else q[i-1]) - (if i == 5 then 0 else q[i])  for i in tanks"
    )
    env, info = run(text, 100.0, count, method)
    if not info["failure"]:
        np.testing.assert_allclose(env.state, np.full(5, 0.6), atol=1e-5)


@methods
@counts
@pytest.mark.parametrize("rate", ["-sign(x)", "if x > 0 then -1 else 1"])
def test_a_tie_that_a_jump_holds_is_held_or_fails_by_name(rate, count, method):
    """x falls to 0 at t = 1, where both sides lead back to it."""
    text = f"state x = 1\nstate y = 0\neq d/dt x = {rate}\neq d/dt y = x"
    env, info = run(text, 20.0, count, method)
    if not info["failure"]:
        np.testing.assert_allclose(env.state, [0, 0.5], atol=1e-5)


@methods
@counts
def test_a_block_with_dry_friction_sticks_and_slides_or_fails_by_name(count, method):
    """v' = 1.5 sin(t) - sign(v): sticks until 1.5 sin(t) = 1, then slides until its speed is zero again."""
    text = "state v = 0\nstate th = 0\neq d/dt th = 1\neq d/dt v = 1.5*sin(th) - sign(v)"
    env, info = run(text, 2.0, count, method)
    begin = np.arcsin(1 / 1.5)
    if not info["failure"]:
        assert state(env, "v") == pytest.approx(1.5 * (np.cos(begin) - np.cos(2)) - (2 - begin), abs=1e-5)


# Derivatives across what is located inside of a step.

PARAMETER = "param p = 1.3 in 0.1..10\nstate th = 0\neq d/dt th = p"


def derivative(text, name, horizon=20.0):
    """The state after one step, and its derivatives by p: the one that is returned, and differences."""
    episode = f"episode {{ step = {horizon}, max_steps = 1 }}\nsolver {{ rtol = 1e-9 }}"
    model = smpl.compile(source=f"time t : 1\n{text}\n{episode}")
    start, k = smpl.Env(model, normalize=False), model.state_names.index(name)
    start.reset(seed=0)
    x, d = start.state, 1e-4
    after, _, _, by_parameter = model.sensitivity(x, [], parameters=("p",))
    high, low = (model.step(x, [], p={"p": 1.3 + s})[k] for s in (d, -d))
    return after[k], by_parameter[k, 0], (high - low) / (2 * d)


@pytest.mark.parametrize("condition", ["th > 9.1", "y <= 0", "exp(-sq((th - 9.2)/0.2)) > exp(-0.25)"])
def test_a_derivative_across_an_event_found_inside_of_a_step_is_that_of_its_time(condition):
    """The event is at th = 9.1, t = 7, in each form; x counts the time from there on, 20 - 9.1/p."""
    text = (
        f"{PARAMETER}\nstate y = {9.2**2 - 0.01!r}\neq d/dt y = 2*p*(th - 9.2)\n"
        f"state x = 0\neq d/dt x = 1\nevent e when {condition}\nat e {{ reset x = 0 }}"
    )
    value, found, differences = derivative(text, "x")
    assert value == pytest.approx(20 - 9.1 / 1.3, abs=1e-5)
    assert found == pytest.approx(9.1 / 1.3**2, rel=1e-4)
    assert differences == pytest.approx(9.1 / 1.3**2, rel=1e-4)


@pytest.mark.parametrize(
    ("rate", "area"),
    [
        ("if th > 9.1 and th < 9.3 then 1 else 0", 0.2),
        ("pulse(th)", 0.2),
        ("peak(th)", 0.1),
        ("max(0, 0.1 - abs(th - 9.2))", 0.01),
    ],
)
def test_a_derivative_across_a_pulse_found_inside_of_a_step_is_that_of_its_area(rate, area):
    """The integral over time of a function of th = p t is its area over p."""
    text = (
        "table pulse over q : 1 from { 0: 0, 9.1: 1, 9.3: 0 }\n"
        "table peak over q : 1 linear { 9.1: 0, 9.2: 1, 9.3: 0 }\n"
        f"{PARAMETER}\nstate x = 0\neq d/dt x = {rate}"
    )
    value, found, differences = derivative(text, "x")
    assert value == pytest.approx(area / 1.3, abs=1e-6)
    assert found == pytest.approx(-area / 1.3**2, rel=1e-3, abs=1e-6)
    assert differences == pytest.approx(-area / 1.3**2, rel=1e-3, abs=1e-5)


@pytest.mark.parametrize(
    ("factor", "area"),
    [
        ("late(t)", lambda begin, end: 3 * (end - max(begin, 5))),
        ("max(t - 5, 0)", lambda begin, end: ((end - 5) ** 2 - (begin - 5) ** 2) / 2),
        ("max(k - 5, 0)", lambda begin, end: ((end - 5) ** 2 - (begin - 5) ** 2) / 2),
        ("(if k > 5 then 2 else 0)", lambda begin, end: 2 * (end - begin)),
    ],
)
def test_a_derivative_across_a_jump_counts_where_a_factor_is_zero_elsewhere(factor, area):
    """A factor that is 0 until t = 5; x is its integral, 0.15 times it until th = 9.1 at t = 7."""
    text = (
        "table late over t : 1 until { 5: 0, 30: 3 }\nstate k = 0\neq d/dt k = 1\n"
        f"{PARAMETER}\nstate x = 0\neq d/dt x = (if th > 9.1 then 1 else 0.15)*{factor}"
    )
    value, found, differences = derivative(text, "x")
    assert value == pytest.approx(0.15 * area(5, 7) + area(7, 20), rel=1e-7)
    height = area(7 - 1e-6, 7 + 1e-6) / 2e-6
    assert found == pytest.approx(0.85 * height * 9.1 / 1.3**2, rel=1e-5)
    assert differences == pytest.approx(found, rel=1e-4)


# x = t; the places are those at which one of the two estimates of the error of an explicit step vanishes, and others.
PLACES = np.concatenate([[0.6647, 0.9212, 0.5931, 0.3923, 0.9763], np.random.default_rng(5).random(25)])

# Rate in terms of x and p; its integral from 0 to 1.
KINKS = {
    "abs(x - p)": lambda p: (p**2 + (1 - p) ** 2) / 2,
    "exp(-abs(x - p))": lambda p: 2 - np.exp(-p) - np.exp(p - 1),
    "max(x - p, 0)^1.5": lambda p: (1 - p) ** 2.5 / 2.5,
    "max(x - p, 0)^2": lambda p: (1 - p) ** 3 / 3,
}


@methods
@pytest.mark.parametrize("rtol", [1e-6, 1e-9])
@pytest.mark.parametrize("rate", KINKS)
def test_a_kink_anywhere_in_a_step_costs_no_accuracy(rate, rtol, method):
    text = f"param p = 0 in -10..10\nstate x = 0\nstate y = 0\neq d/dt x = 1\neq d/dt y = {rate}"
    episode = f"episode {{ step = 1, max_steps = 1 }}\nsolver {{ rtol = {rtol} }}"
    env = smpl.Env(smpl.compile(source=f"time t : 1\n{text}\n{episode}\n"), normalize=False, method=method)
    for place in PLACES:
        env.reset(seed=0, options={"parameters": {"p": float(place)}})
        env.step([])
        assert state(env, "y") == pytest.approx(KINKS[rate](place), abs=20 * rtol), place


@methods
@pytest.mark.parametrize("count", [1, 4, 24])
@pytest.mark.parametrize("power", [2.0, 2e3, 2e5, 1e8])
def test_a_rate_that_jumps_by_any_size_is_integrated(power, count, method):
    # T = 60 - 40 exp(-t/7200) reaches 35 at 7200 ln(40/25). A meter that starts at 0 has a small absolute tolerance.
    text = f"state T = 20\nstate used = 0\neq d/dt T = (60 - T)/7200\neq d/dt used = if T > 35 then {power} else 0"
    env, info = run(text, 86400.0, count, method)
    assert not info["failure"]
    assert state(env, "used") == pytest.approx(power * (86400 - 7200 * np.log(40 / 25)), rel=1e-8)


@implicit_methods
@counts
def test_an_algebraic_variable_that_jumps_is_followed(count, method):
    # a + a^3 = g, so that a dt = a (1 + 3 a^2) da / slope of g, the integral of which is (a^2/2 + 3/4 a^4) / slope.
    text = """
    state x = 0 in 0..5
    state y = 0 in 0..5
    var a = 0.1 in -10..10
    eq d/dt x = 1
    eq a + a^3 = (if x > 0.7 then 2*x else x)
    eq d/dt y = a
    """

    def root(g):
        return next(r.real for r in np.roots([1, 0, 1, -g]) if abs(r.imag) < 1e-12)

    def area(a):
        return a**2 / 2 + 3 * a**4 / 4

    env, info = run(text, 2.0, count, method)
    assert not info["failure"]
    # IDA is as exact without the jump.
    expected = area(root(0.7)) + (area(root(4.0)) - area(root(1.4))) / 2
    assert state(env, "y") == pytest.approx(expected, rel=5e-7 if method == "ida" else 1e-7)


@methods
@pytest.mark.parametrize("kink", ["max(x - 0.5, 0)", "if x > 0.5 then x - 0.5 else 0", "if x > 0.5 then x else 0"])
def test_an_event_that_an_action_brings_happens_at_the_start_of_the_step(kink, method):
    # x is 0.1, 1.1, 2.1, 2.2 at the ends of the steps. The kink is passed at 1.4, before the step of the second event.
    text = f"""
    time t : 1
    action u = 1 in 0..2
    discrete te = -1
    discrete k = 0
    state x = 0
    state w = 0
    eq d/dt x = u
    eq d/dt w = {kink}
    event low when u < 0.5
    at low {{ next te = t ; next k = k + 1 }}
    episode {{ step = 1, max_steps = 20 }}
    """
    env = smpl.Env(smpl.compile(source=text), normalize=False, method=method)
    above = [0.0, 0.18, 0.18 + 1.1, 0.18 + 1.1 + 1.65]
    jump = 0.5 * np.array([0, 0.6, 1.6, 2.6]) if kink.endswith("then x else 0") else np.zeros(4)
    rows = []
    for _ in range(2):
        env.reset(seed=0)
        for i, u in enumerate([0.1, 1.0, 1.0, 0.1]):
            env.step([u])
            rows.append(env.state.copy())
            assert state(env, "w") == pytest.approx(above[i] + jump[i], abs=1e-6)
        assert state(env, "x") == pytest.approx(2.2, abs=1e-7)
        # Low from the start on, and again from the fourth step on.
        assert (discrete(env, "te"), discrete(env, "k")) == (3.0, 2.0)
    np.testing.assert_array_equal(rows[:4], rows[4:])


@methods
@counts
def test_a_phase_whose_end_condition_holds_already_ends_where_it_begins(count, method):
    text = """
    state x = 0
    state w = 0
    eq d/dt x = 1
    eq d/dt w = max(sin(3*x), 0)
    discrete begun = 0
    phase two for 1.472 then one { next begun = t }
    phase one until x > -1 then two
    """
    env, _ = run(text, 10.0, count, method)
    assert discrete(env, "begun") == pytest.approx(6 * 1.472, abs=1e-9)
