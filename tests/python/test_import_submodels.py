"""Hierarchical SBML models (package `comp`) become one model, against closed forms."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from smpl.commands.main import main

COMP = "http://www.sbml.org/sbml/level3/version1/comp/version1"

# In a submodel `s` decays with the constant `k`, `total` is `s + 1`, and `clock` is its time.
DECAY = """
<comp:modelDefinition id="decay">
  <listOfCompartments><compartment id="C" size="1" constant="true"/></listOfCompartments>
  <listOfSpecies>
    <species id="s" compartment="C" initialAmount="2" hasOnlySubstanceUnits="true" boundaryCondition="false"
      constant="false"/>
  </listOfSpecies>
  <listOfParameters>
    <parameter metaid="meta_k" id="k" value="0.5" constant="true"/>
    <parameter id="total" constant="false"/>
    <parameter id="clock" constant="false"/>
  </listOfParameters>
  <listOfRules>
    <assignmentRule metaid="sum" variable="total">MATH<apply><plus/><ci>s</ci><cn>1</cn></apply></math></assignmentRule>
    <assignmentRule variable="clock">
      MATH<csymbol encoding="text" definitionURL="http://www.sbml.org/sbml/symbols/time">t</csymbol></math>
    </assignmentRule>
  </listOfRules>
  <listOfReactions>
    <reaction id="R" reversible="false">
      <listOfReactants><speciesReference species="s" stoichiometry="1" constant="true"/></listOfReactants>
      <kineticLaw>MATH<apply><times/><ci>k</ci><ci>s</ci></apply></math></kineticLaw>
    </reaction>
  </listOfReactions>
  <comp:listOfPorts><comp:port comp:id="amount" comp:idRef="s"/></comp:listOfPorts>
</comp:modelDefinition>
<comp:modelDefinition id="pair">
  <comp:listOfSubmodels>
    <comp:submodel comp:id="a" comp:modelRef="decay"/>
    <comp:submodel comp:id="b" comp:modelRef="decay"/>
  </comp:listOfSubmodels>
</comp:modelDefinition>
"""


def document(model: str, definitions: str = DECAY) -> str:
    text = f"""<?xml version="1.0" encoding="UTF-8"?>
<sbml xmlns="http://www.sbml.org/sbml/level3/version2/core" xmlns:comp="{COMP}" comp:required="true"
  level="3" version="2">
