"""Models exported as JSON mean what the machine code computes."""

import json
from pathlib import Path

import numpy as np
import pytest

import smpl
from exports.cases import CASES
from exports.points import MODELS, Points, assert_equal, label, variants
from exports.tree import Tree

ROOT = Path(__file__).resolve().parents[2]
COUNT = 100


def compare(model, count=COUNT):
    tree = smpl.export.json(model)
    points = Points(model, tree, count)
    evaluator = Tree(tree, count)
    evaluator.set_nominal()
    evaluator.time = points.t
    evaluator.set("states", points.x)
    evaluator.set("solved", points.z)
    evaluator.set("states", points.yp[: len(points.x)], "derivative")
    evaluator.set("solved", points.yp[len(points.x) :], "derivative")
    evaluator.set("actions", points.u)
    evaluator.set("discretes", points.d)
    evaluator.set("disturbances", points.w)
    # Other instants are those of an episode that begins at the point, with nominal actions before.
    nominal = [np.full(count, element["nominal"], float) for element in tree["elements"]["actions"]]
    families = ("states", "solved", "actions", "discretes", "disturbances")
    for family, values in zip(families, (points.x, points.z, nominal, points.d, points.w), strict=True):
        evaluator.set(family, values, "initial")
        evaluator.set(family, values, "previous")
    clock = [i for i, v in enumerate(tree["variables"]) if v["role"] == "builtin"]
    for variable in clock:
        evaluator.values["value"][variable][1] = points.t
        evaluator.values["value"][variable][2] = model.step
    with np.errstate(all="ignore"):
        found = evaluator.residual()
    assert_equal(found, points.machine_code(model))


@pytest.mark.parametrize(("name", "arguments"), MODELS, ids=label)
def test_the_tree_of_every_model_and_scenario_gives_the_residual_of_the_machine_code(name, arguments):
    compare(smpl.compile(name, **arguments))


@pytest.mark.parametrize("name", ["reactor", "beer", "pensim"])
def test_the_tree_of_every_variant_gives_the_residual_of_the_machine_code(name):
    for variant in variants(name):
        try:
            model = smpl.compile(name, variants=[variant])
        except (smpl.CompileError, smpl.ScenarioError):
            continue  # variants that require others
        compare(model, 10)


@pytest.mark.parametrize("path", sorted((ROOT / "tests" / "problems").glob("*.eq")), ids=lambda path: path.stem)
def test_the_tree_of_every_test_problem_gives_the_residual_of_the_machine_code(path):
    compare(smpl.compile(path))


@pytest.mark.parametrize(("title", "model"), CASES, ids=[title for title, _ in CASES])
def test_the_tree_of_every_case_of_the_language_gives_the_residual_of_the_machine_code(title, model):
    compare(model, 10)


def test_the_text_follows_the_schema():
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
    schema = json.loads((ROOT / "docs" / "schema" / "model-3.schema.json").read_text())
    validator = jsonschema.Draft202012Validator(schema)
    for name in ("reactor", "beer", "pensim"):
        validator.validate(smpl.export.json(smpl.compile(name)))
    broken = smpl.export.json(smpl.compile("reactor"))
    broken["expressions"][0] = ["sum", 0]
    assert not validator.is_valid(broken)


def round_trip(model, folder, count=20):
    """A model read from JSON is written as the same bytes and computes the same bits."""
    text = smpl.export.text(model, "json")["json"]
    path = folder / "model.json"
    path.write_text(text, encoding="utf-8")
    again = smpl.compile(path)
    assert smpl.export.text(again, "json")["json"] == text
    points = Points(model, json.loads(text), count)
    with np.errstate(all="ignore"):
        first, second = points.machine_code(model), points.machine_code(again)
    assert first.tobytes() == second.tobytes()
    return again


@pytest.mark.parametrize(("name", "arguments"), MODELS, ids=label)
def test_every_model_and_scenario_is_read_from_its_json_as_it_was(name, arguments, tmp_path):
    model = smpl.compile(name, **arguments)
    again = round_trip(model, tmp_path)
    assert again.observation_names == model.observation_names
    first, second = (smpl.Env(m).reset(seed=5)[0] for m in (model, again))
    assert np.array_equal(first, second)


