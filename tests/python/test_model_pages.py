"""`smpl doc`: the page of a model has all of its names."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import smpl
from smpl.registry import ENVIRONMENTS, GALLERY
from smpl.support.files import model_path

ROOT = Path(__file__).resolve().parents[2]
MODELS = sorted((ENVIRONMENTS | GALLERY).values())
# Keywords with a name behind them.
KINDS = "|".join(
    (
        *("param", "action", "state", "var", "let", "discrete", "disturbance", "random", "set", "table", "event"),
        *("phase", "reward", "fail", "success", "constraint", "invariant", "level", "policy", "variant", "choice"),
        *("connector", "component", "domain", "flux", "def"),
    )
)


def texts(model: str) -> str:
    """A model with what it imports."""
    text = model_path(model).read_text(encoding="utf-8")
    return text + "".join((ROOT / "models" / path).read_text() for path in re.findall(r'^\s*use "(.*?)"', text, re.M))


def page(model: str) -> str:
    folder = "gallery" if model in GALLERY.values() else "models"
    return (ROOT / f"docs/{folder}/{model}.md").read_text(encoding="utf-8")


def quoted(name: str, text: str) -> bool:
    """True if a page has a name as a word of a program, or as the function of an equation."""
    code = re.search(rf"`(?:episode |solver )?{re.escape(name)}(?:\[[^`]*)?(?: = [^`]*)?`", text)
    return bool(code) or typeset(name) in text


def typeset(name: str) -> str:
    """A function of a name, as LaTeX."""
    head, *rest = name.split("_")
    if not rest:
        return rf"\operatorname{{{name}}}\left(" if len(name) > 1 else rf"{name}\left("
    head = head if len(head) == 1 else rf"\mathrm{{{head}}}"
    return head + "_{" + ",".join(rf"\mathrm{{{part}}}" for part in rest) + r"}\left("


@pytest.mark.parametrize("model", MODELS)
def test_every_name_that_the_text_declares_stands_on_the_page(model):
    text, shown = texts(model), page(model)
    code = re.sub(r'"[^"]*"|#.*', "", text)
    declared = re.findall(rf"(?:^|[{{;])\s*(?:{KINDS})\s+(?!over\b)([A-Za-z_]\w*)", code, re.M)
    declared += re.findall(r"\buse\s+\w+\s+as\s+(\w+)", code)
    # Further names of a declaration, and columns of a table.
    declared += re.findall(r"^\s*(?:param|let)\b[^\n]*?,\s+([A-Za-z_]\w*)\s*(?::[^=\n]*)?=", code, re.M)
    for columns in re.findall(r"columns:\s*(.*)", code):
        declared += re.findall(r"(\w+)\s*\[", columns)
    assert len(set(declared)) > 5
    inside = set(re.findall(r"^\s+def\s+(\w+)", code, re.M))
    assert [name for name in sorted(set(declared) - inside) if not quoted(name, shown)] == []


@pytest.mark.parametrize("model", MODELS)
def test_every_name_of_the_compiled_model_stands_on_the_page(model):
    shown = page(model)
    names = smpl.compile(model)
    env = smpl.Env(names)
    known = [
        *names.state_names,
        *names.action_names,
        *names.discrete_names,
        *names.parameter_names,
    ]
    # Members are listed with their ports.
    members = {number for port in names.ports.values() for numbers in port.members.values() for number in numbers}
    known += [name for name in names.algebraic_names if name not in members]
    known += [*names.ports]
    known += [*env.reward_names, *env.constraint_names, *names.policies]
    plain = {re.sub(r"\[[^\]]*\]$", "", name) for name in known}
    classes = {f"n{i}" for i in range(2, 9)} if model == "pensim" else set()  # `n1` .. `n9`
    assert [name for name in sorted(plain - classes) if not quoted(name, shown)] == []


@pytest.mark.parametrize("model", MODELS)
def test_settings_steady_values_and_starts_stand_on_the_page(model):
    shown, code = page(model), re.sub(r'"[^"]*"|#.*', "", texts(model))
    for block, entries in re.findall(r"^(episode|solver)\s*\{([^}]*)\}", code, re.M):
        for name in re.findall(r"(\w+)\s*=", entries):
            assert f"`{block} {name}`" in shown
    assert ("Steady state:" in shown) == bool(re.search(r"^\s*steady\s*\{", code, re.M))
    assert shown.count(r"\big|_{t=0}") == len(re.findall(r"^\s*(?:when .*\{ )?initial\s", code, re.M))


@pytest.mark.parametrize("model", MODELS)
def test_equations_of_a_page_are_those_of_the_text(model):
    text, shown = texts(model), page(model)
    code = re.sub(r"#.*", "", text)
    rates = re.findall(r"eq\s+d/dt\s", code)
    assert shown.count(r"{\mathrm{d} t} = ") >= len(rates)


EVERYTHING = """
model Everything "all kinds of statement"

# Somebody, somewhere.

time t : h

