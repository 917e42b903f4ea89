"""Events of imported models: triggers, delays, priorities and persistence as SBML defines them."""

import csv

import numpy as np
import pytest

from smpl.commands.main import main

CORE = "http://www.sbml.org/sbml/level3/version2/core"
MATHML = "http://www.w3.org/1998/Math/MathML"
ENDINGS = ("reward", "terminated", "truncated")
TIME = '<csymbol encoding="text" definitionURL="http://www.sbml.org/sbml/symbols/time">time</csymbol>'


DELAY = TIME.replace("time", "delay")


def inner(e):
    if isinstance(e, tuple) and e[0] == "delay":
        return f"<apply>{DELAY}{inner(e[1])}{inner(e[2])}</apply>"
    if isinstance(e, tuple) and e[0] == "if":
        return f"<piecewise><piece>{inner(e[1])}{inner(e[2])}</piece></piecewise>"
    if isinstance(e, tuple):
        return f"<apply><{e[0]}/>{''.join(inner(part) for part in e[1:])}</apply>"
    if e == "time":
        return TIME
    return f"<ci>{e}</ci>" if isinstance(e, str) else f"<cn>{e!r}</cn>"


def math(e):
    return f'<math xmlns="{MATHML}">{inner(e)}</math>'


def event(name, trigger, sets, delay=None, priority=None, initial=True, persistent=True, early=True):
    def flag(value):
        return str(value).lower()

    assigned = "".join(f'<eventAssignment variable="{k}">{math(v)}</eventAssignment>' for k, v in sets.items())
    extra = "".join(
        f"<{tag}>{math(value)}</{tag}>"
        for tag, value in [("priority", priority), ("delay", delay)]
        if value is not None
    )
    head = f'<trigger initialValue="{flag(initial)}" persistent="{flag(persistent)}">{math(trigger)}</trigger>'
    return (
        f'<event id="{name}" useValuesFromTriggerTime="{flag(early)}">{head}{extra}'
        f"<listOfEventAssignments>{assigned}</listOfEventAssignments></event>"
    )


def sbml(parts):
    head = f'<?xml version="1.0" encoding="UTF-8"?><sbml xmlns="{CORE}" level="3" version="2">'
    return f'{head}<model id="m">{parts}</model></sbml>'


def parameters(values, rates=(), rules=(), initial=()):
    """Parameters, some with rate rules, assignment rules or initial assignments."""
    one = "".join(f'<parameter id="{k}" value="{v!r}" constant="false"/>' for k, v in values.items())
    starts = "".join(f'<initialAssignment symbol="{k}">{math(v)}</initialAssignment>' for k, v in dict(initial).items())
    moves = "".join(f'<rateRule variable="{k}">{math(v)}</rateRule>' for k, v in dict(rates).items())
    moves += "".join(f'<assignmentRule variable="{k}">{math(v)}</assignmentRule>' for k, v in dict(rules).items())
    text = f"<listOfParameters>{one}</listOfParameters>"
    text += f"<listOfInitialAssignments>{starts}</listOfInitialAssignments>" if starts else ""
    return text + (f"<listOfRules>{moves}</listOfRules>" if moves else "")


def events(*all_events):
    return f"<listOfEvents>{''.join(all_events)}</listOfEvents>"


@pytest.fixture
def run(tmp_path, capfd):
    """Values by name at each step of an imported text."""

    def simulated(text, step, count, *options):
        file, model, table = tmp_path / "m.xml", tmp_path / "m.eq", tmp_path / "m.csv"
        file.write_text(text, encoding="utf-8")
        assert main(["import", str(file), "-o", str(model)]) == 0, capfd.readouterr().err
        settings = ["--set", f"step={step!r}", "--set", f"max_steps={count}", "--rtol", "1e-10", "--start", "nominal"]
        assert main(["simulate", str(model), *settings, "--out", str(table), *options]) == 0, capfd.readouterr().err
        ending = capfd.readouterr().out
        names, *rows = csv.reader(table.read_text(encoding="utf-8").splitlines())
        assert "time limit" in ending or len(rows) < count + 1, ending
        columns = zip(names, zip(*rows, strict=True), strict=True)
        return {name: np.array(column, float) for name, column in columns if name not in ENDINGS}, ending

    return simulated


METHODS = ["ida", "rosenbrock", "explicit", "auto"]


