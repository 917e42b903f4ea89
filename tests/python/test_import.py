"""Models in SBML, imported, move as their equations say."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import smpl
from conftest import ROOT
from smpl.commands.main import main

SBML = ROOT / "tests" / "sbml"
ENDINGS = ("reward", "terminated", "truncated")


class Outcome:
    """Exit status and output of a command."""

    def __init__(self, status, error):
        self.status = status
        self.error = error


@pytest.fixture
def convert(capfd):
    """Imports a file."""

    def run(path, output):
        status = main(["import", str(path), "-o", str(output)])
        wording = Outcome(status, capfd.readouterr().err)
        assert "internal error" not in wording.error
        return wording

    return run


@pytest.fixture
def trajectory(convert, capfd):
    """Times, and the values by name, of a run of an imported file."""

    def run(path, folder, end, count=40):
        text, table = folder / f"{path.stem}.eq", folder / f"{path.stem}.csv"
        wording = convert(path, text)
        assert wording.status == 0, wording.error
        settings = ["--set", f"step={end / count!r}", "--set", f"max_steps={count}", "--rtol", "1e-10"]
        assert main(["simulate", str(text), "--start", "nominal", *settings, "--out", str(table)]) == 0, (
            capfd.readouterr().err
        )
        names, *rows = csv.reader(table.read_text(encoding="utf-8").splitlines())
        columns = {
            name: column for name, column in zip(names, zip(*rows, strict=True), strict=True) if name not in ENDINGS
        }
        assert len(rows) == count + 1
        return np.linspace(0.0, end, count + 1), {name: np.array(column, float) for name, column in columns.items()}

    return run


def solved(rates, start, times, **options):
    found = solve_ivp(
        rates, (times[0], times[-1]), start, t_eval=times, rtol=1e-11, atol=1e-13, method="LSODA", **options
    )
    assert found.success
    return found.y


def close(found, expected, tolerance=1e-6):
    assert np.abs(found - expected).max() <= tolerance * np.abs(expected).max()


def test_michaelis_menten(tmp_path, trajectory):
    t, found = trajectory(SBML / "michaelis_menten.xml", tmp_path, 5.0)
    s, p = solved(lambda t, y: [-3 * y[0] / (0.5 + y[0]), 6 * y[0] / (0.5 + y[0])], [10.0, 0.5], t)
    close(found["S"], s)
    close(found["P"], p)


def test_the_text_is_that_of_the_page(tmp_path, convert):
    out = tmp_path / "m.eq"
    assert convert(SBML / "michaelis_menten.xml", out).status == 0
    page = (ROOT / "docs" / "import.md").read_text(encoding="utf-8")
    assert out.read_text(encoding="utf-8") in page


def test_the_brusselator_of_level_2(tmp_path, trajectory):
    t, found = trajectory(SBML / "brusselator.xml", tmp_path, 20.0)

    def rates(_, y):
        x, y = y
        return [1 - 4 * x + 1.1 * x**2 * y, 3 * x - 1.1 * x**2 * y]

    x, y = solved(rates, [1.2, 3.1], t)
    close(found["X"], x, 1e-5)
    close(found["Y"], y, 1e-5)


def test_the_repressilator(tmp_path, trajectory):
    t, found = trajectory(SBML / "repressilator.xml", tmp_path, 10.0)

    def rates(_, y):
        m, p = y[:3], y[3:]
        repressors = p[[1, 2, 0]]
        return [*(216 / (1 + (repressors / 40) ** 2) + 0.216 - m), *(5 * m - 5 * p)]

    expected = solved(rates, [0, 0, 0, 5, 0, 15], t)
    for name, values in zip(["m1", "m2", "m3", "p1", "p2", "p3"], expected, strict=True):
        close(found[name], values)


DELAYED = """<?xml version="1.0" encoding="UTF-8"?>
<sbml xmlns="http://www.sbml.org/sbml/level3/version2/core" level="3" version="2">
  <model id="delayed">
    <listOfParameters>
      <parameter id="x" value="1" constant="false"/>
      <parameter id="y" constant="false"/>
      <parameter id="w" constant="false"/>
    </listOfParameters>
    <listOfRules>
      <rateRule variable="x"><math xmlns="http://www.w3.org/1998/Math/MathML">
        <apply><minus/><apply>DELAY<ci>x</ci><cn>1</cn></apply></apply>
      </math></rateRule>
      <assignmentRule variable="y"><math xmlns="http://www.w3.org/1998/Math/MathML">
        <apply><sin/><csymbol encoding="text" definitionURL="http://www.sbml.org/sbml/symbols/time">t</csymbol></apply>
      </math></assignmentRule>
      <assignmentRule variable="w"><math xmlns="http://www.w3.org/1998/Math/MathML">
        <apply>DELAY<ci>y</ci><cn>0.5</cn></apply>
      </math></assignmentRule>
    </listOfRules>
  </model>