<model id="whole">
{model}
</model>
<comp:listOfModelDefinitions>{definitions}</comp:listOfModelDefinitions>
</sbml>
"""
    text = text.replace("modelDefinition id=", "modelDefinition comp:id=")
    return text.replace("MATH", '<math xmlns="http://www.w3.org/1998/Math/MathML">')


@pytest.fixture
def run(tmp_path, capfd):
    """Times from 0 to 2, and values by name."""

    def values(text, *names):
        source, model, table = (tmp_path / name for name in ("m.xml", "m.eq", "m.csv"))
        source.write_text(text, encoding="utf-8")
        assert main(["import", str(source), "-o", str(model)]) == 0, capfd.readouterr().err
        extra = [f"let read_{number} : 1 = value({name})" for number, name in enumerate(names)]
        model.write_text("\n".join([model.read_text(encoding="utf-8"), *extra, ""]), encoding="utf-8")
        options = ["--set", "step=0.1", "--set", "max_steps=20", "--rtol", "1e-10", "--start", "nominal"]
        assert main(["simulate", str(model), *options, "--out", str(table)]) == 0, capfd.readouterr().err
        head, *rows = csv.reader(table.read_text(encoding="utf-8").splitlines())
        places = [head.index(f"read_{number}") for number in range(len(names))]
        return np.linspace(0, 2, 21), *(np.array([float(row[place]) for row in rows]) for place in places)

    return values


def submodel(inside: str = "", factors: str = "") -> str:
    return f"""
    <comp:listOfSubmodels>
      <comp:submodel comp:id="sub" comp:modelRef="decay" {factors}>{inside}</comp:submodel>
    </comp:listOfSubmodels>
    """


def parameter(name: str, value: float, inside: str = "", constant: str = "true") -> str:
    return f'<parameter id="{name}" value="{value}" constant="{constant}">{inside}</parameter>'


def replaces(reference: str, more: str = "") -> str:
    element = f'<comp:replacedElement comp:submodelRef="sub" {reference}>{more}</comp:replacedElement>'
    return f"<comp:listOfReplacedElements>{element}</comp:listOfReplacedElements>"


def test_the_parts_of_a_submodel_have_its_name_in_front(run):
    t, s, total, clock = run(document(submodel()), "sub__s", "sub__total", "sub__clock")
    assert s == pytest.approx(2 * np.exp(-0.5 * t), rel=1e-7)
    assert total == pytest.approx(s + 1)
    assert clock == pytest.approx(t)


@pytest.mark.parametrize("reference", ['comp:idRef="k"', 'comp:metaIdRef="meta_k"'])
def test_a_parameter_replaces_that_of_a_submodel(reference, run):
    listed = f"<listOfParameters>{parameter('fast', 1.5, replaces(reference))}</listOfParameters>"
    t, s = run(document(listed + submodel()), "sub__s")
    assert s == pytest.approx(2 * np.exp(-1.5 * t), rel=1e-7)


def test_a_replacement_with_a_factor_converts_values_rules_and_reactions(run):
    # `s` of the submodel is `g/1000` with k = 0.5; `total` is `y/4`.
    species = f"""
    <listOfCompartments>
      <compartment id="C" size="1" constant="true">{replaces('comp:idRef="C"')}</compartment>
    </listOfCompartments>
    <listOfSpecies>
      <species id="g" compartment="C" initialAmount="3000" hasOnlySubstanceUnits="true" boundaryCondition="false"
        constant="false">{replaces('comp:portRef="amount" comp:conversionFactor="milli"')}</species>
    </listOfSpecies>
    <listOfParameters>
      {parameter("milli", 1000)}{parameter("four", 4)}
      {parameter("y", 0, replaces('comp:idRef="total" comp:conversionFactor="four"'), "false")}
    </listOfParameters>
    """
    t, g, y = run(document(species + submodel()), "g", "y")
    assert g == pytest.approx(3000 * np.exp(-0.5 * t), rel=1e-7)
    assert y == pytest.approx(4 * (g / 1000 + 1), rel=1e-9)


def test_factors_of_a_submodel_convert_its_time_and_extents(run):
    listed = f"<listOfParameters>{parameter('minute', 60)}{parameter('two', 2)}</listOfParameters>"
    factors = 'comp:timeConversionFactor="minute" comp:extentConversionFactor="two"'
    t, s, clock = run(document(listed + submodel("", factors)), "sub__s", "sub__clock")
    assert s == pytest.approx(2 * np.exp(-0.5 * 2 / 60 * t), rel=1e-7)
    assert clock == pytest.approx(t / 60)


def test_a_deleted_rule_leaves_the_value_of_its_parameter(run):
    deletion = '<comp:listOfDeletions><comp:deletion comp:metaIdRef="sum"/></comp:listOfDeletions>'
    named = DECAY.replace('<parameter id="total"', '<parameter id="total" value="7"')
    _, total = run(document(submodel(deletion), named), "sub__total")
    assert total == pytest.approx(7)


def test_an_element_is_replaced_by_that_of_a_submodel(run):
    by = '<comp:replacedBy comp:submodelRef="sub" comp:idRef="total"/>'
    listed = f"<listOfParameters>{parameter('outer', 99, by, 'false')}</listOfParameters>"
    t, outer = run(document(listed + submodel()), "outer")
    assert outer == pytest.approx(2 * np.exp(-0.5 * t) + 1, rel=1e-7)


def test_references_go_into_submodels_of_submodels(run):
    nested = '<comp:sBaseRef comp:idRef="k"/>'
    listed = f"""
    <listOfParameters>{parameter("fast", 3, replaces('comp:idRef="b"', nested))}</listOfParameters>
    {submodel().replace('"decay"', '"pair"')}
    """
    t, a, b = run(document(listed), "sub__a__s", "sub__b__s")
    assert a == pytest.approx(2 * np.exp(-0.5 * t), rel=1e-7)
    assert b == pytest.approx(2 * np.exp(-3 * t), rel=1e-7)


def test_models_that_refer_to_their_own_definition_are_refused(tmp_path, capfd):
    circle = DECAY.replace('comp:id="b" comp:modelRef="decay"', 'comp:id="b" comp:modelRef="pair"')
    check_refused(document(submodel().replace('"decay"', '"pair"'), circle), "without end", tmp_path, capfd)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('comp:modelRef="decay" ', 'comp:modelRef="gone" ', "unknown model definition `gone`"),
        ('comp:idRef="k"', 'comp:idRef="q"', "unknown `idRef` `q`"),
        ('comp:submodelRef="sub"', 'comp:submodelRef="other"', "unknown submodel `other`"),
        (
            "<comp:listOfModelDefinitions>",
            '<comp:externalModelDefinition comp:id="x"/><comp:listOfModelDefinitions>',
            "another file",
        ),
        ('id="C" size', 'id="C" siez', "the attribute `siez` of `compartment` is not known"),
        ('variable="total"', 'variable="totall"', "unknown symbol `totall`"),
    ],
)
def test_references_to_nothing_are_refused_with_their_line(old, new, message, tmp_path, capfd):
    replaced = replaces('comp:idRef="k"')
    listed = f"<listOfParameters>{parameter('fast', 1.5, replaced)}</listOfParameters>"
    text = document(listed + submodel())
    assert old in text
    changed = text.replace(old, new, 1)
    line = next(number for number, row in enumerate(changed.splitlines(), 1) if new in row)
    check_refused(changed, message, tmp_path, capfd, line)


def check_refused(text, message, folder, capfd, line=None):
    path = folder / "m.xml"
    path.write_text(text, encoding="utf-8")
    assert main(["import", str(path), "-o", str(folder / "m.eq")]) == 1
    error = capfd.readouterr().err
    assert message in error
    assert line is None or f"line {line}:" in error
