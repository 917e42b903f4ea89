"""The method of integration, chosen in Python, in a model, in a scenario."""

import json

import gymnasium
import numpy as np
import pytest
from scipy import integrate, optimize

import smpl
import titration

METHODS = ("ida", "rosenbrock", "explicit", "auto")

COOLING = """
model Cooling
time t : min
action u : K = 300 in 280..320
state T : K = 350 in 200..400
eq d/dt T = (u - T) / 5 [min]
observe T
reward r default = 0
episode { step = 1 [min], max_steps = 100 }
"""

ALGEBRAIC = """
model Algebraic
time t : s
action u = 1 in 0..2
state x = 1 in -10..10
var z = 1
eq d/dt x = (u - z) / 1 [s]
eq z^3 + z = x
observe x
episode { step = 1 [s], max_steps = 10 }
"""


@pytest.mark.parametrize("method", METHODS)
def test_a_method_follows_the_closed_solution(method):
    env = smpl.Env(smpl.compile(source=COOLING), normalize=False, method=method)
    env.reset(seed=0)
    expected = 350.0
    for action in (280.0, 320.0, 300.0):
        env.step(np.array([action]))
        expected = action + (expected - action) * np.exp(-1 / 5)
        assert env.state[0] == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("method", METHODS)
def test_gymnasium_makes_single_and_vector_environments_with_a_method(method):
    single = gymnasium.make("smpl/Reactor-v0", method=method)
    vector = gymnasium.make_vec(
        "smpl/Reactor-v0", num_envs=3, vectorization_mode="vector_entry_point", method=method, num_threads=2
    )
    other = smpl.VectorEnv("reactor", 3, method=method, num_threads=1)
    expected, _ = single.reset(seed=5)
    observations, _ = vector.reset(seed=5)
    np.testing.assert_array_equal(observations, other.reset(seed=5)[0])
    np.testing.assert_array_equal(observations[0], expected)
    generator = np.random.default_rng(1)
    for _ in range(10):
        actions = generator.uniform(-0.2, 0.2, (3, 2))
        expected = single.step(actions[0])
        result = vector.step(actions)
        np.testing.assert_array_equal(result[0], other.step(actions)[0])
        np.testing.assert_array_equal(result[0][0], expected[0])
        assert result[1][0] == expected[1]


@pytest.mark.parametrize("method", METHODS)
def test_a_snapshot_goes_on_with_the_same_bits(method):
    env = smpl.Env("reactor", method=method)
    env.reset(seed=2)
    generator = np.random.default_rng(0)
    for _ in range(5):
        env.step(generator.uniform(-0.2, 0.2, 2))
    snapshot = env.unwrapped.snapshot()
    actions = generator.uniform(-0.2, 0.2, (6, 2))
    first = [env.step(action)[0] for action in actions]
    state = env.unwrapped.state
    other = smpl.Env("reactor", method=method)
    other.reset(seed=9)
    other.step(actions[0])
    for target in (env, other):
        target.unwrapped.restore(snapshot)
        np.testing.assert_array_equal([target.step(action)[0] for action in actions], first)
        np.testing.assert_array_equal(target.unwrapped.state, state)


def test_another_name_is_a_value_error_that_lists_the_names():
    with pytest.raises(ValueError, match="method is 'bdf'; there are: ida, rosenbrock, explicit, auto"):
        smpl.Env("reactor", method="bdf")
    with pytest.raises(ValueError, match="method is 'RK45'"):
        smpl.VectorEnv("reactor", 2, method="RK45")


def test_the_explicit_method_refuses_an_algebraic_variable_by_its_name():
    model = smpl.compile(source=ALGEBRAIC)
    with pytest.raises(ValueError, match="`z` is an algebraic variable"):
        smpl.Env(model, method="explicit")
    assert smpl.Env(model, method="rosenbrock").reset(seed=0)