</sbml>
""".replace("DELAY", '<csymbol encoding="text" definitionURL="http://www.sbml.org/sbml/symbols/delay">delay</csymbol>')


def test_a_delay_reads_the_past_and_goes_on_into_the_time_before_the_start(tmp_path, trajectory):
    file = tmp_path / "delayed.xml"
    file.write_text(DELAYED, encoding="utf-8")
    t, found = trajectory(file, tmp_path, 5.0)
    # Pieces of the method of steps: the sum of (-1)^k (t - k + 1)^k / k! as far as t - k + 1 is positive.
    terms = [(-1) ** k * np.maximum(t - k + 1, 0) ** k / math.factorial(k) for k in range(1, 7)]
    close(found["x"], 1 + sum(terms))
    close(found["w"], np.sin(t - 0.5), 1e-5)


def test_doses_are_given_when_little_is_left(tmp_path, trajectory):
    t, found = trajectory(SBML / "doses.xml", tmp_path, 9.9, 37)
    # Between doses the drug decays; the times at which it reaches 4 are known.
    level, dose, start, count = 10.0, 40.0, 0.0, 0
    changes = []
    while True:
        start += np.log(level / 4.0) / 0.3
        if start > t[-1]:
            break
        level, dose, count = 4.0 + dose / 5.0, dose / 2.0, count + 1
        changes.append((start, level, dose, count))
    expected = 10.0 * np.exp(-0.3 * t)
    number = np.zeros_like(t)
    for start, level, _, count in changes:
        after = t >= start
        expected[after] = level * np.exp(-0.3 * (t[after] - start))
        number[after] = count
    assert len(changes) >= 3
    close(found["drug"], expected)
    assert np.array_equal(found["n_"], number)
    given = 5.0 * np.array([sum(40.0 / 2**i / 5.0 for i in range(int(n))) for n in number])
    close(found["out"], 50.0 + given - 5.0 * expected)


def test_a_compartment_that_grows_dilutes(tmp_path, trajectory):
    t, found = trajectory(SBML / "growing.xml", tmp_path, 10.0, 41)
    # V = exp(0.1 t) passes 1.5 once; one is added to the concentration there.
    when = np.log(1.5) / 0.1
    v = np.exp(0.1 * t)
    s = 10.0 * np.exp(-0.2 * t)
    added = np.where(t >= when, 1.5 * np.exp(-0.2 * (t - when)), 0.0)
    close(found["V"], v)
    close(found["S_amount"], s + added)
    close(found["P_amount"], 10.0 - s + np.where(t >= when, 1.5, 0.0) - added)
    close(found["Q"], 3.0 * np.exp(-0.1 * t))


def test_the_amount_of_a_boundary_species_stays_where_its_compartment_fills(tmp_path, trajectory):
    t, found = trajectory(SBML / "fed.xml", tmp_path, 10.0)
    v = 2.0 + 0.1 * t
    # dn/dt = -n 0.8/V from n = 2
    amount = 2.0 * (v / 2.0) ** -8
    close(found["A_amount"], amount)
    close(found["E"], 0.8 / v)
    close(found["B"], 2.0 + 2.0 - amount)


def test_an_event_reads_the_values_from_before_it(tmp_path, trajectory):
    t, found = trajectory(SBML / "swap.xml", tmp_path, 6.0, 31)
    before, after = t < 3.0, t >= 3.0
    x, y = np.exp(-0.3), 2 * np.exp(0.6)
    close(found["x"], np.where(before, np.exp(-0.1 * t), y * np.exp(-0.1 * (t - 3))))
    close(found["y"], np.where(before, 2 * np.exp(0.2 * t), x * np.exp(0.2 * (t - 3))))
    close(found["w"], np.where(after, x + y, 0.0))


def test_units_are_declared_where_they_change_nothing(tmp_path, convert):
    out = tmp_path / "m.eq"
    assert "note" not in convert(SBML / "doses.xml", out).error
    assert "param threshold : mg/L = 4" in out.read_text(encoding="utf-8")
    # Grams among milligrams: the language would convert, SBML does not.
    text = (SBML / "doses.xml").read_text(encoding="utf-8")
    mixed = tmp_path / "mixed.xml"
    mixed.write_text(
        text.replace('id="dose" value="40" units="mg"', 'id="dose" value="40" units="gram"'), encoding="utf-8"
    )
    result = convert(mixed, out)
    assert "a factor would be put where units differ" in result.error
    assert 'discrete dose = 40    "in g"' in out.read_text(encoding="utf-8")
    smpl.compile(out)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<sbml", "<sbml <", "invalid XML"),
        ('level="3"', 'level="1"', "SBML Level 1 is not read"),
        (
            "</trigger>",
            "</trigger><delay>MATH<cn>2</cn></math></delay><delay>MATH<cn>3</cn></math></delay>",
            "line 34: a second `delay` in `event`",
        ),
        ("<lt/>", "<eq/>", "the trigger of the event `again` asks for equality"),
        ("<lt/>", "<foo/>", "the operator `foo` of MathML has no counterpart"),
        ('fast="false"', 'fast="true"', "the reaction `elimination` is fast"),
        ("<ci>threshold</ci>", "<ci>treshold</ci>", "unknown symbol `treshold`"),
        ('size="5"', "", "`plasma` has no value"),
        ('id="k" value="0.3"', 'id="k" value="much"', "line 16: `much` is not a number"),
        ('id="out" compartment', 'id="drug" compartment', "the id `drug` is used twice"),
        (
            "<listOfEvents>",
            "<listOfWonders><wonder/></listOfWonders><listOfEvents>",
            "`wonder` in `listOfWonders` is not known",
        ),
        (
            'level="3"',
            'xmlns:distrib="http://www.sbml.org/x/distrib/version1" distrib:required="true" level="3"',
            "package `distrib` is required",
        ),
        ('variable="n"', 'variable="k"', "`k` is constant, and an event changes it"),
        ("</kineticLaw>", "</kineticLaw><kineticLaw/>", "a second `kineticLaw` in the reaction `elimination`"),
        (
            'initialConcentration="10"',
            'initialConcentration="10" initialAmount="50"',
            "a species has an `initialAmount` or an `initialConcentration`, not both",
        ),
        ("<cn>", '<cn base="16">', "a number to the base 16 is not read"),
        ('id="k" value="0.3"', 'id="k" valeu="0.3"', "line 16: the attribute `valeu` of `parameter` is not known"),
        (
            "<listOfEvents>",
            '<comp:listOfSubmodels xmlns:comp="http://www.sbml.org/sbml/level3/version1/comp/version1"/><listOfEvents>',
            "`listOfSubmodels` of the package `comp`, which is not declared",
        ),
        ("<kineticLaw>", "<listOfModifiers/><other/><kineticLaw>", "`other` in `reaction` is not known"),
    ],
    ids=lambda value: value[:20],
)
def test_what_cannot_be_carried_is_refused_by_name(old, new, message, tmp_path, convert):
    text = (SBML / "doses.xml").read_text(encoding="utf-8")
    assert old in text
    new = new.replace("MATH", '<math xmlns="http://www.w3.org/1998/Math/MathML">')
    path = tmp_path / "m.xml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    result = convert(path, tmp_path / "m.eq")
    assert result.status == 1
    assert message in result.error
    assert not (tmp_path / "m.eq").exists()


FAST = """<?xml version="1.0" encoding="UTF-8"?>
<sbml xmlns="http://www.sbml.org/sbml/level3/version1/core" level="3" version="1"><model id="fast">
<listOfCompartments><compartment id="cell" spatialDimensions="3" size="2" constant="true"/></listOfCompartments>
<listOfSpecies>
{species}
</listOfSpecies>
<listOfParameters>
<parameter id="k" value="0.6" constant="true"/><parameter id="K" value="2" constant="true"/>
</listOfParameters>
<listOfReactions>
<reaction id="swap" reversible="true" fast="true">
<listOfReactants><speciesReference species="A" stoichiometry="1" constant="true"/></listOfReactants>
<listOfProducts><speciesReference species="B" stoichiometry="{number}" constant="true"/></listOfProducts>
<kineticLaw><math xmlns="http://www.w3.org/1998/Math/MathML">{law}</math></kineticLaw></reaction>
<reaction id="loss" reversible="false" fast="false">
<listOfReactants><speciesReference species="B" stoichiometry="1" constant="true"/></listOfReactants>
<listOfProducts><speciesReference species="C" stoichiometry="1" constant="true"/></listOfProducts>
<kineticLaw><math xmlns="http://www.w3.org/1998/Math/MathML"><apply><times/><ci>k</ci><ci>B</ci></apply></math></kineticLaw>
</reaction>
</listOfReactions></model></sbml>
"""
LINEAR = "<apply><minus/><ci>A</ci><apply><times/><ci>K</ci><ci>B</ci></apply></apply>"
PRODUCT = "<apply><minus/><apply><times/><ci>A</ci><ci>B</ci></apply><ci>K</ci></apply>"
GROWING = "<apply><minus/><apply><times/><ci>K</ci><ci>B</ci></apply><ci>A</ci></apply>"


def fast_file(folder, law=LINEAR, number=1, amounts=False):
    kind = (
        f'compartment="cell" hasOnlySubstanceUnits="{str(amounts).lower()}" boundaryCondition="false" constant="false"'
    )
    starts = {"A": 4, "B": 5, "C": 1}
    species = [f'<species id="{name}" initialAmount="{start}" {kind}/>' for name, start in starts.items()]
    path = folder / "fast.xml"
    path.write_text(FAST.format(species="\n".join(species), law=law, number=number), encoding="utf-8")
    return path


@pytest.mark.parametrize(("number", "amounts"), [(1, False), (1, True), (2, False)])
def test_fast_reactions_are_in_equilibrium_from_the_start_on(number, amounts, tmp_path, trajectory):
    """A = 2 B, and S = number*A + B follows the loss, S' = -k B/V as amounts where symbols are concentrations."""
    t, found = trajectory(fast_file(tmp_path, number=number, amounts=amounts), tmp_path, 5.0)
    size = 1.0 if amounts else 2.0
    total = (4.0 * number + 5.0) * np.exp(-0.6 / size * t / (2 * number + 1))
    b = total / (2 * number + 1)
    close(found["B"], b / size)
    close(found["A"], 2 * b / size)
    close(found["C"], (1.0 + 4.0 * number + 5.0 - total) / size)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (PRODUCT, "the fast reaction `swap` is not linear in what fast reactions change"),
        (GROWING, "the fast reaction `swap` does not lead to an equilibrium at the start"),
        ("<ci>K</ci>", "the fast reaction `swap` is not linear in what fast reactions change"),
    ],
)
def test_fast_reactions_without_a_certain_equilibrium_are_refused(law, message, tmp_path, convert):
    done = convert(fast_file(tmp_path, law=law), tmp_path / "m.eq")
    assert done.status == 1 and message in done.error


