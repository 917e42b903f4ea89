"""Initial values that depend on algebraic variables, which are solved for at the start."""

import numpy as np
import pytest

import smpl

SOURCE = """
state v = 0
state y = 0
state q = 0
state x = 1
initial v = 5*w
initial y = 10*z
initial q = 3*z + r
initial x ~ uniform(3, 5)
var w
var z = 1
var r = 1
eq w = 2*x
eq z^3 + z = x + 6
eq r^3 + r = y/10 + 8
discrete d = z in 0..100
discrete g = initial(z) in 0..100
observe d, g in 0..100
eq d/dt v = -v / 1 [s]
eq d/dt y = -y / 1 [s]
eq d/dt q = -q / 1 [s]
eq d/dt x = -x / 1 [s]
action u = 0 in 0..1
episode { step = 1 [s], max_steps = 2 }
"""


def root(c: float) -> float:
    """Of z^3 + z = c."""
    return float(np.real(next(z for z in np.roots([1, 0, 1, -c]) if abs(z.imag) < 1e-9)))


@pytest.mark.parametrize("options", [{}, {"state": {"x": 4.0}}])
def test_initial_values_follow_the_solution(options):
    env = smpl.Env(smpl.compile(source=SOURCE), normalize=False)
    observation, _ = env.reset(seed=1, options=options)
    state = dict(zip(env.model.state_names, env.state, strict=True))
    if options:
        assert state["x"] == 4
    z = root(state["x"] + 6)
    if not options:
        assert state["v"] == pytest.approx(10 * state["x"], rel=1e-12)
    assert state["y"] == pytest.approx(10 * z, rel=1e-8)
    assert state["q"] == pytest.approx(3 * z + root(z + 8), rel=1e-8)
    np.testing.assert_allclose(observation, [z, z], rtol=1e-6)


CHAIN = [
    "discrete a : 1 = q + y in 0..100",
    "discrete b : 1 = d[1] + 1 in 0..100",
    "discrete d[i in k] : 1 = if i == 3 then 5 else d[i+1] + 1 in 0..100",
    "discrete e : 1 = part.f in 0..100",
    "use Part as part",
]


@pytest.mark.parametrize("turn", range(len(CHAIN)))
@pytest.mark.parametrize("backwards", [False, True])
def test_discrete_variables_begin_with_the_values_of_each_other_in_any_order_of_the_text(turn, backwards):
    """d = 7, 6, 5; b = 8; q^3 + q = 2 b; y = b + 1; a = q + y; e = f = a."""
    chain = CHAIN[turn:] + CHAIN[:turn]
    text = "\n".join(reversed(chain) if backwards else chain)
    model = smpl.compile(
        source=f"""set k = 1..3
        component Part {{
          var input : 1 = 0
          discrete f : 1 = input in 0..100
        }}
        {text}
        eq part.input = if b >= 8 then a else 0
        var q = 1
        eq q^3 + q = 2*b
        let y = b + 1
        state s = e
        eq d/dt s = -s / 1 [s]
        observe a, b, d, e, s in 0..100
        episode {{ step = 1 [s], max_steps = 2 }}
        """
    )
    env = smpl.Env(model, normalize=False)
    observation, _ = env.reset(seed=0)
    a = root(16) + 9
    assert observation == pytest.approx([a, 8, 7, 6, 5, a, a], rel=1e-8)


@pytest.mark.parametrize("whole", ["initial x = 2", "initial x ~ uniform(1, 2)", "initial x[i] = 2 for i in s", ""])
@pytest.mark.parametrize("single", ["initial x[a] = 5", "initial x[a] ~ uniform(4, 5)", ""])
def test_what_a_scenario_draws_holds_against_all_of_the_text(whole, single, tmp_path):
    text = f"""model Starts
time t : s
set s = {{a, b, c}}
state x[s] = 1 in 0..9
eq d/dt x[i] = 0 for i in s
{single}
{whole}
episode {{ step = 1 [s], max_steps = 1 }}
"""
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("initial: {x: 'uniform(7, 7.5)', 'x[c]': 'uniform(8, 8.5)'}\n")
    env = smpl.Env(smpl.compile(source=text, scenario=scenario))
    env.reset(seed=3)
    assert np.all((env.state[:2] >= 7) & (env.state[:2] <= 7.5)) and 8 <= env.state[2] <= 8.5
