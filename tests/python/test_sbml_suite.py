"""The semantic cases of the public SBML test suite, if `SMPL_SBML_SUITE` names their folder (`semantic/`).

A case passes within the suite's own tolerances, or is refused by name; none may differ.
`pytest -s` shows the reasons of refusal by their number.
"""

import csv
import os
import re
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from smpl.commands.main import main

SUITE = os.environ.get("SMPL_SBML_SUITE")
pytestmark = pytest.mark.skipif(SUITE is None, reason="needs the cases of the SBML test suite (SMPL_SBML_SUITE)")


def settings(path):
    pairs = [line.split(":", 1) for line in path.read_text(encoding="utf-8").splitlines() if ":" in line]
    return {key.strip(): value.strip() for key, value in pairs}


def names_in(text):
    return [name.strip() for name in text.split(",") if name.strip()]


def species_of(path):
    """Compartment of each species, and whether its symbol is the amount."""
    elements = (e for e in ET.parse(path).getroot().iter() if e.tag.rsplit("}", 1)[-1] == "species")
    return {e.get("id"): (e.get("compartment"), e.get("hasOnlySubstanceUnits") in ("true", "1")) for e in elements}


def wanted(text, path, variables, given):
    """Statements that make the suite's variables outputs of the model: species as amounts or concentrations."""
    found = re.search(r"^# Other names than in the file: (.*)\.$", text, re.MULTILINE)
    names = dict(pair.split(" is ") for pair in found.group(1).split(", ")) if found else {}
    species = species_of(path)
    for number, variable in enumerate(variables):
        value = f"value({names.get(variable, variable)})"
        compartment, amount = species.get(variable, (None, None))
        size = f"value({names.get(compartment, compartment)})"
        if amount is False and variable in names_in(given["amount"]):
            value += f"*{size}"
        if amount is True and variable in names_in(given["concentration"]):
            value += f"/{size}"
        yield f"let suite_{number} : 1 = {value}"


def outcome(path, folder, capfd):
    """`passed`, or why a case was refused or differs."""
    model, table, case = folder / "m.eq", folder / "m.csv", path.parent
    given = settings(case / f"{case.name}-settings.txt")
    if main(["import", str(path), "-o", str(model)]) != 0:
        return "refused: " + capfd.readouterr().err.splitlines()[0].split(": ", 2)[-1]
    head, *rows = csv.reader((case / f"{case.name}-results.csv").read_text(encoding="utf-8").splitlines())
    expected = np.array([[float(x) for x in row] for row in rows if row])
    if not names_in(given["variables"]):
        return "passed"
    text = model.read_text(encoding="utf-8")
    extra = wanted(text, path, [name.strip() for name in head[1:]], given)
    model.write_text("\n".join([text, *extra, ""]), encoding="utf-8")
    step = float(given["duration"]) / int(given["steps"])
    lead = round(float(given["start"]) / step)
    count = lead + int(given["steps"])
    options = ["--set", f"step={step!r}", "--set", f"max_steps={count}", "--rtol", "1e-9", "--start", "nominal"]
    if main(["simulate", str(model), *options, "--out", str(table)]) != 0:
        return "differs: " + capfd.readouterr().err
    names, *rows = csv.reader(table.read_text(encoding="utf-8").splitlines())
    places = [names.index(f"suite_{number}") for number in range(len(head) - 1)]
    found = np.array([[float(row[place]) for place in places] for row in rows])[lead:]
    expected = expected[:, 1:]
    if found.shape != expected.shape:
        ending = capfd.readouterr().out.splitlines()[-1]
        return ("refused in the run: " if "failed: events" in ending else "differs: ends early: ") + ending.strip()
    bound = float(given["absolute"]) + float(given["relative"]) * np.abs(expected)
    same = np.isclose(found, expected, rtol=0, atol=bound, equal_nan=True)
    return "passed" if same.all() else f"differs at (row, column) {np.argwhere(~same)[0].tolist()}"


def test_no_case_of_the_suite_differs(tmp_path, capfd):
    counts, differ = Counter(), []
    for path in sorted(Path(SUITE).glob("*/*-sbml-*.xml")):
        result = outcome(path, tmp_path, capfd)
        counts[re.sub(r"`[^`]*`", "`..`", re.sub(r"line \d+: |: \d+ steps.*failed", "", result))] += 1
        if result.startswith("differs"):
            differ.append(f"{path.stem}: {result}")
        capfd.readouterr()
    with capfd.disabled():
        print(*(f"\n{number:5} {result[:100]}" for result, number in counts.most_common()))
    assert not differ
    assert counts["passed"] > 0
