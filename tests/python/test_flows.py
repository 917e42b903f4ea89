"""Fluxes that turn, graded grids, arrays of actions: against closed solutions."""

import numpy as np
import pytest

import smpl

BED = """model Bed
time t : s
{declarations}
action v : m/s = -1 in -2..2
domain z in 0..3 [m] cells 3 scheme {scheme}
state c[z] : {unit} = {start} in -100..1000
flux J[z] = {flux}, low = {end}, high = {end}
eq d/dt c[z] = -div(J[z]) for z
observe c
episode {{ step = 1 [s], max_steps = 3 }}
solver {{ rtol = 1e-9 }}
"""


def bed(flux, end, declarations="", unit="1", start="2", scheme="upwind"):
    env = smpl.Env(
        smpl.compile(source=BED.format_map(locals() | {"flux": flux, "end": end})), normalize=False, method="ida"
    )
    env.reset(seed=0)
    return env


@pytest.mark.parametrize(
    ("flux", "end", "unit"),
    [
        ("v*(c[z] - 20 [degC])", "v*(40 [degC] - 20 [degC])", "degC"),
        ("v*kelvin(c[z])", "v*kelvin(40 [degC])", "degC"),
        ("v*(1 + 2*c[z])", "v*(1 + 2*40)", "1"),
        ("v*upwind(v, c[z])", "v*40", "1"),
        ("v*upwind(v, 3*c[z] + 1)", "v*(3*40 + 1)", "1"),
        # Two that pass each other.
        ("v*upwind(v, c[z]) - 2*v*upwind(-v, c[z])", "v*40 - 2*v*40", "1"),
    ],
)
@pytest.mark.parametrize("scheme", ["upwind", "upwind2", "limited"])
@pytest.mark.parametrize("velocity", [-1.0, 1.0])
def test_a_bed_that_is_fed_with_what_it_holds_stays_as_it_is(flux, end, unit, scheme, velocity):
    env = bed(flux, end, unit=unit, start="40" if unit == "1" else "40 [degC]", scheme=scheme)
    for _ in range(3):
        env.step([velocity])
    np.testing.assert_allclose(env.state, 40, rtol=1e-12)


@pytest.mark.parametrize(
    ("declarations", "end"),
    [
        ("set s = { a, b }\ntable feed[s] = { a: 0, b: 1 }", "v*feed[a]"),
        ("let nothing = 0", "v*nothing"),
        ("param nothing = 0", "v*nothing"),
        ("let nothing = 0\nlet into : m/s = v*nothing", "into"),
    ],
)
def test_a_feed_without_the_substance_is_no_wall(declarations, end):
    env = bed("v*c[z]", end, declarations)
    for t in (1.0, 2.0, 3.0):
        env.step([-1.0])
        # The content of three cells in a row is washed out.
        first, second, third = env.state
        assert third == pytest.approx(2 * np.exp(-t), rel=1e-6)
        assert second == pytest.approx(2 * np.exp(-t) * (1 + t), rel=1e-6)
        assert first == pytest.approx(2 * np.exp(-t) * (1 + t + t * t / 2), rel=1e-6)


STREAMS = """model Streams
time t : s
action v : m/s = -1 in -2..2
domain z in 0..3 [m] cells 3 scheme upwind
state c[z] = 2 in 0..100
state b[z] = 1 in 0..100
FLUXES
eq d/dt b[z] = -div(I[z]) for z
eq d/dt c[z] = -div(J[z]) for z
"""
APART = """flux J[z] = v*upwind(v, c[z]), low = v*5, high = v*5
flux I[z] = -v*upwind(-v, b[z]), low = -v*3, high = -v*3"""
TOGETHER = """flux J[z] = v*upwind(v, c[z]) - v*upwind(-v, b[z]), low = v*5 - v*3, high = v*5 - v*3
flux I[z] = -v*upwind(-v, b[z]), low = -v*3, high = -v*3"""