@pytest.mark.parametrize("name", ["reactor", "beer", "pensim"])
def test_every_variant_is_read_from_its_json_as_it_was(name, tmp_path):
    for variant in variants(name):
        try:
            model = smpl.compile(name, variants=[variant])
        except (smpl.CompileError, smpl.ScenarioError):
            continue  # variants that require others
        round_trip(model, tmp_path, 5)


@pytest.mark.parametrize("path", sorted((ROOT / "tests" / "problems").glob("*.eq")), ids=lambda path: path.stem)
def test_every_test_problem_is_read_from_its_json_as_it_was(path, tmp_path):
    round_trip(smpl.compile(path), tmp_path)


def nominal(model, name):
    return next(e["nominal"] for e in smpl.export.json(model)["elements"]["parameters"] if e["name"] == name)


def test_a_model_in_json_runs_as_the_model_itself(tmp_path):
    model = smpl.compile("beer", scenario="legacy", settings={"step": 4})
    again = round_trip(model, tmp_path)
    runs = []
    for each in (model, again):
        env = smpl.Env(each)
        env.reset(seed=3)
        action = np.zeros(env.action_space.shape, np.float32)
        runs.append(np.array([env.step(action)[0] for _ in range(10)]))
    assert np.array_equal(runs[0], runs[1])


def test_a_model_in_json_still_watches_rates_of_expressions_that_may_jump(tmp_path):
    """With x = t the factor jumps by c at 1.5 s."""
    text = """
time t : s
param c = 0 in -1..1
state x = 0
state V = 1
eq d/dt x = 1 [1/s]
eq d/dt (V*(if x > 1.5 then 1 + c else 1)) = 1 [1/s]
observe V in 0..9
episode { step = 1 [s], max_steps = 3 }
"""
    model = smpl.compile(source=text)
    assert smpl.export.json(model)["reduction"]["unsteady"] == [{"failure": 0, "of": "x"}]
    for each in (model, round_trip(model, tmp_path)):
        env = smpl.Env(each)
        env.reset(options={"parameters": {"c": 0.25}})
        env.step([])
        *_, info = env.step([])
        assert info["failure"].startswith("jump_by_x") and info["time"] == pytest.approx(1.5, rel=1e-7)


def test_a_model_in_json_takes_parameters_and_no_other_scenario(tmp_path):
    path = tmp_path / "reactor.json"
    path.write_text(
        smpl.export.text(smpl.compile("reactor", settings={"k_0": 7.0e10}), "json")["json"], encoding="utf-8"
    )
    assert nominal(smpl.compile(path), "k_0") == 7.0e10
    assert nominal(smpl.compile(path, settings={"k_0": 6.9e10}), "k_0") == 6.9e10
    with pytest.raises(smpl.SimulationError, match="neither scenario nor variants but its own"):
        smpl.compile(path, scenario="legacy")
    path.write_text(path.read_text(encoding="utf-8").replace('"version": 3', '"version": 1'), encoding="utf-8")
    with pytest.raises(smpl.SimulationError, match="version 1 of the form; this program reads version 3"):
        smpl.compile(path)


def test_units_bounds_and_shapes_stand_beside_the_names():
    tree = smpl.export.json(smpl.compile("reactor"))
    model = smpl.compile("reactor")
    low, high = model.native.bounds("state")
    states = tree["elements"]["states"]
    assert [e["name"] for e in states] == list(model.state_names)
    assert [e["unit"] for e in states] == list(model.state_units)
    assert [e["low"] if e["low"] is not None else -np.inf for e in states] == list(low)
    assert [e["high"] if e["high"] is not None else np.inf for e in states] == list(high)


def test_an_unknown_target_is_refused_with_the_list_of_those_that_there_are():
    with pytest.raises(ValueError, match=r"unknown target `fortran`; known: .*json"):
        smpl.export.text(smpl.compile("reactor"), "fortran")