def test_damaged_files_give_an_error_or_a_model(tmp_path, convert):
    random = np.random.default_rng(3)
    text = (SBML / "doses.xml").read_bytes()
    path = tmp_path / "m.xml"
    for _ in range(40):
        damaged = bytearray(text)
        for at in random.integers(60, len(text), 3):
            damaged[at] = random.choice(list(b'<>/"= a0'))
        path.write_bytes(bytes(damaged))
        result = convert(path, tmp_path / "m.eq")
        assert result.status in (0, 1)
        assert result.status == 0 or result.error.startswith("error")


def test_names_that_mean_something_here_are_changed_and_told(tmp_path, convert):
    text = (
        (SBML / "swap.xml")
        .read_text(encoding="utf-8")
        .replace('"x"', '"step"')
        .replace("<ci> x </ci>", "<ci> step </ci>")
    )
    path = tmp_path / "m.xml"
    path.write_text(text, encoding="utf-8")
    out = tmp_path / "m.eq"
    assert convert(path, out).status == 0
    written = out.read_text(encoding="utf-8")
    assert "step is step_" in written and "state step_ = 1" in written


def library():
    return pytest.importorskip("roadrunner", reason="libRoadRunner is not installed")


def against_roadrunner(trajectory, path, folder, end=9.7, count=23):
    roadrunner = library()
    roadrunner.Logger.setLevel(roadrunner.Logger.LOG_FATAL)
    peer = roadrunner.RoadRunner(str(path))
    peer.integrator.relative_tolerance = 1e-10
    peer.integrator.absolute_tolerance = 1e-14
    names = list(peer.model.getFloatingSpeciesIds())
    peer.timeCourseSelections = ["time", *(f"[{name}]" for name in names), *names]
    expected = np.array(peer.simulate(0.0, end, count + 1))[:, 1:]
    _, found = trajectory(path, folder, end, count)
    compared = 0
    for i, name in enumerate(names):
        if name in found:
            both = expected[:, i], expected[:, len(names) + i]
            assert min(np.abs(found[name] - e).max() / max(np.abs(e).max(), 1e-12) for e in both) < 1e-5
            compared += 1
    return compared


@pytest.mark.parametrize("path", sorted(SBML.glob("*.xml")), ids=lambda path: path.stem)
def test_libroadrunner_gives_the_same(path, tmp_path, trajectory):
    against_roadrunner(trajectory, path, tmp_path)


def test_libroadrunner_gives_the_same_for_the_models_that_come_with_it(tmp_path, trajectory, convert):
    folder = Path(library().__file__).parent
    compared = 0
    for path in sorted(folder.rglob("*.xml")):
        if b"<sbml" in path.read_bytes() and convert(path, tmp_path / "probe.eq").status == 0:
            compared += against_roadrunner(trajectory, path, tmp_path)
    assert compared > 10
