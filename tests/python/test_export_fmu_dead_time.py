"""Dead times in FMUs and kernels, against closed forms, the method of steps with SciPy and the environment."""

import hashlib
import itertools
import math

import numpy as np
import pytest

import smpl
import smpl.cuda
from test_dead_time import DECAY, PUBLISHED, by_steps

fmpy = pytest.importorskip("fmpy", reason="fmpy is not installed")

from exports.mockup import Instance, make  # noqa: E402


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmu")


def slave(folder, source, step=1.0, steps=100):
    """An instance before its initialisation, and the model."""
    path = folder / f"model_{hashlib.sha256(f'{source}{step}'.encode()).hexdigest()}.eq"
    path.write_text(source + f"\nepisode {{ step = {step!r} [s], max_steps = {steps} }}\n")
    made = make(folder, path)
    return Instance(made[2], made[3], "co-simulation"), made[0]


def start(instance, **values):
    instance.fmu.enterInitializationMode()
    for name, value in values.items():
        instance.set(name, [value])
    instance.fmu.exitInitializationMode()


def go(instance, begin, end, parts=1):
    """Communication steps of equal length."""
    for k in range(parts):
        at = begin + (end - begin) * k / parts
        instance.fmu.doStep(at, begin + (end - begin) * (k + 1) / parts - at)


def value(instance, name):
    return instance.get(name)[0]


@pytest.mark.parametrize("parts", [1, 7, 40])
@pytest.mark.parametrize(("tau", "end", "expected"), PUBLISHED)
def test_a_delayed_decay_has_the_published_values_for_any_communication_step(folder, parts, tau, end, expected):
    instance, _ = slave(folder, DECAY)
    start(instance, tau=tau)
    go(instance, 0.0, end, parts)
    assert value(instance, "y") == pytest.approx(expected, rel=1e-8)
    instance.close()


JUMP = """
model Jump
time t : s
state z = 0
var x
var y in -2..2
eq x = if t < 0.5 [s] then 1 else t / 1 [s]
eq y = delay(x, 0.1 [s])
eq d/dt z = y / 1 [s]
discrete crossed : s = 0
event low when y < 0.7
at low { next crossed = t }
observe y
solver { rtol = 1e-9 }
"""


@pytest.mark.parametrize("parts", [1, 10, 33])
def test_a_delayed_jump_is_an_event_at_its_time(folder, parts):
    """y is 1 until 0.6 s, then t - 0.1 s from 0.5 on; the instant of the jump sees what is behind it."""
    instance, _ = slave(folder, JUMP)
    start(instance)
    seen = []
    for k in range(parts):
        go(instance, k / parts, (k + 1) / parts)
        seen.append(value(instance, "y"))
    assert value(instance, "z") == pytest.approx(0.88, abs=5e-8)
    assert value(instance, "crossed") == pytest.approx(0.6, abs=1e-12)
    times = [(k + 1) / parts for k in range(parts)]
    assert seen == pytest.approx([1 if t < 0.6 - 1e-12 else t - 0.1 for t in times], abs=1e-9)
    instance.close()


@pytest.mark.parametrize("parts", [1, 30])
def test_mackey_glass_agrees_with_the_method_of_steps(folder, parts):
    source = """
    model MackeyGlass
    time t : s
    state y = 0.5
    eq d/dt y = (0.2*delay(y, 17 [s])/(1 + delay(y, 17 [s])^10) - 0.1*y) / 1 [s]
    observe y
    solver { rtol = 1e-9 }
    """
    expected = by_steps(lambda _, y, z: 0.2 * z / (1 + z**10) - 0.1 * y, lambda _: 0.5, 17.0, 120.0)(120.0)
    instance, _ = slave(folder, source, 120.0)
    start(instance)
    go(instance, 0.0, 120.0, parts)
    assert value(instance, "y") == pytest.approx(expected[0], rel=1e-5)
    instance.close()


HEATER = """
model Heater
time t : s
param theta : s = 2.3 in 0.1..9
action u = 0 in -20..20
state T = 1 in -50..50
eq d/dt T = (delay(u, theta) - T) / 1.7 [s]
observe T
solver { rtol = 1e-10 }
"""


