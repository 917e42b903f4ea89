"""FMUs compute what the machine code computes, and simulate as the environment does, in the hands of FMPy."""

import csv
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

import smpl

fmpy = pytest.importorskip("fmpy", reason="fmpy is not installed")

from fmpy.validation import validate_fmu  # noqa: E402

import titration  # noqa: E402
from exports.mockup import Instance, make  # noqa: E402
from exports.points import MODELS, Points, assert_equal, label, variants  # noqa: E402
from exports.tree import Tree  # noqa: E402

LARGE = {"atropine", "mab", "mab_plant"}
PROBLEMS = sorted((Path(__file__).resolve().parents[1] / "problems").glob("*.eq"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmu")


def quantities(elements):
    """Name of each array with the positions of its elements, whatever their order."""
    found = {}
    for at, element in enumerate(elements):
        found.setdefault(element["name"].split("[")[0], []).append(at)
    return found


def by_tree(tree, points):
    """The residual by the exported tree, which the tests of JSON test, in an episode that begins at each point."""
    evaluator = Tree(tree, len(points.t))
    evaluator.set_nominal()
    evaluator.time = points.t
    for family, values in (("states", points.x), ("solved", points.y[len(points.x) :])):
        evaluator.set(family, values)
        evaluator.set(family, values, "initial")
        evaluator.set(family, np.zeros_like(values), "derivative")
    for family, values in (("actions", points.u), ("discretes", points.d), ("disturbances", points.w)):
        evaluator.set(family, values)
    with np.errstate(all="ignore"):
        return np.asarray(evaluator.residual())


def compare(made, count, reads_start=False):
    """Rates, with the algebraic variables that the FMU finds, against the residual of the machine code.

    Outside of an episode that has no values of `initial(...)`: what reads them is held against the tree.
    """
    model, _, description, unpacked = made
    tree = smpl.export.json(model)
    points = Points(model, tree, count)
    pace = tree["episode"]["integrate"] / tree["episode"]["step"]
    if tree["episode"]["single_precision"]:
        # An FMU rounds actions as an environment does; the residual takes them as they are.
        scale = np.array([[e["scale"]] for e in tree["elements"]["actions"]])
        points.u = (points.u / scale).astype(np.float32) * scale
    instance = Instance(description, unpacked)
    by_name = instance.by_name
    states = [v for v in description.modelVariables if v.name.startswith("der(")]
    n = len(points.x)
    # The elements of an array one after another, where the public order has others between them.
    public = {e["name"]: at for at, e in enumerate(tree["elements"]["states"])}
    order = [public[name] for name in state_names(unpacked, states)]
    rates, algebraic = np.full((n, count), np.nan), np.empty((len(points.z), count))
    for k in range(count):
        instance.fmu.reset()
        instance.fmu.enterInitializationMode(startTime=points.t[k])
        at = 0
        for rate in states:
            name = rate.name[4:-1]
            length = instance.length(name)
            instance.set(name, points.x[order[at : at + length], k])
            at += length
        for role, values in (("actions", points.u), ("discretes", points.d), ("disturbances", points.w)):
            for name, positions in quantities(tree["elements"][role]).items():
                instance.set(name, values[positions, k])
        instance.fmu.exitInitializationMode()
        rates[order, k] = np.concatenate([instance.get(rate.name) for rate in states])
        for name, positions in quantities(tree["elements"]["solved"]).items():
            found = name if f"{name}'" not in by_name else f"{name}'"
            algebraic[positions, k] = instance.get(found)
    instance.close()
    points.y = np.concatenate([points.x, algebraic])
    if tree["explicit"]:
        points.yp = np.zeros_like(points.y)
        expected = by_tree(tree, points) if reads_start else points.machine_code(model)
        assert_equal(rates / pace, expected[:n])
        residual, size = expected[n:], np.abs(algebraic)
    else:
        at_rest = points.yp = np.zeros_like(points.y)
        size = np.abs(points.machine_code(model))
        points.yp = np.concatenate([rates / pace, at_rest[n:]])
        residual = points.machine_code(model)
    assert (np.abs(residual) <= 1e-12 * np.maximum(size.max(axis=1, keepdims=True), 1.0)).all()


def state_names(unpacked, rates):
    """Names of the elements of the states in the order of the FMU."""
    with (Path(unpacked) / "resources" / "elements.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    names = {}
    for row in rows:
        names.setdefault(row["variable"], []).append(row["name"])
    return [name for rate in rates for name in names[rate.name[4:-1]]]


@pytest.mark.parametrize(("name", "arguments"), MODELS, ids=label)
def test_an_fmu_of_every_model_and_scenario_gives_the_rates_of_the_machine_code(folder, name, arguments):
    made = make(folder, name, arguments)
    assert validate_fmu(str(made[1])) == []
    compare(made, 100 if name in LARGE else 1000)


@pytest.mark.parametrize("path", PROBLEMS, ids=lambda path: path.stem)
def test_an_fmu_of_every_test_problem_gives_the_rates_of_the_machine_code(folder, path):
    compare(make(folder, path), 20)


@pytest.mark.parametrize("name", ["reactor", "beer", "pensim"])
def test_an_fmu_of_every_variant_gives_the_rates_of_the_machine_code(folder, name):
    for variant in variants(name):
        try:
            smpl.compile(name, variants=[variant])
        except (smpl.CompileError, smpl.ScenarioError):
            continue  # variants that require others
        compare(make(folder, name, {"variants": [variant]}), 100, variant == "batch_sugar")


def difference(found, expected, tree, family="states"):
    """The largest difference in tolerances of the model."""
    assert found.shape == expected.shape
    assert np.isfinite(found).all()
    solver, elements = tree["solver"], tree["elements"][family]
    scale = np.array([e["scale"] for e in elements])
    tolerance = solver["rtol"] * (np.abs(expected) + solver["atol_factor"] * scale)
    return np.max(np.abs(found - expected) / tolerance)


def co_simulate(made, actions, step=None):
    """States at the sampling instants, in public order; the steps of communication are shorter where one is given."""
    model, _, description, unpacked = made
    instance = Instance(description, unpacked, "co-simulation")
    rates = [v.name for v in description.modelVariables if v.name.startswith("der(")]
    position = {name: at for at, name in enumerate(model.state_names)}
    order = [position[n] for n in state_names(unpacked, [instance.by_name[r] for r in rates])]
    instance.fmu.enterInitializationMode()
    instance.fmu.exitInitializationMode()
    names = model.action_names
    states = []

    def record():
        x = np.empty(len(order))
        x[order] = np.concatenate([instance.get(rate[4:-1]) for rate in rates])
        states.append(x)

    record()
    parts = 1 if step is None else round(model.step / step)
    for k, action in enumerate(actions):
        for name, value in zip(names, action, strict=True):
            instance.set(name, [value])
        for part in range(parts):
            begin = (k + part / parts) * model.step
            _, ended, _, _ = instance.fmu.doStep(begin, model.step / parts)
            assert not ended
        record()
    instance.close()
    return np.array(states)


def varied(tree, steps, seed=0):
    """Actions about the nominal ones, held for some steps."""
    random = np.random.default_rng(seed)
    elements = tree["elements"]["actions"]
    nominal = np.array([e["nominal"] for e in elements])
    low, high = (np.array([e[k] if e[k] is not None else np.nan for e in elements]) for k in ("low", "high"))
    change = 1.0 + 0.02 * np.repeat(random.uniform(-1.0, 1.0, (steps // 5 + 1, len(elements))), 5, axis=0)[:steps]
    return np.fmin(np.fmax(nominal * change, low), high)


@pytest.mark.parametrize(
    ("name", "steps"), [("reactor", 50), ("beer", 60), ("pensim", 100), ("atropine", 10), ("mab", 5), ("mab_plant", 6)]
)
def test_co_simulation_is_the_environment_within_ten_tolerances(folder, name, steps):
    """The environment has a smaller tolerance here: over a batch of beer its error grows to thirty of the model's."""
    made = make(folder, name)
    model = smpl.compile(name, settings={"rtol": 1e-11})
    tree = smpl.export.json(made[0])
    actions = varied(tree, steps)
    x0 = [e["nominal"] for e in tree["elements"]["states"]]
    expected = np.asarray(model.rollout(x0, actions).states)[0]
    assert np.isfinite(expected).all()
    assert difference(co_simulate(made, actions), expected, tree) <= 10.0


def test_steps_of_communication_may_be_shorter_than_sampling_intervals(folder):
    made = make(folder, "pensim")
    tree = smpl.export.json(made[0])
    actions = varied(tree, 10)
    whole, parts = co_simulate(made, actions), co_simulate(made, actions, made[0].step / 4)
    assert difference(parts, whole, tree) <= 10.0


@pytest.mark.parametrize("name", ["reactor", "beer", "pensim", "atropine"])
def test_model_exchange_as_fmpy_does_it_is_the_environment(folder, name):
    """With CVODE at the tolerance and the nominal values that the FMU itself gives."""
    made = make(folder, name)
    path, tree = made[1], smpl.export.json(made[0])
    model, steps = made[0], 20 if name not in LARGE else 4
    actions = np.tile([e["nominal"] for e in tree["elements"]["actions"]], (steps, 1))
    x0 = [e["nominal"] for e in tree["elements"]["states"]]
    expected = np.asarray(model.rollout(x0, actions).states)[0, -1]
    rates = [v for v in made[2].modelVariables if v.name.startswith("der(")]
    states = [rate.name[4:-1] for rate in rates]
    result = fmpy.simulate_fmu(
        str(path),
        fmi_type="ModelExchange",
        stop_time=steps * model.step,
        output_interval=model.step,
        record_events=True,
        output=states,
    )
    # The last instant is there before its event and after it.
    last = np.flatnonzero(np.isclose(result["time"], steps * model.step))[0]
    found = np.concatenate([np.ravel(result[state][last]) for state in states])
    order = [model.state_names.index(name) for name in state_names(made[3], rates)]
    assert difference(found[np.argsort(order)], expected, tree) <= 20.0


def test_co_simulation_passes_an_equivalence_point(folder):
    """Nothing but the algebraic equation says how short steps have to be there; its solution is known by bisection."""
    path = folder / "titration.eq"
    path.write_text(titration.TEXT)
    made = make(folder, path)
    instance = Instance(made[2], made[3], "co-simulation")
    instance.fmu.enterInitializationMode()
    instance.fmu.exitInitializationMode()
    found, expected = [], []
    for k in range(4):
        instance.fmu.doStep(float(k), 1.0)
        found += instance.get("pH").tolist()
        expected.append(titration.pH(2.0 + 4.0 * (k + 1)))
    instance.close()
    assert expected[1] < 6.0 < 11.0 < expected[2]
    np.testing.assert_allclose(found, expected, rtol=1e-7)


INSTANTS = """
model Instants "what was at the end of the sample before, in events and behind them"
time t : s
action u = 0 in 0..1
table feed : 1 over time : s linear { 0: 1, 4: 5, 10: 17 }
state x = 0 in 0..1000
discrete before = -1 in -10..1000
discrete after = -1 in -10..1000
eq d/dt x = 1 / 1 [s]
event passed when x >= 3.5 + previous(t) / 1 [s] - 2
at passed { next before = previous(t) / 1 [s] }
at end { next after = previous(feed(t)) }
observe x
reward one default = 0
episode { step = 2 [s], max_steps = 5 }
"""


def test_co_simulation_knows_the_time_of_the_sample_before(folder):
    """x is the time; of the event in each sample, 1.5 s after its beginning, the beginning is kept."""
    path = folder / "instants.eq"
    path.write_text(INSTANTS)
    made = make(folder, path)
    instance = Instance(made[2], made[3], "co-simulation")
    instance.fmu.enterInitializationMode()
    instance.fmu.exitInitializationMode()
    for k in range(4):
        instance.fmu.doStep(2.0 * k, 2.0)
        assert instance.get("before").tolist() == [2.0 * k]
        np.testing.assert_allclose(instance.get("after"), np.interp(2.0 * k, [0, 4, 10], [1, 5, 17]), rtol=1e-9)
    instance.close()


PORTS = """
model Line "a feed, a tube and a tank"
time t : min
set species = {A, B}
connector Stream { Q : L/min, c[species] : mol/L }
connector Wall { T[z] : K }
component Tube(n_z = 6) {
  param L : m = 1
  port inlet, outlet : Stream
  domain z in 0..L cells n_z scheme upwind
  port wall : Wall
  state c[species,z] : mol/L = 0
  state T[z] : K = 300
  flux J[species,z] = 0.5 [m/L]*inlet.Q*c[species,z], low = 0.5 [m/L]*inlet.Q*inlet.c[species]
  eq d/dt c[species,z] = -div(J[species,z]) for species, z
  eq d/dt T[z] = (wall.T[z] - T[z]) / 2 [min] for z
  eq wall.T[z] = 310 [K] + 5 [K/m]*z for z
  eq outlet.Q = inlet.Q
  eq outlet.c[species] = c[species,z.last] for species
}
component Tank {
  port inlet : Stream
  state c[species] : mol/L = 0.5
  eq d/dt c[species] = inlet.Q / 3 [L]*(inlet.c[species] - c[species]) for species
}
component Feed {
  param c_in[species] : mol/L = 2
  port outlet : Stream
  eq outlet.Q = pumped
  eq outlet.c[species] = c_in[species] for species
}
action pumped : L/min = 1 in 0..2
use Feed as F
use Tube as P
use Tank as M
connect F.outlet -> P.inlet
connect P.outlet -> M.inlet
observe M.c[A] in 0..5 [mol/L]
reward r = M.c[A] / 1 [mol/L]
episode { step = 0.5 [min], max_steps = 20 }
"""


def test_ports_are_terminals(folder):
    """The file keeps to the standard's schema, and its members are inputs and outputs with the values of the ports."""
    etree = pytest.importorskip("lxml.etree", reason="lxml is not installed")
    path = folder / "line.eq"
    path.write_text(PORTS)
    model, fmu, description, _ = made = make(folder, path)
    assert validate_fmu(str(fmu)) == []
    with zipfile.ZipFile(fmu) as archive:
        root = etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
    schema = etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"))
    schema.assertValid(root)
    terminals = {terminal.get("name"): terminal for terminal in root.iter("Terminal")}
    assert list(terminals) == list(model.ports) == ["F.outlet", "P.inlet", "P.outlet", "P.wall", "M.inlet"]
    assert {t.get("terminalKind") for t in terminals.values()} == {"_smpl_Stream", "_smpl_Wall"}
    variables = {v.name: v for v in description.modelVariables}
    assert [m.get("variableName") for m in terminals["P.inlet"]] == ["pumped", "P.inlet.c"]
    expected = {"P.inlet.Q": 1.0, "P.inlet.c": [2.0, 2.0], "P.wall.T": 310.0 + 5.0 * (np.arange(6) + 0.5) / 6}
    instance = Instance(description, made[3])
    instance.fmu.enterInitializationMode()
    for name, terminal in terminals.items():
        assert terminal.get("matchingRule") == "plug"
        port = model.ports[name]
        assert [member.get("memberName") for member in terminal] == list(port.members)
        for member in terminal:
            variable = variables[member.get("variableName")]
            assert member.get("variableKind") == "signal"
            assert variable.causality in ("input", "output")
            numbers = port.members[member.get("memberName")]
            unit = model.algebraic_units[model.algebraic_names.index(numbers[0])]
            assert (variable.unit, instance.length(variable.name)) == (unit, len(numbers))
            output = f"{name}.{member.get('memberName')}"
            if output in expected:
                np.testing.assert_allclose(instance.get(variable.name), np.ravel(expected[output]), rtol=1e-14)
    instance.close()
    assert model.ports["P.inlet"].equals == {"Q": "pumped", "c": "F.c_in"}
    env = smpl.Env(model)
    env.reset(seed=0)
    shown = dict(zip(model.algebraic_names, env.algebraic, strict=True))
    np.testing.assert_allclose([shown[n] for n in model.ports["P.wall"].members["T"]], expected["P.wall.T"], rtol=1e-14)


def test_a_model_without_ports_has_no_terminals(folder):
    with zipfile.ZipFile(make(folder, "reactor")[1]) as archive:
        assert not [name for name in archive.namelist() if "terminals" in name]


BALL = """
model Ball "a ball that bounces"
time t : s
state h : m = 1 in -1..2 "height"
state v : m/s = 0 in -10..10 "speed"
param left : 1 = 0.8 in 0..1 "part of the speed that is left"
action push : m/s^2 = 0 in -1..1 "a push"
discrete bounces : 1 = 0 "number of bounces"
eq der(h) = v
eq der(v) = push - 9.81 [m/s^2]
event bounce when h < 0 [m]
at bounce { reset v = -left * v ; next bounces = bounces + 1 }
fail fast event h >= 1.5 [m]
observe h, v
reward r = 0
episode { step = 0.5 [s], max_steps = 20 }
solver { rtol = 1e-9 }
"""


def bounces(until):
    """Times of the bounces of a ball that falls from one metre: sqrt(2/g), then 2 e^k sqrt(2/g) more each."""
    first = np.sqrt(2.0 / 9.81)
    times = [first]
    while times[-1] < until:
        times.append(times[-1] + 2.0 * 0.8 ** len(times) * first)
    return np.array(times[:-1])


@pytest.fixture(scope="module")
def ball(folder):
    path = folder / "ball.eq"
    path.write_text(BALL)
    return make(folder, path)


def test_events_come_at_their_times_in_both_interfaces(ball):
    _, path, _, _ = ball
    expected = bounces(2.5)
    assert len(expected) == 4
    exchange = fmpy.simulate_fmu(
        str(path), fmi_type="ModelExchange", stop_time=2.5, relative_tolerance=1e-10, record_events=True, output=["v"]
    )
    jumps = np.flatnonzero((np.diff(exchange["time"]) == 0) & (np.diff(exchange["v"]) > 0.1))
    np.testing.assert_allclose(exchange["time"][jumps], expected, rtol=1e-7)
    # In co-simulation events are inside of steps: the height after the fourth bounce shows its time.
    instance = Instance(ball[2], ball[3], "co-simulation")
    instance.fmu.enterInitializationMode()
    instance.fmu.exitInitializationMode()
    for k in range(5):
        instance.fmu.doStep(0.5 * k, 0.5)
    speed = 9.81 * np.sqrt(2.0 / 9.81) * 0.8**4
    since = 2.5 - expected[-1]
    np.testing.assert_allclose(instance.get("h"), [speed * since - 0.5 * 9.81 * since**2], rtol=1e-6)
    assert instance.get("bounces") == [4.0]
    instance.close()


@pytest.mark.parametrize("name", ["reactor", "pensim", "atropine"])
def test_directional_derivatives_are_those_of_differences(folder, name):
    model, _, description, unpacked = make(folder, name)
    instance = Instance(description, unpacked)
    instance.fmu.enterInitializationMode()
    instance.fmu.exitInitializationMode()
    instance.fmu.updateDiscreteStates()
    instance.fmu.enterContinuousTimeMode()
    rates = [v for v in description.modelVariables if v.name.startswith("der(")]
    outputs = [v for v in description.modelVariables if v.causality == "output" and not v.dimensions]
    unknowns = [*rates, *outputs]
    length = sum(instance.length(v.name) for v in unknowns)
    values = lambda: np.concatenate([instance.get(v.name) for v in unknowns])  # noqa: E731
    n = sum(instance.length(v.name) for v in rates)
    x = (fmpy.fmi3.fmi3Float64 * n)()
    instance.fmu.getContinuousStates(x, n)
    # Away from zeros and bounds, where the equations have their corners.
    for action in model.action_names:
        variable = instance.by_name[action]
        instance.set(action, [0.6 * float(variable.min) + 0.4 * float(variable.max)])
    state = [instance.by_name[v.name[4:-1]] for v in rates]
    start = np.array(x) + np.concatenate([[0.05 * float(v.nominal)] * instance.length(v.name) for v in state])
    x[:] = start
    instance.fmu.setContinuousStates(x, n)
    scale = np.maximum(np.abs(start), 1e-3)
    random = np.random.default_rng(3)

    # States, all at once along a random direction.
    seed = scale * random.uniform(-1.0, 1.0, n)
    states = [instance.by_name[v.name[4:-1]].valueReference for v in rates]
    found = instance.fmu.getDirectionalDerivative([v.valueReference for v in unknowns], states, seed, length)
    ends = []
    for sign in (1.0, -1.0):
        x[:] = start + sign * 1e-6 * seed
        instance.fmu.setContinuousStates(x, n)
        ends.append(values())
    x[:] = start
    instance.fmu.setContinuousStates(x, n)
    expected = (ends[0] - ends[1]) / 2e-6
    size = np.maximum(np.abs(ends[0]) + np.abs(expected), 1e-9)
    assert np.max(np.abs(found - expected) / size) < 1e-5

    for action in model.action_names:
        held = instance.get(action)
        scale = float(instance.by_name[action].nominal)
        step = 1e-4 * scale
        reference = instance.reference(action)
        found = instance.fmu.getDirectionalDerivative([v.valueReference for v in unknowns], [reference], [1.0], length)
        ends = []
        for sign in (1.0, -1.0):
            instance.set(action, held + sign * step)
            ends.append(values())
        instance.set(action, held)
        expected = (ends[0] - ends[1]) / (2.0 * step)
        size = np.maximum(np.abs(ends[0]) / scale + np.abs(expected), 1e-9)
        assert np.max(np.abs(found - expected) / size) < 1e-5
    instance.close()


def test_the_description_has_units_bounds_shapes_and_starts(folder):
    model, path, description, _ = make(folder, "atropine")
    tree = smpl.export.json(model)
    by_name = {v.name: v for v in description.modelVariables}
    rate = by_name["der(R1.c)"]
    state = by_name["R1.c"]
    assert rate.derivative is state
    assert [int(d.start) for d in state.dimensions] == [14, 40]
    starts = [float(x) for x in state.start.split()]
    nominal = {e["name"]: e["nominal"] for e in tree["elements"]["states"]}
    assert starts[0] == nominal["R1.c[tropine,1]"]
    assert starts[1] == nominal["R1.c[tropine,2]"]
    reactor = {v.name: v for v in make(folder, "reactor")[2].modelVariables}
    cooling = reactor["T_c"]
    assert (cooling.causality, cooling.unit, cooling.min, cooling.max, float(cooling.start)) == (
        "input",
        "degC",
        "15.0",
        "35.0",
        26.85,
    )
    units = {u.name: u for u in make(folder, "reactor")[2].unitDefinitions}
    assert (units["degC"].baseUnit.K, units["degC"].baseUnit.offset) == (1, 273.15)
    assert units["K/min"].baseUnit.factor == 1 / 60
    names = zipfile.ZipFile(path).namelist()
    assert "binaries/x86_64-linux/atropine.so" in names
    assert {"sources/model.c", "sources/buildDescription.xml", "resources/elements.csv"} <= set(names)


def test_the_same_model_gives_the_same_archive(folder):
    model = smpl.compile("reactor")
    first, second = (smpl.export.fmu(model, folder / f"same{k}.fmu", binary=False).read_bytes() for k in range(2))
    assert first == second


def test_a_failure_ends_the_simulation_unless_it_is_told_to_go_on(ball):
    """With a start upwards of 5 m/s the ball is at 1.5 m when 1 + 5 t - g/2 t^2 is."""
    _, _, description, unpacked = ball
    expected = (5.0 - np.sqrt(25.0 - 4.0 * 0.5 * 9.81 * 0.5)) / 9.81
    for stops in (True, False):
        instance = Instance(description, unpacked, "co-simulation")
        instance.fmu.setBoolean([instance.reference("stop_at_failure")], [stops])
        instance.fmu.enterInitializationMode()
        instance.set("v", [5.0])
        instance.fmu.exitInitializationMode()
        _, ended, _, time = instance.fmu.doStep(0.0, 0.5)
        assert ended == stops
        assert time == pytest.approx(expected if stops else 0.5, rel=1e-7)
        instance.close()


@pytest.mark.parametrize("c", [0.0, 0.25])
def test_a_jump_of_what_is_differentiated_ends_the_simulation(folder, c):
    """a = 1 + t/15 passes 1.05 at 0.75 s, where the sum of a and b jumps by c; without a jump a is 1.2 at 3 s."""
    path = folder / "jump.eq"
    path.write_text("""
model Jump
time t : s
param c = 0 in -1..1
state a = 1
state b = 2
var w : 1/s
eq d/dt a = 0.1 [1/s] + w
eq d/dt b = 2*w
eq a + b = if a > 1.05 then 3 + c else 3
observe a in 0..5
episode { step = 1.5 [s], max_steps = 2 }
""")
    _, _, description, unpacked = make(folder, path)
    instance = Instance(description, unpacked, "co-simulation")
    instance.fmu.enterInitializationMode()
    instance.set("c", [c])
    instance.fmu.exitInitializationMode()
    _, ended, _, time = instance.fmu.doStep(0.0, 1.5)
    assert (ended, time) == (c > 0, pytest.approx(0.75 if c > 0 else 1.5, rel=1e-7))
    if c == 0:
        instance.fmu.doStep(1.5, 1.5)
        np.testing.assert_allclose(instance.get("a"), [1.2], rtol=1e-7)
    instance.close()


def test_a_parameter_changes_what_depends_on_it_at_the_start_and_later(ball):
    """The ball hits the ground with sqrt(2 g); what is left of its speed is a parameter."""
    _, _, description, unpacked = ball
    first, fall = 9.81 * np.sqrt(2.0 / 9.81), np.sqrt(2.0 / 9.81)
    instance = Instance(description, unpacked, "co-simulation")
    instance.fmu.enterInitializationMode()
    assert instance.get("left") == [0.8]
    instance.set("left", [0.5])
    instance.fmu.exitInitializationMode()
    instance.fmu.doStep(0.0, 0.5)
    since = 0.5 - fall
    np.testing.assert_allclose(instance.get("v"), [0.5 * first - 9.81 * since], rtol=1e-7)
    instance.set("left", [0.25])
    instance.fmu.doStep(0.5, 0.5)
    since = 1.0 - 2.0 * fall
    assert instance.get("bounces") == [2.0]
    np.testing.assert_allclose(instance.get("v"), [0.125 * first - 9.81 * since], rtol=1e-6)
    instance.close()


def test_a_saved_state_is_gone_back_to(ball):
    instance = Instance(ball[2], ball[3], "co-simulation")
    instance.fmu.enterInitializationMode()
    instance.fmu.exitInitializationMode()
    instance.fmu.doStep(0.0, 0.3)
    state = instance.fmu.getFMUState()
    instance.fmu.doStep(0.3, 0.7)
    first = instance.get("h")
    data = instance.fmu.serializeFMUState(state)
    instance.fmu.setFMUState(state)
    instance.fmu.freeFMUState(state)
    instance.fmu.doStep(0.3, 0.7)
    assert instance.get("h") == first
    state = instance.fmu.deserializeFMUState(data)
    instance.fmu.setFMUState(state)
    instance.fmu.doStep(0.3, 0.7)
    assert instance.get("h") == first
    instance.close()


def marked(path):
    """Names of variables with `reinit`, which fmpy reads for FMI 2 only."""
    with zipfile.ZipFile(path) as archive:
        description = archive.read("modelDescription.xml").decode()
    return re.findall(r'<Float64 name="([^"]*)"[^>]* reinit="true"', description)


def test_states_that_events_set_are_marked_and_the_others_can_be_set_in_event_mode(ball):
    """FMI 3.0.2, event mode of model exchange: continuous states with `reinit = false` only; an event sets `v`."""
    assert marked(ball[1]) == ["v"]
    assert validate_fmu(str(ball[1])) == []
    instance = Instance(ball[2], ball[3])
    instance.fmu.enterInitializationMode()
    instance.fmu.exitInitializationMode()
    instance.fmu.updateDiscreteStates()
    instance.set("h", [1.25])
    with pytest.raises(fmpy.fmi1.FMICallException):
        instance.set("v", [1.0])
    instance.fmu.updateDiscreteStates()
    instance.fmu.enterContinuousTimeMode()
    instance.set("v", [2.0])
    assert (instance.get("h"), instance.get("v"), instance.get("der(h)")) == ([1.25], [2.0], [2.0])
    with pytest.raises(fmpy.fmi1.FMICallException):
        instance.set("bounces", [1.0])
    instance.close()
    # In co-simulation events are inside of steps: states are set before the first one only.
    instance = Instance(ball[2], ball[3], "co-simulation")
    instance.fmu.enterInitializationMode()
    instance.fmu.exitInitializationMode()
    with pytest.raises(fmpy.fmi1.FMICallException):
        instance.set("h", [1.25])
    instance.close()


@pytest.mark.parametrize("when", ["at start", "at end"])
def test_a_state_that_a_sampling_instant_sets_is_marked(folder, when):
    path = folder / f"refilled_{when.split()[1]}.eq"
    change = "reset x[a] = 1 [m]" if when == "at start" else "clamp y at 0.5 [m] when y < 0.5 [m]"
    path.write_text(
        "model Refilled\ntime t : s\nset kinds = { a, b }\nstate x[kinds] : m = 1\nstate y : m = 1\n"
        "eq d/dt x[k] = -x[k]/1 [s] for k in kinds\neq d/dt y = -y/1 [s]\n"
        f"{when} {{ {change} }}\n"
        "observe y in 0..2\nreward r = 0\nepisode { step = 1 [s], max_steps = 5 }\n"
    )
    assert marked(make(folder, path)[1]) == (["x"] if when == "at start" else ["y"])


def test_what_shaped_the_model_cannot_be_set(folder):
    _, _, description, unpacked = make(folder, "atropine")
    instance = Instance(description, unpacked)
    instance.fmu.enterInitializationMode()
    with pytest.raises(fmpy.fmi1.FMICallException):
        instance.set("n_cells", [50.0])


def test_without_a_compiler_there_are_sources_and_a_warning(folder, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.warns(UserWarning, match="no C compiler `no-such-compiler`"):
        path = smpl.export.fmu(smpl.compile("reactor"), folder / "sources.fmu")
    names = zipfile.ZipFile(path).namelist()
    assert not any(name.startswith("binaries") for name in names)
    assert "sources/model.c" in names


def test_the_example_of_the_page_runs(tmp_path):
    page = (Path(__file__).resolve().parents[2] / "docs" / "export.md").read_text(encoding="utf-8")
    (code,) = (block for block in re.findall(r"^```python\n(.*?)^```$", page, re.S | re.M) if "fmpy" in block)
    done = subprocess.run([sys.executable, "-c", "import smpl\n" + code], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "5." in done.stdout
