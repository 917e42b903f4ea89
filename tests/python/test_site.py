"""The book as a site: all pages are in it, and a browser shows them without fault.

`.ci/site` builds `site/`; the tests in the browser need it, Playwright and Chromium.
"""

import functools
import http.server
import re
import shutil
import threading
from pathlib import Path

import pytest

import smpl
import smpl.controllers
import smpl.datasets
import smpl.export

ROOT = Path(__file__).resolve().parents[2]
DOCS, SITE = ROOT / "docs", ROOT / "site"
SUMMARY = (DOCS / "SUMMARY.md").read_text(encoding="utf-8")
# The folder `editors` holds packages for editors, with their own pages.
FOUND = [path.relative_to(DOCS) for path in DOCS.rglob("*.md") if path.name != "SUMMARY.md"]
PAGES = sorted(str(path) for path in FOUND if path.parts[0] != "editors" and "node_modules" not in path.parts)


def test_every_page_of_the_book_is_in_its_contents_once():
    linked = re.findall(r"\]\(([^)]+)\)", SUMMARY)
    assert sorted(linked) == PAGES


def test_every_picture_of_a_page_is_there_and_every_picture_is_on_a_page():
    shown = set()
    for page in PAGES:
        for link in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", (DOCS / page).read_text(encoding="utf-8")):
            assert (DOCS / page).parent.joinpath(link).is_file(), (page, link)
            shown.add((DOCS / page).parent.joinpath(link).resolve())
    assert {path.resolve() for path in DOCS.rglob("*.svg")} <= shown


def test_every_public_name_of_the_package_is_on_the_page_of_the_api():
    page = (DOCS / "api.md").read_text(encoding="utf-8")
    for module in (smpl, smpl.controllers, smpl.datasets, smpl.export):
        for name in module.__all__:
            assert name == "__version__" or f"::: {module.__name__}.{name}\n" in page, name


def chromium() -> str:
    """Path of the browser; the test is skipped where something is missing, by its name."""
    if not (SITE / "index.html").is_file():
        pytest.skip("site/ is not built: run .ci/site")
    pytest.importorskip("playwright", reason="playwright is not installed")
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if found is None:
        pytest.skip("chromium is not installed")
    return found


@pytest.fixture(scope="module")
def browser():
    executable = chromium()
    from playwright.sync_api import sync_playwright

    flags = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(
            executable_path=executable, args=[*flags, "--disable-component-update", "--disable-sync"]
        )
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def address():
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    handler = functools.partial(Quiet, directory=SITE)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()


@pytest.fixture(scope="module", params=[390, 1400])
def view(browser, request):
    """A window of a width, and what went wrong in it. Nothing but the site itself can be reached."""
    context = browser.new_context(viewport={"width": request.param, "height": 900})
    context.route(lambda url: "127.0.0.1" not in url, lambda route: route.abort())
    page = context.new_page()
    faults: list[str] = []
    page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: faults.append(str(error)))
    # What is still on its way when the next page is opened is broken off, and no fault.
    broken_off = "net::ERR_ABORTED"
    page.on("requestfailed", lambda failed: faults.append(failed.url) if failed.failure != broken_off else None)
    yield page, faults
    context.close()


@pytest.mark.parametrize("path", PAGES)
def test_a_page_shows_its_mathematics_and_fits_the_window(path, view, address):
    page, faults = view
    faults.clear()
    page.goto(f"{address}/{re.sub('README$', 'index', path.removesuffix('.md'))}.html")
    page.wait_for_load_state("load")
    formulas = page.locator(".arithmatex").count()
    text = (DOCS / path).read_text(encoding="utf-8")
    assert formulas >= text.count("\n$$\n") // 2
    assert page.locator(".arithmatex .katex").count() == formulas
    assert page.locator(".katex-error").count() == 0
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    broken = "[...document.images].filter(image => !image.complete || image.naturalWidth == 0).map(image => image.src)"
    assert page.evaluate(broken) == []
    assert faults == []


def test_search_finds_a_word_of_a_page(view, address):
    page, faults = view
    faults.clear()
    page.goto(f"{address}/index.html")
    page.keyboard.press("/")
    page.wait_for_function("document.activeElement.matches('.md-search__input')")
    page.keyboard.type("penicillin")
    page.locator(".md-search-result__link").first.wait_for(state="attached", timeout=60_000)
    links = page.locator(".md-search-result__link").evaluate_all("links => links.map(link => link.href)")
    assert any("pensim" in link for link in links)
    assert faults == []
