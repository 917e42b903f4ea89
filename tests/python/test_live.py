"""The live page from Python, and notebook cells that hold a model."""

import socket
import urllib.error
import urllib.request
from pathlib import Path

import pytest

import smpl

DECAY = """model Decay "a decay"
time t : s
param k : 1/s = 0.5
state x : m = 2
eq d/dt x = -k*x
observe x in 0..10
episode { step = 1 [s], max_steps = 8 }
"""


@pytest.fixture
def page_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a page instead of the bundled one, and no files of the user."""
    dist = tmp_path / "dist"
    dist.mkdir()
    (dist / "index.html").write_text("<!doctype html>live", encoding="utf-8")
    monkeypatch.setenv("SMPL_LIVE_DIST", str(dist))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    models = tmp_path / "models"
    models.mkdir()
    return models


def test_a_file_is_served_until_its_page_is_closed(page_folder: Path) -> None:
    file = page_folder / "decay.eq"
    file.write_text(DECAY, encoding="utf-8")
    with smpl.live(file, browser=False) as page:
        assert page.url.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(page.url, timeout=10) as answer:
            assert answer.read() == b"<!doctype html>live"
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(page.url.rsplit("/", 2)[0], timeout=10)
        assert refused.value.code == 404
        assert page.url in page._repr_html_()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(page.url, timeout=10)
    page.close()
    assert "ended" in repr(page)


def test_a_model_is_served_with_its_file_or_with_one_of_its_own(page_folder: Path) -> None:
    (page_folder / "decay.eq").write_text(DECAY, encoding="utf-8")
    for model in (smpl.compile(page_folder / "decay.eq"), smpl.compile(source=DECAY)):
        with model.live(browser=False) as page, urllib.request.urlopen(page.url, timeout=10) as answer:
            assert answer.status == 200


def test_what_cannot_be_served_is_an_error_with_its_reason(page_folder: Path) -> None:
    with pytest.raises(OSError, match="no such file"):
        smpl.live(page_folder / "none.eq", browser=False)
    with pytest.raises(OSError, match="no models"):
        smpl.live(page_folder, browser=False)
    (page_folder / "decay.eq").write_text(DECAY, encoding="utf-8")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(OSError, match="in use"):
            smpl.live(page_folder, port=taken.getsockname()[1], browser=False)


def shell():  # type: ignore[no-untyped-def]
    """A shell with the extension."""
    pytest.importorskip("IPython")
    from IPython.core.interactiveshell import InteractiveShell
    from IPython.utils.capture import capture_output

    found = InteractiveShell.instance()
    found.run_line_magic("load_ext", "smpl")

    def run(line: str, text: str) -> str:
        with capture_output() as captured:
            found.run_cell_magic("smpl", line, text)
        return "".join(str(value) for output in captured.outputs for value in output.data.values())

    return found, run


def test_a_cell_binds_its_model_and_shows_equations_and_picture() -> None:
    found, run = shell()
    shown = run("decay", DECAY)
    assert isinstance(found.user_ns["decay"], smpl.Model) and found.user_ns["decay"].name == "Decay"
    assert "Decay: a decay" in shown and "<svg" in shown
    assert "\\frac" in shown or "\\dot" in shown or "\\mathrm{d}" in shown, shown[:500]


def test_a_faulty_cell_shows_its_place_and_binds_nothing() -> None:
    found, run = shell()
    found.user_ns.pop("wrong", None)
    shown = run("wrong", DECAY.replace("-k*x", "-k*<b>*x").replace("-k*<b>*x", "-kk*x"))
    assert "wrong" not in found.user_ns
    assert "underline" in shown and ">kk</span>" in shown and "help: " in shown
    assert "   5 " in shown
    hostile = run("wrong", DECAY.replace('"a decay"', '"<script>1</script>" x'))
    assert "<script>" not in hostile and "&lt;script&gt;" in hostile


def test_a_cell_needs_a_name() -> None:
    pytest.importorskip("IPython")
    from smpl.notebooks.magic import cell

    with pytest.raises(ValueError, match="expected the name of a variable"):
        cell("not a name", DECAY, None)
