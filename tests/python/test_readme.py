"""Everything in the README runs, and its links lead somewhere."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import smpl
from smpl.controllers import Nominal
from smpl.evaluation import evaluate
from smpl.registry import ENVIRONMENTS

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return [body for kind, body in re.findall(r"^```(\w*)\n(.*?)^```$", README, re.S | re.M) if kind == language]


def test_the_python_blocks_run_one_after_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("scipy", reason="scipy is not installed")
    (tmp_path / "tank.eq").write_text(next(body for body in blocks("") if "model Tank" in body))
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks("python"):
        exec(compile(block, "README.md", "exec"), names)
    left_alone = evaluate(smpl.Env("reactor"), Nominal(), episodes=5)
    assert sum(e.rewards.sum() for e in names["regulated"]) > sum(e.rewards.sum() for e in left_alone)
    assert names["venv"].num_envs == 64
    assert names["env"].unwrapped.model.name == "Tank"


def commands() -> list[str]:
    lines = [line.split("  #")[0].strip() for block in blocks("sh") for line in block.splitlines()]
    return [line for line in lines if line.startswith(("smpl ", "python "))]


def serves(arguments: list[str], folder: Path) -> None:
    """Starts a command that serves until it is stopped, reads its address, and stops it."""
    command = [sys.executable, *arguments, "--no-open", "--port", "0"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        address = server.stdout.readline()
        server.terminate()
    assert address.startswith("http://127.0.0.1:"), address


@pytest.mark.parametrize("line", commands())
def test_the_commands_run(line: str, tmp_path: Path) -> None:
    words = shlex.split(re.sub(r"--episodes \d+", "--episodes 4", line))
    if "smpl.collect" in words or "smpl.evaluate" in words:
        for module in ("pyarrow", "scipy", "matplotlib"):
            pytest.importorskip(module, reason=f"{module} is not installed")
    (tmp_path / "models").symlink_to(ROOT / "models")
    (tmp_path / "tank.eq").write_text(next(body for body in blocks("") if "model Tank" in body))
    arguments = words[1:] if words[0] == "python" else ["-m", "smpl", *words[1:]]
    if words[:2] == ["smpl", "live"]:
        serves(arguments, tmp_path)
        return
    result = subprocess.run([sys.executable, *arguments], cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def test_there_are_commands_and_the_two_of_the_setup() -> None:
    assert len(commands()) >= 6
    for script in re.findall(r"^(\.ci/\w+)", "\n".join(blocks("sh")), re.M):
        assert (ROOT / script).stat().st_mode & 0o111, script
    assert ".ci/demo" in README and ".ci/test" in README


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_the_table_tells_states_and_lines_of_each_environment(name: str) -> None:
    model = smpl.compile(ENVIRONMENTS[name])
    row = next(line for line in README.splitlines() if f"`smpl/{name}-v0`" in line and line.startswith("|"))
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    files = {path: int(lines) for lines, path in re.findall(r"\[(\d+)\]\(([^)]+)\)", cells[3])}
    assert int(cells[2]) == len(model.state_names)
    assert f"models/{ENVIRONMENTS[name]}.eq" in files
    texts = {path: (ROOT / path).read_text().partition("\n# ---- Tests")[0] for path in files}
    assert files == {path: len(text.splitlines()) for path, text in texts.items()}
    assert re.fullmatch(r"[\d,]+; [\d,]+", cells[4])


def test_no_link_leads_to_the_repository_of_another_program() -> None:
    """github.com/smpl-env holds the program of the paper whose processes these are, not this one."""
    files = [ROOT / name for name in ("README.md", "Cargo.toml", "pyproject.toml", "CITATION.cff", "mkdocs.yml")]
    for path in [*files, *(ROOT / "docs").rglob("*.md")]:
        assert "smpl-env/smpl" not in path.read_text(encoding="utf-8"), path