@pytest.mark.parametrize("method", METHODS)
def test_simultaneous_events_use_the_values_of_the_trigger_time(run, method):
    # Both at x = 1: a takes b's old value and b takes a's old value, whatever runs first.
    text = sbml(
        parameters({"x": 0.0, "a": 2.0, "b": 5.0}, {"x": 1})
        + events(event("E", ("geq", "x", 1), {"a": "b"}), event("F", ("geq", "x", 1), {"b": "a"}))
    )
    found, _ = run(text, 0.7, 2, "--method", method)
    assert found["a"].tolist() == [2, 2, 5]
    assert found["b"].tolist() == [5, 5, 2]


def test_late_values_see_what_events_of_higher_priority_set(run):
    # F goes first (10 > 1): b = 3. Then a = 2 b is 6 with the values of the execution, 10 with those of the trigger.
    def text(early):
        return sbml(
            parameters({"x": 0.0, "a": 2.0, "b": 5.0}, {"x": 1})
            + events(
                event("E", ("geq", "x", 1), {"a": ("times", 2, "b")}, priority=1, early=early),
                event("F", ("geq", "x", 1), {"b": 3}, priority=10),
            )
        )

    assert run(text(False), 0.7, 2)[0]["a"].tolist() == [2, 2, 6]
    assert run(text(True), 0.7, 2)[0]["a"].tolist() == [2, 2, 10]


@pytest.mark.parametrize(("persistent", "runs"), [(True, 1), (False, 0)])
def test_a_persistent_event_runs_though_another_one_ends_its_condition(run, persistent, runs):
    # F goes first and puts x back to 0: E is due all the same, unless it is not persistent.
    text = sbml(
        parameters({"x": 0.0, "count": 0.0}, {"x": 1})
        + events(
            event("E", ("geq", "x", 1), {"count": ("plus", "count", 1)}, priority=1, persistent=persistent),
            event("F", ("geq", "x", 1), {"x": 0}, priority=2),
        )
    )
    found, _ = run(text, 0.7, 2)
    assert found["count"].tolist() == [0, 0, runs]
    np.testing.assert_allclose(found["x"], [0, 0.7, 0.4], atol=1e-9)


def test_priorities_that_change_decide_at_the_time_of_the_execution(run):
    # Priority x against 2 at x = 1 and x = 3: the last one to run leaves its number.
    both = [("geq", "time", 1.0), ("geq", "time", 3.0)]
    texts = []
    for number, when in enumerate(both):
        texts.append(event(f"E{number}", when, {"last": 1}, priority="x"))
        texts.append(event(f"F{number}", when, {"last": 2}, priority=2))
    found, _ = run(sbml(parameters({"x": 0.0, "last": 0.0}, {"x": 1}) + events(*texts)), 2.0, 2)
    assert found["last"].tolist() == [0, 1, 2]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("early", "expected"), [(True, 1.0), (False, 1.6)])
def test_a_delayed_event_acts_after_its_delay(run, method, early, expected):
    # x = t passes 1 and the event acts at 1.6, with x at 1 or at 1.6.
    text = sbml(
        parameters({"x": 0.0, "y": -1.0}, {"x": 1})
        + events(event("E", ("gt", "x", 1), {"y": "x"}, delay=0.6, early=early))
    )
    found, _ = run(text, 0.5, 4, "--method", method)
    np.testing.assert_allclose(found["y"], [-1, -1, -1, -1, expected], atol=1e-7)


@pytest.mark.parametrize(("persistent", "expected"), [(True, [0, 0, 1, 2]), (False, [0, 0, 0, 0])])
def test_executions_wait_one_behind_another(run, persistent, expected):
    # sin(t) > 0.5 at pi/6 and every 2 pi, until 5 pi/6: after the delay of 10 it has ceased to hold.
    text = sbml(
        parameters({"x": 0.0, "n": 0.0}, {"x": 1})
        + events(
            event("E", ("gt", ("sin", "x"), 0.5), {"n": ("plus", "n", 1)}, delay=10, persistent=persistent, early=False)
        )
    )
    found, _ = run(text, 0.5, 36)
    assert found["n_"][::12].tolist() == expected


def test_more_executions_than_there_is_room_for_are_a_failure(run):
    text = sbml(
        parameters({"x": 0.0, "k": 0.0}, {"x": 1})
        + events(event("E", ("gt", ("sin", ("times", 20, "x")), 0.5), {"k": ("plus", "k", 1)}, delay=10))
    )
    _, ending = run(text, 0.05, 60)
    assert "E_overlap" in ending