def heated(times, actions, theta, end):
    """T by exp(-t/1.7) over the spans between delayed steps of u."""
    knots = sorted({0.0, end, *(t + theta for t in times if t + theta < end)})
    state = 1.0
    for a, b in itertools.pairwise(knots):
        level = ([0.0] + [u for t, u in zip(times, actions, strict=True) if t + theta <= a + 1e-12])[-1]
        state = level + (state - level) * math.exp(-(b - a) / 1.7)
    return state


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("theta", [2.3, 2.0, 0.3])
def test_steps_of_an_input_arrive_a_dead_time_later(folder, theta, parts):
    """Inputs change at sampling instants and between them."""
    instance, _ = slave(folder, HEATER, 0.5)
    start(instance, theta=theta)
    times = [0.0, 0.5, 0.75, 1.5, 2.1, 4.0]
    actions = [4.0, -2.0, 1.0, 3.0, 0.5, -5.0]
    for begin, end, action in zip(times, [*times[1:], 7.0], actions, strict=True):
        instance.set("u", [action])
        go(instance, begin, end, parts)
    assert value(instance, "T") == pytest.approx(heated(times, actions, theta, 7.0), rel=1e-8)
    instance.close()


def test_a_dead_time_may_shrink_while_it_runs_and_grow_as_far_as_the_past_is_kept(folder):
    """u is 3 at first, from the start on; at 4 s the dead time falls from 2 to 1 s, where u = 3, too."""
    instance, _ = slave(folder, HEATER, 0.5)
    start(instance, theta=2.0)
    instance.set("u", [3.0])
    go(instance, 0.0, 4.0)
    instance.set("theta", [1.0])
    instance.set("u", [-1.0])
    go(instance, 4.0, 7.0)
    expected = heated([0.0, 4.0 + 1.0 - 2.0], [3.0, -1.0], 2.0, 7.0)
    assert value(instance, "T") == pytest.approx(expected, rel=1e-8)
    instance.set("theta", [6.5])
    with pytest.raises(fmpy.fmi1.FMICallException):
        go(instance, 7.0, 8.0)
    instance.close()


MODELS = {
    # Of a bounded expression, of an algebraic variable, of a delayed value, of a rate, and in a loop.
    "varying": """
model Varying
time t : s
action u = 1 in -9..9
state x = 0.5 in -9..9
state y = 0 in -99..99
eq d/dt x = (u - delay(x, min(max(1 [s] + 0.3 [s]*sin(t / 1 [s]), 0.5 [s]), 2 [s]))) / 1 [s]
eq d/dt y = x / 1 [s]
observe x, y
solver { rtol = 1e-9 }
""",
    "algebraic": """
model Algebraic
time t : s
action u = 1 in -9..9
state x = 0.5 in -9..9
var w in -9..9
eq w + 0.2*w^3 = x + 0.3*delay(w, 0.7 [s], before = 0.1)
eq d/dt x = (u - w - 0.5*delay(delay(x, 0.4 [s]), 0.35 [s])) / 1 [s]
state y = 0 in -99..99
eq d/dt y = (w - y) / 1 [s]
observe x, y
solver { rtol = 1e-9 }
""",
    "loop": """
model Loop
time t : s
set places = { a, b, c }
param theta[places] : s = { a: 0.4, b: 0.9, c: 1.3 }
action u = 1 in -9..9
state x[places] = { a: 0.5, b: 0.2, c: 0 } in -9..9
state y = 0 in -99..99
eq d/dt x[i] = (u - delay(x[i]^2 + 0.1*t / 1 [s], theta[i], before = 0.3 + 0.2*t / 1 [s])) / 1 [s] for i in places
eq d/dt y = (sum(x[i] for i in places) - y) / 1 [s]
observe x, y
solver { rtol = 1e-9 }
""",
    "transport": """
model Tube
time t : s
param L : m = 3 in 0..100
action v : m/s = 2 in 0.1..9
action c = 1 in 0..9
let c_out = transport(c, v, L)
state x = 0 in -99..99
state y : m = 0 in -99..99 scale 1
eq d/dt x = (c_out - x) / 1 [s]
eq d/dt y = v*c_out
observe x, y in -99..99
solver { rtol = 1e-9 }
""",
}


def plan(model, steps):
    random = np.random.default_rng(3)
    return model.action_nominal * (1.0 + 0.4 * random.uniform(-1.0, 1.0, (steps, len(model.action_names))))


@pytest.mark.parametrize("parts", [1, 4])
@pytest.mark.parametrize("name", MODELS)
def test_co_simulation_is_the_environment(folder, name, parts):
    instance, model = slave(folder, MODELS[name], 0.5)
    actions = plan(model, 16)
    nominal = [e["nominal"] for e in smpl.export.json(model)["elements"]["states"]]
    expected = np.asarray(model.rollout(nominal, actions, method="rosenbrock").states)[0]
    start(instance)
    found = []
    for k, action in enumerate(actions):
        for quantity, number in zip(model.action_names, action, strict=True):
            instance.set(quantity, [number])
        go(instance, 0.5 * k, 0.5 * (k + 1), parts)
        x = {q.split("[")[0]: None for q in model.state_names}
        found.append(np.concatenate([instance.get(q) for q in x]))
    np.testing.assert_allclose(found, expected[1:], rtol=1e-6, atol=1e-8)
    instance.close()


