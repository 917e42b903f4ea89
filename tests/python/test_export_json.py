"""Models exported as JSON mean what the machine code computes."""

import json
from pathlib import Path

import numpy as np
import pytest

import smpl
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
            continue  # variants that want others
        compare(model, 10)


@pytest.mark.parametrize("path", sorted((ROOT / "tests" / "problems").glob("*.eq")), ids=lambda path: path.stem)
def test_the_tree_of_every_test_problem_gives_the_residual_of_the_machine_code(path):
    compare(smpl.compile(path))


def test_the_text_follows_the_schema():
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
    schema = json.loads((ROOT / "docs" / "schema" / "model-1.schema.json").read_text())
    validator = jsonschema.Draft202012Validator(schema)
    for name in ("reactor", "beer", "pensim"):
        validator.validate(smpl.export.json(smpl.compile(name)))
    broken = smpl.export.json(smpl.compile("reactor"))
    broken["expressions"][0] = ["sum", 0]
    assert not validator.is_valid(broken)


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