def test_a_model_chooses_its_method_and_a_scenario_another(tmp_path):
    (tmp_path / "cooling.eq").write_text(COOLING + "solver { method = explicit }\n")
    (tmp_path / "cooling.stiff.yaml").write_text("solver: {method: rosenbrock}\n")
    (tmp_path / "cooling.wrong.yaml").write_text("solver: {method: euler}\n")

    def work(**arguments):
        env = smpl.Env(tmp_path / "cooling.eq", **arguments)
        env.reset(seed=0)
        env.step(np.zeros(1))
        return env.unwrapped.solver_statistics

    assert work()["jacobians"] == 0
    assert 0 < work(scenario="stiff")["jacobians"] == work(scenario="stiff")["factorisations"]
    assert work(scenario="stiff", method="explicit")["jacobians"] == 0
    with pytest.raises(ValueError, match="ida, rosenbrock, explicit or auto"):
        work(scenario="wrong")


# Its solution from x = 0.1 is 1 / (1 + 9 exp(-t)).
LOGISTIC = """
model Logistic
time t : s
state x = 0.1 in 0..1
eq d/dt x = x*(1 - x) / 1 [s]
observe x
reward r default = 0
episode { step = 5 [s], max_steps = 1 }
"""
LOOSE, TIGHT = 1e-3, 1e-10


def logistic(tolerances, **arguments):
    """Error after 5 s against the closed form, and internal steps."""
    env = smpl.Env(
        smpl.compile(source=f"{LOGISTIC}solver {{ {tolerances} }}\n", **arguments.pop("given", {})), **arguments
    )
    env.reset(seed=0)
    env.step(np.zeros(0))
    return abs(env.state[0] - 1 / (1 + 9 * np.exp(-5))), env.solver_statistics["steps"]


@pytest.mark.parametrize("method", METHODS)
def test_one_step_methods_have_a_tolerance_of_their_own(method):
    both = logistic(f"rtol = {TIGHT}, one_step_rtol = {LOOSE}", method=method)
    loose, tight = (logistic(f"rtol = {rtol}", method=method) for rtol in (LOOSE, TIGHT))
    assert loose[1] < tight[1] and tight[0] < 1e-7
    assert both == pytest.approx(tight if method == "ida" else loose, rel=1e-6, abs=1e-14)


def test_a_tolerance_from_outside_replaces_both_of_the_model(tmp_path):
    declared = f"method = rosenbrock, rtol = {LOOSE}, one_step_rtol = {LOOSE}"
    tight = logistic(f"method = rosenbrock, rtol = {TIGHT}")
    scenario, own = tmp_path / "tight.yaml", tmp_path / "own.yaml"
    scenario.write_text(f"solver: {{rtol: {TIGHT!r}}}\n")
    own.write_text(f"solver: {{rtol: {LOOSE!r}, one_step_rtol: {TIGHT!r}}}\n")
    close = {"rel": 1e-6, "abs": 1e-14}
    assert logistic(declared, given={"settings": {"rtol": TIGHT}}) == tight
    assert logistic(declared, given={"scenario": str(scenario)}) == tight
    assert logistic(declared, given={"scenario": str(own)}) == pytest.approx(tight, **close)
    assert logistic(declared, given={"settings": {"one_step_rtol": TIGHT}}) == pytest.approx(tight, **close)
    with pytest.raises(ValueError, match="`one_step_rtol` must be between 1e-15 and 1, not 2"):
        logistic(declared, given={"settings": {"one_step_rtol": 2.0}})


def test_a_tolerance_of_one_step_methods_travels_as_json(tmp_path):
    source = f"{LOGISTIC}solver {{ method = auto, rtol = {TIGHT}, one_step_rtol = {LOOSE} }}\n"
    written = smpl.export.json(smpl.compile(source=source))
    assert (written["solver"]["rtol"], written["solver"]["one_step_rtol"]) == (TIGHT, LOOSE)
    del written["solver"]["one_step_rtol"]
    for name, content in (("both", smpl.export.json(smpl.compile(source=source))), ("one", written)):
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
        env = smpl.Env(tmp_path / f"{name}.json")
        env.reset(seed=0)
        env.step(np.zeros(0))
        loose = logistic(f"method = auto, rtol = {LOOSE if name == 'both' else TIGHT}")
        assert env.solver_statistics["steps"] == loose[1]


