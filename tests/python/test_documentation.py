"""README and tutorial show the actual results."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import smpl

ROOT = Path(__file__).resolve().parents[2]


def blocks(page: str, language: str) -> list[str]:
    """Fenced blocks of a page in a language (none: models and pieces of them)."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return [body for kind, body in re.findall(r"^```(\w*)\n(.*?)^```$", text, re.S | re.M) if kind == language]


def piece(page: str, mark: str) -> str:
    """The model text of a page that holds `mark`."""
    return next(body for body in blocks(page, "") if mark in body)


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "smpl", *arguments], cwd=folder, capture_output=True, text=True)


@pytest.fixture
def tutorial() -> str:
    page = "docs/tutorial.md"
    return piece(page, "model Fermenter") + piece(page, "steady { F = 0.5 }\n") + piece(page, "productivity")


@pytest.mark.parametrize(
    ("page", "model", "right", "wrong"),
    [
        ("README.md", "tank", "(q - k*sqrt(h)) / A", "q - k*sqrt(h)"),
        ("docs/tutorial.md", "fermenter", "F/V*(S_f - S)", "F*(S_f - S)"),
    ],
)
def test_the_unit_error_is_the_one_shown(page: str, model: str, right: str, wrong: str, tmp_path: Path) -> None:
    text = piece(page, f"model {model.capitalize()}")
    assert right in text
    (tmp_path / f"{model}.eq").write_text(text.replace(right, wrong))
    result = run(tmp_path, "check", f"{model}.eq")
    assert result.returncode == 1
    assert result.stderr in blocks(page, "text")


def test_the_models_of_the_readme_and_of_the_tutorial_run(tutorial: str) -> None:
    for source in (piece("README.md", "model Tank"), tutorial):
        env = smpl.Env(smpl.compile(source=source))
        env.reset(seed=0)
        _, _, terminated, _, info = env.step(env.action_space.sample())
        assert not terminated, info["failure"]


def test_the_steady_state_of_the_tutorial_is_the_one_shown(tmp_path: Path) -> None:
    (tmp_path / "fermenter.eq").write_text(piece("docs/tutorial.md", "model Fermenter"))
    result = run(tmp_path, "steady", "fermenter.eq", "--action", "F=0.5")
    assert result.stdout in blocks("docs/tutorial.md", "text"), result.stdout


def test_memory_noise_and_variants_of_the_tutorial_compile(tutorial: str) -> None:
    page = "docs/tutorial.md"
    memory = piece(page, "F_held")
    assay = re.search(r"`(observe assay.*?)`", (ROOT / page).read_text(encoding="utf-8"))
    assert assay is not None
    source = tutorial.replace("F/V", "F_held/V") + memory + assay[1] + "\n" + piece(page, "variant contois")
    assert smpl.compile(source=source).discrete_names == ("F_held",)
    assert smpl.compile(source=source, variants=("contois",)).observation_names[-1] == "assay"


def test_the_domain_of_the_tutorial_compiles() -> None:
    head = 'model Tube "tube"\ntime t : h\nparam S_f : g/L = 20\naction F : L/h = 0 in 0..1\n'
    tail = "observe c\nreward nothing default = 0\nepisode { step = 0.5 [h], max_steps = 3, error_reward = 0 }\n"
    model = smpl.compile(source=head + piece("docs/tutorial.md", "domain z") + tail)
    assert model.state_names[:2] == ("c[1]", "c[2]")


def test_the_first_example_of_the_language_reference_compiles() -> None:
    assert smpl.compile(source=piece("docs/language.md", "model Tank")).state_names == ("h",)


def test_the_index_of_the_language_reference_has_every_keyword() -> None:
    """The lists of `dsl/src/words.rs`, whose first column has the statements."""
    source = (ROOT / "dsl/src/words.rs").read_text(encoding="utf-8").partition("#[cfg(test)]")[0]
    statements = re.findall(r'^    \("(\w+)", (?:Some|None)', source, re.M)
    lists = re.findall(r"const (?:RESERVED|CLAUSES|INSIDE|IN_TESTS): &\[&str\] = &\[(.*?)\];", source, re.S)
    words = {*statements, *re.findall(r'"(\w+)"', "".join(lists))}
    page = (ROOT / "docs/language.md").read_text(encoding="utf-8")
    index = page.partition("## Keywords")[2].partition("## Text")[0]
    assert len(statements) > 40 and len(lists) >= 3
    assert words - {word for cell in re.findall(r"`([^`]+)`", index) for word in cell.split("/")} == set()


PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_between_pages_lead_somewhere(page: Path) -> None:
    prose = re.sub(r"^```.*?^```$|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    links = re.findall(r"\]\((?!https?:)([^)#]+)", prose)
    assert [link for link in links if not (page.parent / link).exists()] == []


def test_the_commands_and_the_script_of_the_page_on_learning_run(tmp_path: Path) -> None:
    for module in ("pyarrow", "scipy", "h5py"):
        pytest.importorskip(module, reason=f"{module} is not installed")
    written = "".join(blocks("docs/learning.md", "sh")).splitlines()
    # A cluster and the packages of the learners are not there; `test_cluster.py` and `test_learned.py` have theirs.
    # `test_benchmark_release.py` runs the releases.
    lines = [
        line for line in written if not re.search(r"ray |--suite (all|online)|benchmark (tune|release)|--policy", line)
    ]
    assert len(lines) == 5
    for line in lines:
        _, *arguments = re.sub(r"--episodes \d+", "--episodes 8", line).split()
        result = subprocess.run([sys.executable, *arguments], cwd=tmp_path, capture_output=True, text=True)
        assert result.returncode == 0, (line, result.stderr)
    script = blocks("docs/learning.md", "python")[0]
    subprocess.run([sys.executable, "-c", script], cwd=tmp_path, check=True)
    assert (tmp_path / "data/pid.hdf5").is_file() and (tmp_path / "report/report.html").is_file()


def test_the_model_of_ones_own_of_the_page_on_learning_is_learned(tmp_path: Path) -> None:
    for module in ("pyarrow", "d3rlpy", "stable_baselines3"):
        pytest.importorskip(module, reason=f"{module} is not installed")
    page = (ROOT / "docs/learning.md").read_text(encoding="utf-8")
    (tmp_path / "tank.eq").write_text(piece("README.md", "model Tank"))
    script = next(body for body in blocks("docs/learning.md", "python") if "import d3rlpy" in body)
    for long, short in (
        ("100, ", "6, "),
        ("n_steps=2000", "n_steps=20"),
        ("n_steps_per_epoch=1000", "n_steps_per_epoch=10"),
    ):
        script = script.replace(long, short)
    (tmp_path / "script.py").write_text(script.replace("50_000", "10").replace("num_envs=32", "num_envs=4"))
    subprocess.run([sys.executable, "script.py"], cwd=tmp_path, check=True)
    (line,) = [line for line in page.splitlines() if line.startswith("python -m smpl.evaluate tank.eq")]
    _, *arguments = line.replace("100", "4").split()
    done = subprocess.run([sys.executable, *arguments], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert all(name in done.stdout for name in ("nominal", "cloned", "tried"))


def test_the_formulations_of_the_page_on_learning_train(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
    script = blocks("docs/learning.md", "python")[1].replace("200_000", "10").replace('reactor", 64', 'reactor", 2')
    script = script.replace("SB3VecEnv(batch))", "SB3VecEnv(batch), n_steps=8, batch_size=16)")
    subprocess.run([sys.executable, "-c", script], cwd=tmp_path, check=True)
