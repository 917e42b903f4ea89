"""Messages where an optional package is missing."""

import re
import sys
from pathlib import Path

import pytest

import smpl
from smpl.support.optional import install, load

PACKAGE = Path(smpl.__file__).parent


@pytest.mark.parametrize(
    ("module", "says"),
    [
        ("scipy.optimize", "this needs SciPy: pip install scipy"),
        ("sklearn.gaussian_process", "this needs scikit-learn: pip install scikit-learn"),
        ("yaml", "this needs PyYAML: pip install pyyaml"),
        ("ray", "this needs Ray: pip install ray"),
        ("ray.rllib", "this needs RLlib: pip install 'ray[rllib]' torch"),
        ("not_there_at_all", "this needs not_there_at_all: pip install not_there_at_all"),
    ],
)
def test_a_missing_package_is_named_with_its_command(module, says, monkeypatch):
    monkeypatch.setitem(sys.modules, module.partition(".")[0], None)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError) as found:
        load(module, "this")
    assert str(found.value) == says


def test_a_package_that_cannot_be_imported_is_not_said_to_be_missing(tmp_path, monkeypatch):
    (tmp_path / "broken_one.py").write_text("import not_there_either")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ImportError, match=r"this needs broken_one, which cannot be imported: .*not_there_either"):
        load("broken_one", "this")


def test_no_message_installs_a_distribution_called_smpl():
    """`smpl` on the package index is another project."""
    texts = {file: file.read_text(encoding="utf-8") for file in PACKAGE.rglob("*.py")}
    assert not [file for file, text in texts.items() if re.search(r"pip install \S*smpl(?!-process)\b", text)]
    assert install("casadi") == "pip install casadi"
