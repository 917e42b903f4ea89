"""The environments of the paper's time: made by name, refused where they cannot be."""

import subprocess
import sys
import venv
from pathlib import Path

import pytest

import smpl
from smpl.learning import Task
from smpl.learning.formulation import Formulation
from smpl_benchmarks.historical.__main__ import ENVIRONMENTS, link, main
from smpl_benchmarks.historical.trainer import ONLINE, online_trainer


def test_an_environment_needs_its_python(tmp_path, capsys):
    wrong = [
        name
        for name, (version, _, _) in ENVIRONMENTS.items()
        if version != f"{sys.version_info[0]}.{sys.version_info[1]}"
    ]
    for name in wrong:
        assert main([name, str(tmp_path / name), "--python", sys.executable]) == 1
        assert f"needs Python {ENVIRONMENTS[name][0]}" in capsys.readouterr().err
        assert main([name, str(tmp_path / name), "--python", str(tmp_path / "python")]) == 1
        assert "is not there): give --python PATH" in capsys.readouterr().err
        assert not (tmp_path / name).exists()


def test_an_environment_has_this_smpl_and_nothing_else_of_here(tmp_path):
    venv.create(tmp_path / "env")
    inside = tmp_path / "env" / "bin" / "python"
    for _ in range(2):
        link(inside)
    code = "from importlib.util import find_spec; print(find_spec('smpl').origin, find_spec('gymnasium'))"
    told = subprocess.run([inside, "-c", code], check=True, capture_output=True, text=True, cwd=tmp_path).stdout
    file, other = told.split()
    assert Path(file).samefile(smpl.__file__) and other == "None"


@pytest.mark.parametrize("algorithm", ONLINE)
def test_an_algorithm_without_its_environment_says_how_to_make_it(algorithm, monkeypatch, tmp_path):
    monkeypatch.setenv("SMPL_ONLINE_2022", str(tmp_path))
    with pytest.raises(ImportError, match=r"python -m smpl.benchmark historical online DIR, then SMPL_ONLINE_2022=DIR"):
        online_trainer(algorithm, Task.of("reactor"), Formulation(), {})


def test_what_fails_there_is_told_here(monkeypatch, tmp_path):
    folder = tmp_path / "env" / "bin"
    folder.mkdir(parents=True)
    script = folder / "python"
    script.write_text("#!/bin/sh\necho out of memory >&2\nexit 3\n")
    script.chmod(0o755)
    monkeypatch.setenv("SMPL_ONLINE_2022", str(tmp_path / "env"))
    trainer = online_trainer("PG-2022", Task.of("reactor"), Formulation(), {})
    trainer.begin(0)
    trainer.train(5, 1, 0.0)
    with pytest.raises(RuntimeError, match="failed: out of memory"):
        trainer.save(tmp_path)