set kinds = { a, b }
table w[kinds] : kg = { a: 1, b: 2 }
table feed over time : h until { 1: 0.5, 3: 1 }
choice law = linear | square
random z ~ normal(0, 1)
param k : 1/h = 0.5 ~ 0.5 + 0.01*z clip 0.1..1 in 0..2 "rate"
action u : kg/h = 0.1 in 0..1 "feed"
disturbance d = 0 ~ 0.9*d + normal(0, 0.1)
state m[kinds] : kg = 1 in 0..10 "mass"
discrete count = 0 "events so far"
let total : kg = sum(m[i] for i in kinds) "all of it"

# ---- Balances ----

eq d/dt m[i] = u/2 - k*m[i]    for i in kinds
when law = square { eq d/dt m[i] = u/2 - k*m[i]*abs(m[i])/1 [kg]    for i in kinds }

event low when total <= 0.5 [kg]
at low { next count = count + 1 ; reset m[i] = m[i] + w[i] for i in kinds }
phase rest for 2 [h] then work
phase work until total >= 3 [kg] then rest { next count = 0 }

initial m[i] ~ uniform(0.5, 1.5) clip bounds    for i in kinds
observe total in 0..20 noise normal(0, 0.1) every 2 delay 1
level online "one number" { observe total in 0..20 }
reward kept : kg default = total "what is there"
fail full event total >= 19 [kg] "too much"
success done when count > 5
constraint much when total > 10 [kg]
policy recipe "as written" { u = feed(t) }
episode { step = 1 [h], max_steps = 10, error_reward = -5 }
solver { rtol = 1e-7 }
variant slow "half the rate" { param k : 1/h = 0.25 }
"""


def doc(folder: Path, text: str, *arguments: str) -> str:
    (folder / "everything.eq").write_text(text)
    command = [sys.executable, "-m", "smpl", "doc", "everything.eq", *arguments]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.mark.parametrize(
    "line",
    [
        "Somebody, somewhere.",
        "## Balances",
        "| `k` | $k$ | 1/h | 0.5 | $0.5 + 0.01 \\, z$, kept within 0.1 to 1 | 0 to 2 | rate |",
        "| `feed` | kg/h | until (h) 1: 0.5, 3: 1 |",
        "`total`: all of it (kg)",
        r"\frac{\mathrm{d} m_{i}}{\mathrm{d} t} = \frac{u}{2} - k \, m_{i}, \quad i \in \mathrm{kinds}",
        "Event `low`",
        r"\mathrm{total} \le 0.5\,\mathrm{kg}",
        "At the event `low`:",
        r"\mathrm{count} \leftarrow \mathrm{count} + 1",
        r"m_{i} \leftarrow m_{i} + w_{i}, \quad i \in \mathrm{kinds}",
        "| `rest` | 2 h | `work` |",
        r"until $\mathrm{total} \ge 3\,\mathrm{kg}$ | `rest` | $\mathrm{count} \leftarrow 0$ |",
        "Level of observation `online`: one number",
        "Reward `kept`: the default; what is there (kg)",
        "Failure `full`: too much; ends the step at that instant",
        "Success `done`",
        "Constraint, violated where `much`",
        "Policy `recipe`: as written",
        "| `episode error_reward` | -5 |",
        "| `solver rtol` | 1e-7 |",
        "### Variant `slow`",
        "### `law = square`",
        r"\left\lvert m_{i}\right\rvert",
    ],
)
def test_every_kind_of_statement_is_written_down(line, tmp_path_factory, request):
    cached = getattr(request.config, "_everything", None)
    if cached is None:
        text = EVERYTHING.replace("table feed over time : h", "table feed : kg/h over time : h")
        cached = request.config._everything = doc(tmp_path_factory.mktemp("doc"), text)
    assert line in cached, cached


def test_an_option_that_is_chosen_is_part_of_the_model(tmp_path):
    text = EVERYTHING.replace("table feed over time : h", "table feed : kg/h over time : h")
    chosen = doc(tmp_path, text, "--variant", "law=square")
    assert "### `law = square`" not in chosen and r"\lvert" in chosen


def test_pictures_are_drawn_beside_the_page(tmp_path):
    (tmp_path / "models").symlink_to(ROOT / "models")
    command = [sys.executable, "-m", "smpl", "doc", "models/atropine.eq", "-o", "book/atropine.md", "--pictures", "art"]
    (tmp_path / "book").mkdir()
    assert subprocess.run(command, cwd=tmp_path, capture_output=True, text=True).returncode == 0
    text = (tmp_path / "book/atropine.md").read_text()
    links = re.findall(r"!\[.*?\]\((.*?)\)", text)
    assert links == ["../art/atropine-flowsheet.svg", "../art/atropine-run.svg"]
    flowsheet = (tmp_path / "art/atropine-flowsheet.svg").read_text()
    places = [
        re.search(rf'<text x="([\d.]+)"[^>]*>{unit}<', flowsheet)
        for unit in ("M1", "R1", "M2", "R2", "M3", "R3", "SEP")
    ]
    across = [float(place[1]) for place in places]
    assert across == sorted(across) and len(set(across)) == 7