@pytest.mark.parametrize("velocity", [-1.0, 1.0])
def test_streams_that_pass_each_other_leave_at_opposite_ends(velocity):
    values = [0.5, 1.0, 1.5, 2.0, 2.5, 3.5]
    apart, together = (
        smpl.compile(source=STREAMS.replace("FLUXES", fluxes)).rhs(0.0, values, [velocity])
        for fluxes in (APART, TOGETHER)
    )
    # Each cell holds c and b; a flux of both carries what two fluxes carry, each its own.
    np.testing.assert_allclose(together[::2], apart[::2] + apart[1::2], rtol=1e-12)


def test_a_wall_stays_a_wall():
    env = bed("v*c[z]", "0")
    env.step([-1.0])
    assert env.state.sum() == pytest.approx(6, rel=1e-9) and env.state[2] < 1


GRADED = """model Line
time t : s
action v : m/s = {velocity} in {bounds}
domain z in 0..2 [m] cells 6 scheme {scheme} {grid}
state c[z] : m = 1 in -100..100
flux J[z] = v*c[z]
eq d/dt c[z] = -div(J[z]) for z
episode {{ step = 1 [s], max_steps = 3 }}
"""


@pytest.mark.parametrize("grid", ["stretch 1.5", "stretch 0.7", "faces 2 [m]*(k/6)^2"])
@pytest.mark.parametrize(("velocity", "bounds"), [(1, "0..2"), (-1, "-2..0"), (-1, "-2..2"), (1, "-2..2")])
def test_a_straight_line_is_carried_exactly_on_a_graded_grid(grid, velocity, bounds):
    source = GRADED.format(grid=grid, velocity=velocity, bounds=bounds, scheme="upwind2")
    model = smpl.compile(source=source)
    ratio = {"stretch 1.5": 1.5, "stretch 0.7": 0.7}.get(grid)
    faces = np.array([(ratio**k - 1) / (ratio**6 - 1) if ratio else (k / 6) ** 2 for k in range(7)]) * 2
    rates = model.rhs(0.0, (faces[1:] + faces[:-1]) / 2, [velocity])
    # Of a straight line all but the cells whose faces have one cell only on the side of the flow.
    inner = slice(2, 5) if velocity > 0 else slice(1, 4)
    np.testing.assert_allclose(rates[inner], -velocity, rtol=1e-12)


@pytest.mark.parametrize("ratio", ["1", "q", "1.0000000001"])
def test_a_ratio_of_one_is_a_uniform_grid(ratio):
    texts = [GRADED.format(grid=grid, velocity=1, bounds="0..2", scheme="central") for grid in ("", f"stretch {ratio}")]
    plain, graded = (smpl.compile(source=text.replace("time t : s", "time t : s\nparam q = 1")) for text in texts)
    values = np.linspace(0, 1, 6) ** 2
    found = graded.rhs(0.0, values, [1.0])
    np.testing.assert_allclose(found, plain.rhs(0.0, values, [1.0]), rtol=1e-8)


ARRAY = """model Mixer
time t : s
action a[k in 1..3] = 1 in 0..20
action b = 5 in 0..20
state x = 1 in -1000..1000
eq d/dt x = (a[1] + 2*a[2] + 3*a[3] + 10*b - x)/1 [s]
observe x
steady { a = 1, b = 5 }
reward off default = -abs(x - steady(x))
policy p { b = 9, a = 2 }
episode { step = 1 [s], max_steps = 2 }
"""


def test_an_array_of_actions_before_a_single_one_keeps_its_place():
    env = smpl.Env(smpl.compile(source=ARRAY), normalize=False)
    env.reset(seed=0)
    assert env.action_names == ("a[1]", "a[2]", "a[3]", "b")
    np.testing.assert_array_equal(env.steady_action, [1, 1, 1, 5])
    np.testing.assert_array_equal(env.policy("nominal"), [1, 1, 1, 5])
    np.testing.assert_array_equal(env.policy("p"), [2, 2, 2, 9])
    assert env.steady_state[0] == pytest.approx(1 + 2 + 3 + 50, rel=1e-12)
    _, reward, *_ = env.step([1, 1, 1, 5])
    assert reward == pytest.approx(-55 * np.exp(-1), rel=1e-6)