def test_what_one_event_makes_true_waits_for_what_is_more_urgent(run):
    # A sets off B (priority 3), which goes before C (priority 1), due since the same time as A.
    def digit(name, trigger, number, priority):
        return event(name, trigger, {"log": ("plus", ("times", 10, "log"), number)}, priority=priority, early=False)

    text = sbml(
        parameters({"x": 0.0, "log": 0.0}, {"x": 1})
        + events(
            digit("C", ("geq", "x", 1), 3, 1),
            digit("A", ("geq", "x", 1), 1, 2),
            digit("B", ("eq", "log", 1), 2, 3),
        )
    )
    found, _ = run(text, 0.7, 2)
    assert found["log"].tolist() == [0, 0, 123]


@pytest.mark.parametrize(("initial", "expected"), [(True, 0), (False, 1)])
def test_a_condition_that_holds_at_the_start_becomes_true_there_only_by_its_initial_value(run, initial, expected):
    # p >= 1 from p = 1 downwards: it ceases to hold at once, and that is not a trigger.
    text = sbml(
        parameters({"p": 1.0, "q": 0.0}, {"p": -1}) + events(event("E", ("geq", "p", 1), {"q": 1}, initial=initial))
    )
    found, _ = run(text, 0.2, 3)
    assert found["q"].tolist() == [expected] * 4


def test_the_first_row_is_after_the_events_at_the_start(run):
    # E at the start sets x = 4 from y = 3; that makes F true, which doubles y from its value then.
    text = sbml(
        parameters({"x": 0.0, "y": 3.0, "z": 0.0}, {"z": 1})
        + events(
            event("E", ("gt", "y", 2), {"x": ("plus", "y", 1)}, initial=False),
            event("F", ("gt", "x", 3), {"y": ("times", 2, "y"), "z": 7}),
        )
    )
    found, _ = run(text, 1.0, 2)
    assert found["x"].tolist() == [4, 4, 4]
    assert found["y"].tolist() == [6, 6, 6]
    np.testing.assert_allclose(found["z"], [7, 8, 9])


COMPARTMENT = (
    '<listOfCompartments><compartment id="C" spatialDimensions="3" size="0.5" constant="false"/></listOfCompartments>'
    '<listOfSpecies><species id="S" compartment="C" initialConcentration="2" hasOnlySubstanceUnits="false"'
    ' boundaryCondition="true" constant="false"/></listOfSpecies>'
)


def test_an_event_that_resizes_a_compartment_leaves_the_amount_of_a_species_with_a_rate_rule(run):
    # S' = 0.4 and C' = 0.2 until C is put to 0.2 at 0.45: the amount (2 + 0.18) (0.5 + 0.09) stays.
    rules = "".join(f'<rateRule variable="{k}">{math(v)}</rateRule>' for k, v in {"S": 0.4, "C": 0.2}.items())
    text = sbml(
        COMPARTMENT + f"<listOfRules>{rules}</listOfRules>" + events(event("E", ("geq", "time", 0.45), {"C": 0.2}))
    )
    found, _ = run(text, 0.3, 3)
    after = 2.18 * 0.59 / 0.2
    np.testing.assert_allclose(found["S"], [2, 2.12, after + 0.4 * 0.15, after + 0.4 * 0.45], rtol=1e-7)
    np.testing.assert_allclose(found["C"], [0.5, 0.56, 0.23, 0.29], rtol=1e-9)


def test_a_concentration_set_with_its_compartment_counts_for_the_size_before(run):
    # 0.2 in the old size 0.5 are 0.1, in the new size 0.2: 0.5.
    text = sbml(COMPARTMENT + events(event("E", ("geq", "time", 0.45), {"S": 0.2, "C": 0.2})))
    found, _ = run(text, 0.3, 2)
    np.testing.assert_allclose(found["S"], [2, 2, 0.5])
    np.testing.assert_allclose(found["C"], [0.5, 0.5, 0.2])