@pytest.mark.parametrize(
    ("name", "method"), [("reactor", "auto"), ("beer", "auto"), ("pensim", "auto"), ("atropine", "ida"), ("mab", "ida")]
)
def test_shipped_models_of_few_unknowns_run_with_auto_and_large_ones_with_ida(name, method):
    work = []
    for given in (None, method, "ida" if method == "auto" else "rosenbrock"):
        env = smpl.Env(name, normalize=False, method=given)
        env.reset(seed=0, options={"start": "nominal"})
        env.step(env.model.native.defaults("action"))
        work.append(env.solver_statistics)
    assert work[0] == work[1] != work[2]


@pytest.mark.parametrize("method", METHODS)
def test_rollouts_are_the_steps_of_an_environment_of_that_method(method):
    env = smpl.Env("reactor", normalize=False, method=method)
    env.reset(seed=3)
    env.step(env.action_space.sample())
    actions = np.random.default_rng(4).uniform([24.0, 0.09], [29.0, 0.11], (5, 2))
    state = env.unwrapped.state
    expected = env.unwrapped.rollout(actions)
    given = env.unwrapped.model.rollout(state, actions, method=method)
    other = smpl.Env(env.unwrapped.model, normalize=False, method=method)
    other.reset(seed=0, options={"state": state})
    for step, action in enumerate(actions):
        env.step(action)
        other.step(action)
        np.testing.assert_array_equal(expected.states[0, step + 1], env.unwrapped.state)
        np.testing.assert_array_equal(given.states[0, step + 1], other.unwrapped.state)
    with pytest.raises(ValueError, match="there are: ida"):
        env.unwrapped.model.rollout(state, actions, method="euler")


JUMP = """
model Jump "an algebraic variable that jumps where a state passes a limit"
time t : s
state x : 1 = 0 in -10..10
var z : 1 = 0.2
action u : 1 = 1 in 0..2
eq d/dt x = (u - 0.1*z) / 1 [s]
eq z + 0.1*z^3 = if x > 0.5 then 3 else 0.2
observe x, z in -10..10
reward area = integral(z) / 1 [s]
episode { step = 2 [s], max_steps = 3 }
"""


@pytest.mark.parametrize("method", ["ida", "rosenbrock", "auto"])
@pytest.mark.parametrize("rtol", [1e-5, 1e-8])
def test_algebraic_variables_that_are_steep_or_jump_are_followed_within_steps_too(method, rtol):
    """Rates of the states say nothing of them; their integrals are known from the equations alone."""
    expected = sum(
        integrate.quad(lambda t: titration.pH(2.0 + 4.0 * t), a, b, epsabs=1e-12, limit=500)[0]
        for a, b in ((0, 2.5), (2.5, 2.6), (2.6, 4))
    )
    run = nominal_rewards(titration.TEXT, method, rtol)
    assert abs(sum(run) / expected - 1) < rtol
    if method == "ida":
        return  # it stops where one jumps, unless an event says so
    before, after = (optimize.brentq(lambda z, to=to: z + 0.1 * z**3 - to, -5, 5, xtol=1e-15) for to in (0.2, 3.0))
    jump = 0.5 / (1 - 0.1 * before)
    run = nominal_rewards(JUMP, method, rtol)
    assert abs(sum(run) / (jump * before + (6 - jump) * after) - 1) < rtol


def nominal_rewards(source, method, rtol):
    """Rewards of an episode at the nominal action."""
    env = smpl.Env(smpl.compile(source=f"{source}\nsolver {{ rtol = {rtol} }}"), method=method)
    env.reset(seed=0)
    action, rewards, ended = env.from_physical(env.model.native.defaults("action")), [], False
    while not ended:
        _, reward, terminated, truncated, info = env.step(action)
        assert not info["failure"]
        rewards.append(reward)
        ended = terminated or truncated
    return rewards


TURN = """
model Turn "a rise that its equations turn round where the event is"
time t : s
state x = 0
discrete falls = 0
eq d/dt x = {rate}
event top when x {than} 1
at top {{ next falls = falls + 1 ; reset x = 0 }}
episode {{ step = 0.3 [s], max_steps = 9 }}
solver {{ rtol = 1e-8 }}
"""


