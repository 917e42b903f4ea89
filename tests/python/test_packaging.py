"""What a source distribution carries."""

import re
import shutil
import subprocess
import tarfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """Names in a source distribution without its leading folder."""
    if shutil.which("maturin") is None or not (ROOT / "Cargo.lock").is_file():
        pytest.skip("maturin, or a checkout, is missing")
    folder = tmp_path_factory.mktemp("sdist")
    subprocess.run(["maturin", "sdist", "--out", folder], cwd=ROOT, check=True, capture_output=True)
    (path,) = folder.glob("smpl-*.tar.gz")
    with tarfile.open(path) as opened:
        return {name.partition("/")[2] for name in opened.getnames()}


def test_the_source_distribution_has_all_models_and_modules(archive):
    wanted = [*ROOT.glob("models/**/*.eq"), *ROOT.glob("models/**/*.yaml"), *ROOT.glob("python/smpl/**/*.py")]
    wanted += [*ROOT.glob("python/smpl/bench/*.c"), *ROOT.glob("python/smpl/bench/*.eq")]
    assert len(wanted) > 50
    assert {str(path.relative_to(ROOT)) for path in wanted} <= archive
    assert {"python/smpl/py.typed", "python/smpl/_native.pyi"} <= archive


def test_the_source_distribution_builds_without_the_checkout(archive):
    members = re.findall(r'"([a-z]+)"', re.search(r"members = \[(.*?)\]", (ROOT / "Cargo.toml").read_text())[1])
    for crate in members:
        sources = [*ROOT.glob(f"{crate}/src/**/*"), ROOT / crate / "Cargo.toml", *ROOT.glob(f"{crate}/build.rs")]
        assert {str(path.relative_to(ROOT)) for path in sources if path.is_file()} <= archive, crate
        # Cargo refuses a manifest that names a benchmark whose file is missing.
        for bench in re.findall(r'\[\[bench\]\]\nname = "(\w+)"', (ROOT / crate / "Cargo.toml").read_text()):
            assert f"{crate}/benches/{bench}.rs" in archive
    assert {"Cargo.toml", "Cargo.lock", "pyproject.toml", "README.md"} <= archive


def test_licences_travel_with_the_source(archive):
    assert {"LICENSE-MIT", "LICENSE-APACHE", "THIRD_PARTY.md", "CITATION.cff", "CHANGELOG.md"} <= archive