def test_a_delay_from_the_start_takes_the_values_of_the_start(run):
    # E waits from 0 on with the value x = 1 although F sets x to 5 there.
    text = sbml(
        parameters({"x": 1.0, "y": 0.0, "z": 0.0}, {"z": 1})
        + events(
            event("E", ("lt", "x", 2), {"y": "x"}, delay=0.5, priority=2, initial=False),
            event("F", ("lt", "x", 2), {"x": 5}, priority=1, initial=False),
        )
    )
    found, _ = run(text, 0.4, 2)
    assert found["x"].tolist() == [5, 5, 5]
    assert found["y"].tolist() == [0, 0, 1]


def production(law, local=""):
    """One reaction that makes S."""
    return (
        '<listOfReactions><reaction id="J" reversible="false"><listOfProducts>'
        '<speciesReference species="S" stoichiometry="1" constant="true"/></listOfProducts>'
        f"<kineticLaw>{law}{local}</kineticLaw></reaction></listOfReactions>"
    )


def test_the_rate_of_a_parameter_of_a_reaction_is_zero(run):
    # A parameter of the model with the same name moves.
    rate = '<csymbol encoding="text" definitionURL="http://www.sbml.org/sbml/symbols/rateOf">rateOf</csymbol>'
    law = f'<math xmlns="{MATHML}"><apply>{rate}<ci>k</ci></apply></math>'
    local = '<listOfLocalParameters><localParameter id="k" value="3"/></listOfLocalParameters>'
    place = COMPARTMENT.replace('Condition="true"', 'Condition="false"')
    found, _ = run(sbml(place + parameters({"k": 1.0}, {"k": 2}) + production(law, local)), 1.0, 2)
    np.testing.assert_allclose(found["S"], [2, 2, 2])


def test_a_compartment_without_dimensions_has_a_size_in_level_3(run):
    # 1.5 per time into the size 2: S' = 0.75.
    place = COMPARTMENT.replace('"3" size="0.5" constant="false"', '"0" size="2" constant="true"')
    place = place.replace('Condition="true"', 'Condition="false"')
    found, _ = run(sbml(place + production(math(1.5))), 1.0, 2)
    np.testing.assert_allclose(found["S"], [2, 2.75, 3.5])


def random_events(seed):
    """Two to four events on two parameters and two states, with priorities, delays and both kinds of values."""
    draw = np.random.default_rng(seed)

    def one(of):
        return of[draw.integers(len(of))]

    def value():
        name = str(one(["a", "b", "x", "y"]))
        return one([0.7, ("plus", name, 0.4), ("times", 0.5, name), ("minus", name, "b")])

    def condition(number):
        crossing = (str(one(["gt", "lt"])), str(one(["x", "y", "a", "b"])), round(float(draw.uniform(0.3, 2.5)), 3))
        return one([("gt", "time", 0.73 + 0.29 * number), crossing])

    count = int(draw.integers(2, 5))
    priorities = draw.permutation(8)[:count]
    made = []
    for number in range(count):
        sets = {str(name): value() for name in draw.permutation(["a", "b", "x", "y"])[: draw.integers(1, 3)]}
        flags = {key: bool(draw.integers(2)) for key in ("early", "initial")}
        delay = one([None, None, 0.4137, 0.8731])
        priority = int(priorities[number])
        made.append(event(f"E{number}", condition(number), sets, delay=delay, priority=priority, **flags))
    start = {"a": 1.0, "b": 0.5, "x": 0.2, "y": 2.0}
    rates = {"x": ("minus", 1, ("times", 0.3, "x")), "y": ("times", -0.4, "y")}
    return sbml(parameters(start, rates) + events(*made)), start


@pytest.mark.parametrize("seed", range(25))
def test_random_events_agree_with_libroadrunner(seed, run):
    roadrunner = pytest.importorskip("roadrunner", reason="libRoadRunner is not installed")
    roadrunner.Logger.setLevel(roadrunner.Logger.LOG_FATAL)
    text, start = random_events(seed)
    found, _ = run(text, 0.1, 40, "--max-step", "0.02")
    peer = roadrunner.RoadRunner(text)
    peer.integrator.relative_tolerance, peer.integrator.absolute_tolerance = 1e-9, 1e-12
    peer.integrator.maximum_time_step = 0.01
    peer.timeCourseSelections = list(start)
    expected = np.array(peer.simulate(0, 4, 41))
    ours = np.array([found.get(name, np.full(41, value)) for name, value in start.items()]).T
    np.testing.assert_allclose(ours, expected, rtol=1e-5, atol=1e-5)


