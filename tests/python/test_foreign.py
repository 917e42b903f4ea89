"""The distribution `smpl` of the package index, another project, in the folder of this package."""

import subprocess
import sys
from pathlib import Path

import pytest

import smpl
from smpl.support.foreign import check


def test_the_package_alone_is_accepted():
    check()


@pytest.mark.parametrize("call", ["import smpl", "from smpl.commands.main import main; main(['--version'])"])
def test_files_of_the_other_project_are_refused_with_the_way_out(tmp_path, call):
    """Another project's `__init__` may have replaced ours: the command then says it."""
    folder = tmp_path / "smpl"
    folder.mkdir()
    for file in Path(smpl.__file__).parent.iterdir():
        (folder / file.name).symlink_to(file)
    (folder / "plot2d.py").touch()
    if "commands" in call:
        (folder / "__init__.py").unlink()
        (folder / "__init__.py").touch()
    run = [sys.executable, "-S", "-c", f"import sys; sys.path[:0] = {[str(tmp_path), *sys.path]!r}; {call}"]
    result = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 1
    last = result.stderr.strip().splitlines()[-1]
    assert "ImportError" in last and str(folder) in last and "pip uninstall smpl smpl-process" in last


def test_the_command_names_the_distribution():
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    assert 'name = "smpl-process"' in text
    assert "smpl[" not in text.replace("smpl-process[", "")