@pytest.mark.parametrize("name", MODELS)
def test_a_kernel_steps_as_the_environment(folder, name):
    path = folder / f"kernel_{name}.eq"
    path.write_text(MODELS[name] + "episode { step = 0.5 [s], max_steps = 20 }\n")
    model = smpl.compile(path)
    actions = plan(model, 16)
    batch = smpl.cuda.Batch(model, 2, device="cpu", history=2000)
    batch.reset()
    nominal = batch.unknowns[0, : len(model.state_names)].copy()
    expected = np.asarray(model.rollout(nominal, actions, method="rosenbrock").states)[0]
    for k, action in enumerate(actions):
        batch.step(np.tile(action, (2, 1)))
        assert (batch.status == 0).all()
        np.testing.assert_allclose(batch.unknowns[1, : len(nominal)], expected[k + 1], rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("name", ["algebraic", "varying"])
def test_a_saved_state_goes_on_to_the_same_bits(folder, name):
    """The state holds the past; it goes to another instance as bytes."""
    instance, _ = slave(folder, MODELS[name], 0.5)
    start(instance)
    instance.set("u", [1.5])
    go(instance, 0.0, 1.2)
    state = instance.fmu.getFMUState()
    data = instance.fmu.serializeFMUState(state)

    def rest(of):
        of.set("u", [0.5])
        go(of, 1.2, 3.0, 5)
        return of.get("x")[0], of.get("y")[0]

    first = rest(instance)
    instance.fmu.setFMUState(state)
    assert rest(instance) == first
    other, _ = slave(folder, MODELS[name], 0.5)
    start(other)
    other.fmu.setFMUState(other.fmu.deserializeFMUState(data))
    assert rest(other) == first
    with pytest.raises(fmpy.fmi1.FMICallException):
        other.fmu.deserializeFMUState(data[:-8])
    instance.close()
    other.close()


def test_a_kernel_in_a_file_has_the_history_that_is_asked_for(folder):
    model = smpl.compile(source=DECAY)
    (path,) = smpl.export.write(model, "kernel", folder / "decay.c", history=77)
    assert "#define SMPL_HISTORY 77\n" in path.read_text()
    with pytest.raises(ValueError, match="history must be positive, not 0"):
        smpl.export.write(model, "kernel", path, history=0)


def test_a_past_that_does_not_fit_is_refused_by_name(folder):
    path = folder / "short.eq"
    path.write_text(HEATER + "episode { step = 0.5 [s], max_steps = 20 }\n")
    model = smpl.compile(path)
    messages = []
    archive = smpl.export.fmu(model, folder / "short.fmu", history=3)
    with pytest.raises(fmpy.fmi1.FMICallException):
        fmpy.simulate_fmu(
            str(archive),
            stop_time=5.0,
            output_interval=0.5,
            input=np.array([(0.1 * k, k % 7) for k in range(60)], dtype=[("time", float), ("u", float)]),
            logger=lambda _, status, category, text: messages.append(text.decode()),
        )
    assert any("the past of `delay(u, theta)` has more than 3 steps" in text for text in messages)
    with pytest.raises(ValueError, match="history must be positive, not 0"):
        smpl.export.fmu(model, folder / "short.fmu", history=0)


def test_a_dead_time_of_zero_is_refused_at_the_start(folder):
    instance, _ = slave(folder, DECAY)
    instance.fmu.enterInitializationMode()
    instance.set("tau", [0.0])
    with pytest.raises(fmpy.fmi1.FMICallException):
        instance.fmu.exitInitializationMode()


def test_model_exchange_is_not_offered_for_a_dead_time(folder):
    path = folder / "exchange.eq"
    path.write_text(DECAY + "\nepisode { step = 1 [s], max_steps = 5 }\n")
    _, archive, description, _ = make(folder, path)
    assert description.modelExchange is None
    assert description.coSimulation is not None
    assert fmpy.validation.validate_fmu(str(archive)) == []


def test_a_clock_that_jumps_at_sampling_instants_is_refused_with_a_dead_time(tmp_path):
    model = smpl.compile(source=HEATER + "episode { step = 0.5 [s], integrate = 0.25 [s], max_steps = 20 }\n")
    with pytest.raises(ValueError, match=r"`delay\(u, theta\)` reads a past.*remove `integrate`"):
        smpl.export.fmu(model, tmp_path / "paced.fmu")
    with pytest.raises(ValueError, match="integrate"):
        smpl.cuda.Batch(model, 2, device="cpu")
