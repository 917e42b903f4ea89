"""Random models (see test_random_models.py) in every form compute what their texts say."""

import shutil

import numpy as np
import pytest

import smpl
from exports.library import Library
from exports.tree import Tree
from random_models import RandomModel, flat
from test_random_models import Point, assert_close

SEEDS = range(24)


class Case:
    """A random model at a random point, with the residual that its text says."""

    def __init__(self, seed, time=1.7):
        drawn = RandomModel(seed)
        generator = np.random.default_rng((seed, 2))
        self.model, self.time = smpl.compile(source=drawn.text), time
        point = Point(drawn, self.model, generator, time)
        variables = {flat(key): key for key in drawn.elements("var")}
        n = len(point.x)
        solved = [variables[name] for name in self.model.unknown_names[n:]]
        self.x, self.z, self.u, self.p = point.x, point.values(solved)[0], point.u, point.p
        self.dx = generator.normal(size=n)
        self.residual = np.concatenate([point.rates[0] - self.dx, np.zeros(len(solved))])


@pytest.fixture(params=SEEDS, scope="module")
def case(request):
    return Case(request.param)


def test_the_tree(case):
    tree = Tree(smpl.export.json(case.model), 1)
    tree.set_nominal()
    tree.time = np.array([case.time])
    names = [e["name"] for e in tree.tree["elements"]["parameters"]]
    given = next((i for i, v in enumerate(tree.tree["variables"]) if v["role"] == "given"), None)
    for name, value in case.p.items():
        element = tree.tree["elements"]["parameters"][names.index(name)]
        tree.values["value"][element["variable"]][element["element"]] = value
    if given is not None:  # what is computed from parameters follows them
        lengths = [v["length"] if v["role"] == "parameter" else 0 for v in tree.tree["variables"]]
        first = np.concatenate([[0], np.cumsum(lengths)])
        for name in case.p:
            element = tree.tree["elements"]["parameters"][names.index(name)]
            tree.values["value"][given][first[element["variable"]] + element["element"]] = 1.0
        tree.run("parameters")
    tree.set("states", case.x[:, None])
    tree.set("solved", case.z[:, None])
    tree.set("states", case.dx[:, None], "derivative")
    tree.set("actions", case.u[:, None])
    assert_close("residual", tree.residual()[:, 0], case.residual)


def test_casadi(case):
    pytest.importorskip("casadi", reason="casadi is not installed")
    for kind in ("SX", "MX"):
        functions = smpl.export.casadi(case.model, kind)
        time = {functions.time_name: case.time} if functions.time_name in functions.parameter_names else {}
        found = functions.residual(case.dx, case.x, case.z, case.u, functions.parameters(case.p | time))
        assert_close(f"residual of {kind}", np.array(found).ravel(), case.residual)


def test_jax(case):
    jax = pytest.importorskip("jax", reason="jax is not installed")
    jax.config.update("jax_enable_x64", True)
    functions = smpl.export.jax(case.model)
    found = functions.residual(case.time, case.dx, case.x, case.z, case.u, functions.parameters(case.p))
    assert_close("residual", np.array(found), case.residual)


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_c(case, tmp_path):
    library = Library(case.model, tmp_path)
    elements = smpl.export.json(case.model)["elements"]
    nominal = {
        e["name"]: e["nominal"] for family in ("parameters", "discretes", "disturbances") for e in elements[family]
    }
    p, c = (
        np.array([values.get(name, 0.0) for name in library.names(table)])
        for table, values in (
            ("parameters", nominal | case.p),
            ("context", {f"given({name})": 1.0 for name in case.p} | {"step_length": 1.0}),
        )
    )
    y, yp = np.concatenate([case.x, case.z]), np.concatenate([case.dx, 0.0 * case.z])
    if "parameters" in library.arguments:
        _, p = library("parameters", 0.0, y, yp, case.u, p, c)
    assert_close("residual", library("residual", case.time, y, yp, case.u, p, c), case.residual)
