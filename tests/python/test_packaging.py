"""Contents of a source distribution and of a wheel."""

import re
import shutil
import subprocess
import tarfile
import zipfile
from pathlib import Path

import pytest

tomllib = pytest.importorskip("tomllib", reason="Python 3.11 has tomllib")

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """Names in a source distribution without its leading folder."""
    if shutil.which("maturin") is None or not (ROOT / "Cargo.lock").is_file():
        pytest.skip("maturin, or a checkout, is missing")
    folder = tmp_path_factory.mktemp("sdist")
    subprocess.run(["maturin", "sdist", "--out", folder], cwd=ROOT, check=True, capture_output=True)
    (path,) = folder.glob("smpl_process-*.tar.gz")
    with tarfile.open(path) as opened:
        return {name.partition("/")[2] for name in opened.getnames()}


def test_the_source_distribution_has_all_models_and_modules(archive):
    wanted = [*ROOT.glob("models/**/*.eq"), *ROOT.glob("models/**/*.yaml"), *ROOT.glob("python/smpl/**/*.py")]
    assert len(wanted) > 50
    assert {str(path.relative_to(ROOT)) for path in wanted} <= archive
    assert {"python/smpl/py.typed", "python/smpl/_native.pyi"} <= archive


def read_by_commands():
    """Files of the package that are not modules: data of its commands."""
    every = (path for path in ROOT.glob("python/smpl/**/*") if path.is_file())
    return {path for path in every if path.suffix not in (".py", ".so", ".pyc") and "models" not in path.parts}


def test_the_source_distribution_has_all_that_commands_read(archive):
    names = {str(path.relative_to(ROOT)) for path in read_by_commands()}
    assert names <= archive


def test_a_wheel_has_all_that_commands_read():
    built = sorted(ROOT.glob("target/wheels/smpl_process-*.whl"))
    if not built:
        pytest.skip("no wheel is built: .ci/wheel")
    with zipfile.ZipFile(built[-1]) as opened:
        names = set(opened.namelist())
    assert {str(path.relative_to(ROOT / "python")) for path in read_by_commands()} <= names
    assert {f"smpl/{path.relative_to(ROOT)}" for path in ROOT.glob("models/**/*.eq")} <= names


def test_the_source_distribution_builds_without_the_checkout(archive):
    members = re.findall(r'"([a-z]+)"', re.search(r"members = \[(.*?)\]", (ROOT / "Cargo.toml").read_text())[1])
    for crate in members:
        sources = [*ROOT.glob(f"{crate}/src/**/*"), ROOT / crate / "Cargo.toml", *ROOT.glob(f"{crate}/build.rs")]
        assert {str(path.relative_to(ROOT)) for path in sources if path.is_file()} <= archive, crate
        # Cargo refuses a manifest that names a benchmark whose file is missing.
        for bench in re.findall(r'\[\[bench\]\]\nname = "(\w+)"', (ROOT / crate / "Cargo.toml").read_text()):
            assert f"{crate}/benches/{bench}.rs" in archive
    assert {"Cargo.toml", "Cargo.lock", "pyproject.toml", project()["readme"]} <= archive
    bindings = [path for path in ROOT.glob("runtime/bindgen/**/*") if path.is_file()]
    assert bindings and {str(path.relative_to(ROOT)) for path in bindings} <= archive


def test_licences_travel_with_the_source(archive):
    assert {"LICENSE-MIT", "LICENSE-APACHE", "THIRD_PARTY.md", "CITATION.cff", "CHANGELOG.md"} <= archive
    assert {f"licenses/{name}.txt" for name in ("SUNDIALS", "SuiteSparse", "LGPL-2.1")} <= archive


def project():
    """The table `project` of `pyproject.toml`."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_a_wheel_has_the_licence_texts_of_the_libraries_that_it_carries():
    texts = "".join(path.read_text() for pattern in project()["license-files"] for path in ROOT.glob(pattern))
    for phrase in (
        "Lawrence Livermore National Security",  # SUNDIALS
        "GNU LESSER GENERAL PUBLIC LICENSE",  # KLU and BTF
        "KLU (by Timothy A. Davis",
        "Patrick R. Amestoy",  # AMD
        "COLAMD: Copyright",
    ):
        assert phrase in texts, phrase


def links(file):
    """Targets of the links of a page."""
    return re.findall(r"\]\(([^)]+)\)", re.sub(r"```.*?```", "", file.read_text(), flags=re.S))


def test_links_of_the_readme_lead_to_files_of_this_repository():
    assert len(links(ROOT / "README.md")) > 5
    for link in links(ROOT / "README.md"):
        assert link.startswith(("https://gymnasium.farama.org", "https://arxiv.org")) or (ROOT / link).exists(), link


def test_what_a_package_index_shows_links_to_no_file_of_the_repository():
    shown = ROOT / project()["readme"]
    assert [link for link in links(shown) if not link.startswith("https://")] == []
    assert "smpl/Reactor-v0" in shown.read_text()


def test_every_extra_is_of_use():
    """Something in the package or its benchmark imports each optional package, by its name there."""
    sources = "".join(path.read_text() for path in ROOT.glob("python/**/*.py"))
    # Minari stores data sets with h5py.
    imported = {"stable-baselines3": "stable_baselines3", "h5py": "minari", "scikit-learn": "sklearn", "pyyaml": "yaml"}
    # Loaded by name, with a message where it is missing.
    imported["sb3-contrib"] = "sb3_contrib"
    for extra, requirements in project()["optional-dependencies"].items():
        for name in (re.match(r"[\w-]+", requirement)[0] for requirement in requirements):
            if extra not in ("dev", "docs", "fmu"):
                assert re.search(rf"(?:(?:from|import) |\"){imported.get(name, name)}\b", sources), (extra, name)