@pytest.mark.parametrize("rate", ["if x < 1 then 1 [1/s] else -2 [1/s]", "sign(1 - x) * 1 [1/s]"])
@pytest.mark.parametrize("than", [">", ">="])
@pytest.mark.parametrize("method", METHODS)
def test_an_event_where_the_equations_turn_round_happens(method, than, rate):
    if method == "ida" and "-2" in rate:
        pytest.skip("an implicit step ends on neither side")
    env = smpl.Env(smpl.compile(source=TURN.format(than=than, rate=rate)), normalize=False, method=method)
    env.reset(seed=0)
    for step in range(1, 10):
        info = env.step([])[4]
        assert not info["failure"]
        falls = int(0.3 * step)
        assert env.discrete[0] == falls
        assert env.state[0] == pytest.approx(0.3 * step - falls, abs=3e-6)


PEAK = """
model Peak "an oscillation near its limit"
time t : s
param limit = 0.8
state x = 0 in -2..2
state v = 1 in -2..2
eq d/dt x = v * 1 [1/s]
eq d/dt v = -x * 1 [1/s]
reward above = integral(if x > limit then 1 else 0) / 1 [s]
reward excess = integral(max(x - limit, 0)) / 1 [s]
reward below default = integral(if x > limit then 0 else 1) / 1 [s]
episode { step = 1.7 [s], max_steps = 10 }
solver { rtol = 1e-9 }
"""


@pytest.mark.parametrize("method", METHODS)
def test_integrals_of_what_jumps_or_bends_inside_of_a_step_keep_to_the_tolerance(method):
    env = smpl.Env(smpl.compile(source=PEAK), normalize=False, method=method)
    env.reset(seed=0)
    rises = np.arcsin(0.8) + 2 * np.pi * np.arange(3)
    falls = np.pi - np.arcsin(0.8) + 2 * np.pi * np.arange(3)
    for step in range(10):
        begin, end = 1.7 * step, 1.7 * (step + 1)
        low, high = np.clip(rises, begin, end), np.clip(falls, begin, end)
        above, area = np.sum(high - low), np.sum(np.cos(low) - np.cos(high))
        rewards = env.step([])[4]["rewards"]
        tolerance = 1e-6 if method == "ida" else 1e-8
        assert rewards["above"] == pytest.approx(above, abs=tolerance)
        assert rewards["below"] == pytest.approx(1.7 - above, abs=tolerance)
        assert rewards["excess"] == pytest.approx(area - 0.8 * above, abs=tolerance)


PHASES = """
model Phases "a line, up to the end of a phase"
time t : s
param request = 0
state x = 0 in -10..10
state y = 0 in -10..10
discrete since : s = 0
phase rise until {until} then rest {{ next since = t }}
phase rest
eq d/dt x = if phase == rise then 1 [1/s] else 0 [1/s]
eq d/dt y = if phase == rise then -0.5 [1/s] else 0 [1/s]
let far = x > 0.7 or x > 5
episode {{ step = 1 [s], max_steps = 5 }}
"""


@pytest.mark.parametrize(
    ("until", "end"),
    [
        ("x > 1.3", 1.3),
        ("x > 1.3 or y < -0.6", 1.2),
        ("x > 1.3 and y < -0.75", 1.5),
        ("not (x < 1.3 and y > -2)", 1.3),
        ("x > 0.4 and (y < -0.9 or x > 1.7) or request == 1", 1.7),
        ("x > 1.3 and request == 1", 5.0),
        ("any(c > 1.25 for c in (x, y))", 1.25),
        ("all(c*c > 0.16 for c in (x, y))", 0.8),
        ("y < -0.35 and sqrt(x - 0.9) > 0.5", 1.15),
        ("t > 2.6 [s] or clock > 2.3 [s]", 2.3),
        ("far", 0.7),
    ],
)
@pytest.mark.parametrize("method", METHODS)
def test_a_phase_ends_inside_of_a_step_whatever_its_condition_is_made_of(method, until, end):
    env = smpl.Env(smpl.compile(source=PHASES.format(until=until)), normalize=False, method=method)
    env.reset(seed=0)
    for _ in range(5):
        assert not env.step([])[4]["failure"]
    np.testing.assert_allclose(env.state, [end, -0.5 * end], rtol=1e-6)
    if end < 5:
        assert env.discrete[list(env.discrete_names).index("since")] == pytest.approx(end, rel=1e-6)
