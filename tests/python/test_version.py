"""One version: workspace, package, command, change log, citation, and the packages next to the library."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import smpl

ROOT = Path(__file__).resolve().parents[2]


def captured(path, pattern):
    found = re.search(pattern, (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE)
    assert found, f"{path} has no version"
    return found.group(1)


WORKSPACE = captured("Cargo.toml", r'^\[workspace\.package\]\nversion = "([^"]+)"')


def test_the_package_and_the_command_have_the_version_of_the_workspace():
    command = [sys.executable, "-c", "import sys; from smpl.commands.main import main; sys.exit(main())", "--version"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert smpl.__version__ == WORKSPACE
    assert shown == f"smpl {WORKSPACE}\n"


def test_no_crate_and_no_python_package_states_another_version():
    for path in (*ROOT.glob("*/Cargo.toml"), *ROOT.glob("compiler/*/Cargo.toml"), *ROOT.glob("runtime/*/Cargo.toml")):
        assert "version.workspace = true\n" in path.read_text(encoding="utf-8"), path
    assert '\ndynamic = ["version"]\n' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    locked = re.findall(r'name = "smpl-[^"]+"\nversion = "([^"]+)"', (ROOT / "Cargo.lock").read_text(encoding="utf-8"))
    assert set(locked) == {WORKSPACE}


@pytest.mark.parametrize(
    ("path", "pattern"),
    [
        ("CITATION.cff", r"^version: (\S+)$"),
        ("python/benchmarks/pyproject.toml", r'^version = "([^"]+)"$'),
        ("docs/limits.md", r"^- Version (\S+): "),
    ],
)
def test_texts_have_the_version_of_the_workspace(path, pattern):
    assert captured(path, pattern) == WORKSPACE


def test_the_newest_section_of_the_change_log_is_the_version():
    assert captured("CHANGELOG.md", r"^## \[(\d[^\]]*)\] - \d{4}-\d{2}-\d{2}$") == WORKSPACE


@pytest.mark.parametrize("path", ["docs/editors/vscode/package.json", "runtime/tools/live/package.json"])
def test_packages_of_javascript_have_the_version_of_the_workspace(path):
    assert json.loads((ROOT / path).read_text(encoding="utf-8"))["version"] == WORKSPACE