def test_events_of_one_priority_run_in_random_order(run):
    # Every 0.1 one of three events counts and ends the conditions of the others: a third of 600 each, 11.5 standard
    # deviation.
    ready = ("geq", ("minus", "time", "last"), 0.1)
    names = ["a", "b", "c"]
    made = [
        event(f"E{name}", ready, {name: ("plus", name, 1), "last": "time"}, priority=1, persistent=False)
        for name in names
    ]
    found, _ = run(sbml(parameters(dict.fromkeys([*names, "last"], 0.0)) + events(*made)), 1.0, 60)
    counts = np.array([found[name] for name in names])
    assert np.abs(counts.sum(axis=0) - 10 * np.arange(61)).max() <= 1
    assert np.abs(counts[:, -1] - 200).max() < 46
    assert len({tuple(row) for row in np.diff(counts).T}) > 20


@pytest.mark.parametrize("method", METHODS)
def test_a_trigger_reads_the_past(run, method):
    # x = t passes 1.5 at 1.5, and a time unit ago at 2.5. Before the start x is 0, time goes on.
    text = sbml(
        parameters({"x": 0.0, "y": 0.0, "now": 0.0, "z": 0.0}, {"x": 1}, {"now": "time"})
        + events(
            event("E", ("gt", ("delay", "x", 1), 1.5), {"y": "time"}),
            event("F", ("lt", ("delay", "now", 1), -0.5), {"z": 3}, initial=False),
            event("G", ("lt", ("delay", "x", 1), -0.5), {"z": 5}, initial=False),
        )
    )
    found, _ = run(text, 0.8, 4, "--method", method)
    np.testing.assert_allclose(found["y"], [0, 0, 0, 0, 2.5], atol=1e-8)
    assert found["z"].tolist() == [3] * 5


def test_an_initial_assignment_gives_the_values_before_the_start(run):
    # x = sin(10 t) up to the start, then 0; w follows it by a rule.
    wave = ("sin", ("times", 10, "time"))
    rules = {"w": ("plus", "x", 1), "y": ("delay", "x", 0.5), "z": ("delay", "w", 0.5)}
    rules["u"] = ("delay", ("delay", "w", 0.2), 0.3)
    names = ["x", "y", "z", "w", "u"]
    found, _ = run(sbml(parameters(dict.fromkeys(names, 0.0), (), rules, {"x": wave})), 0.07, 10)
    times = 0.07 * np.arange(11)
    expected = np.where(times < 0.5, np.sin(10 * (times - 0.5)), 0)
    np.testing.assert_allclose(found["y"], expected, atol=1e-7)
    np.testing.assert_allclose(found["z"], 1 + expected, atol=1e-7)
    np.testing.assert_allclose(found["u"], 1 + expected, atol=1e-7)


@pytest.mark.parametrize("method", METHODS)
def test_dead_times_that_change_may_be_zero(run, method):
    # x = t^2: half the time ago t^2/4; after the event at 1.1 a time unit ago, before that the present value.
    start = {"x": 0.0, "y": 0.0, "z": 0.0, "lag": 0.0}
    rules = {"y": ("delay", "x", ("divide", "time", 2)), "z": ("delay", "x", "lag")}
    text = sbml(
        parameters(start, {"x": ("times", 2, "time")}, rules) + events(event("E", ("geq", "time", 1.1), {"lag": 1}))
    )
    found, _ = run(text, 0.25, 10, "--method", method)
    times = 0.25 * np.arange(11)
    np.testing.assert_allclose(found["y"], times**2 / 4, atol=1e-6)
    np.testing.assert_allclose(found["z"], np.where(times < 1.1, times, times - 1) ** 2, atol=1e-6)


def test_a_negative_dead_time_ends_the_run_by_name(run):
    start = {"x": 0.0, "y": 0.0}
    rules = {"y": ("delay", "x", ("minus", 1, "time"))}
    found, ending = run(sbml(parameters(start, {"x": 1}, rules)), 0.3, 10)
    assert "dead_time_1" in ending
    assert found["x"][-1] == pytest.approx(1, abs=1e-6)


def test_a_value_without_a_case_is_not_a_number(run):
    rules = {"y": ("if", "x", ("lt", "x", 0.75))}
    found, _ = run(sbml(parameters({"x": 0.0, "y": 0.0}, {"x": 1}, rules)), 0.5, 2)
    np.testing.assert_allclose(found["y"], [0, 0.5, np.nan])
