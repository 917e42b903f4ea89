"""Texts of a model are shown as text: pages, reports and pictures have no link, image or script made of them."""

import html.parser
import json
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import smpl
from smpl.learning.reports import markdown, page

HOSTILE = [
    "[click](javascript:alert(1))",
    "![seen](https://tracker.example/x.png)",
    "<script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    "[a]: https://evil.example",
    "\\\\[b](https://evil.example)",
    "`[`c](https://evil.example)",
    "`[c](https://evil.example)",
    "`` ` [c](https://evil.example) ``",
    "` <img src=x onerror=alert(1)> \\\\` [c](https://evil.example)",
    "<https://evil.example>",
    "</title><!--<script>",
    "```",
    "| [d](https://evil.example) |",
    "&lt;script&gt; {: onclick=alert(1) }",
]
MODEL = """model Tank "{0}"
# {0}
# -- {0} --
time t : min
set kinds = {{a, b}} "{0}"
param k : 1/min = 0.5 "{0}"
action u : 1/min = 0 in 0..1 "{0}"
state h : m = 1 "{0}" # {0}
let twice : m = 2*h # {0}
eq d/dt h = -k*h - u*h
observe h in 0..9 "{0}"
event low when h < 0.1 [m] "{0}"
reward kept : 1 = -h/1 [m] "{0}"
fail full when h > 3 [m] "{0}"
policy held "{0}" {{ u = 0.5 [1/min] }}
variant slow "{0}" {{ param k : 1/min = 0.25 "{0}" }}
episode {{ step = 1 [min], max_steps = 5 }}
"""


class Tags(html.parser.HTMLParser):
    """Names of the elements of a page, and attributes that run or fetch something."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.active = [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        fetched = [name for name, value in attributes if name.startswith("on") or name in ("href", "src")]
        self.active += [(tag, name) for name in fetched]


def command(folder, *arguments):
    run = [sys.executable, "-m", "smpl", *map(str, arguments)]
    result = subprocess.run(run, cwd=folder, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return result.stdout


def written(folder, text):
    # A text of the language has no quotation mark in it.
    assert '"' not in text
    path = folder / "tank.eq"
    path.write_text(MODEL.format(text))
    return path


@pytest.mark.parametrize("text", HOSTILE)
def test_the_page_of_a_model_has_no_link_image_or_element_of_its_texts(text, tmp_path):
    markdown_it = pytest.importorskip("markdown_it", reason="markdown-it-py is not installed")
    shown = command(tmp_path, "doc", written(tmp_path, text))
    rendered = markdown_it.MarkdownIt("commonmark", {"html": True}).enable("table").render(shown)
    found = Tags(rendered)
    assert not set(found.tags) & {"a", "img", "script", "pre"} and not found.active, rendered
    assert rendered.count("<h2>Names</h2>") == 1  # no fence swallows the rest


@pytest.mark.parametrize("text", HOSTILE)
def test_pictures_have_no_element_of_a_models_texts(text, tmp_path):
    path = written(tmp_path, text)
    for name in ("run.svg", "run.html"):
        command(tmp_path, "simulate", path, "--steps", "2", "--plot", name)
        found = Tags((tmp_path / name).read_text())
        assert not set(found.tags) & {"a", "img", "image"} and not found.active
        # The page has its own script and title; a drawing has a title.
        assert found.tags.count("script") == (name == "run.html") and found.tags.count("title") <= 2
    shown = smpl.compile(path)._repr_html_()
    found = Tags(shown)  # with the script of its picture
    assert not set(found.tags) & {"a", "img"} and found.tags.count("script") == 1


@pytest.mark.parametrize("text", HOSTILE)
def test_reports_have_no_element_of_names(text):
    markdown_it = pytest.importorskip("markdown_it", reason="markdown-it-py is not installed")
    numbers = dict.fromkeys(("mean", "std", "episode_mean", "episode_std", "return_mean", "return_iqm"), 1.0)
    numbers |= dict.fromkeys(("failures", "successes", "cost_mean", "settled", "settling_time", "latency_ms"), 1)
    numbers |= {"return_interval": [0.0, 1.0], "return_iqm_interval": [0.0, 1.0], "returns": [1.0]}
    numbers |= {"failures_by_cause": {text: 1}, "violations": {text: 1.0}}
    about = {"env": text, "checksum": "0" * 64, "reward": text, "scenario": text, "episodes": 1, "seed": 0}
    report = {"about": {**about, "starts": text}, "controllers": {text: numbers}, "comparisons": {}}
    rendered = markdown_it.MarkdownIt("commonmark", {"html": True}).enable("table").render(markdown(report, {}, ""))
    for shown in (rendered, page(json.loads(json.dumps(report)), {}, "")):
        found = Tags(shown)
        assert not set(found.tags) & {"a", "img", "script", "pre"} and not found.active, shown


def test_c_in_a_file_with_an_odd_name_compiles_or_is_refused(tmp_path):
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    written(tmp_path, "a tank")
    for stem in ("it's a tank", "tänk", "a*b", "back\\slash", "trailing\\", "%s", "-dash"):
        command(tmp_path, "export", "tank.eq", "--to", "c", "-o", f"./{stem}.c")
        run = [compiler, "-std=c99", "-Wall", "-Wextra", "-Werror", "-c", f"./{stem}.c", "-o", "out.o"]
        compiled = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True)
        assert compiled.returncode == 0, compiled.stderr
    for stem in ('a"b', "two\nlines", "tab\tbed"):
        run = [sys.executable, "-m", "smpl", "export", "tank.eq", "--to", "c", "-o", f"{stem}.c"]
        refused = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True)
        assert refused.returncode != 0 and "cannot be included by C" in refused.stderr
        assert not (tmp_path / f"{stem}.c").exists() and not (tmp_path / f"{stem}.h").exists()


def test_a_run_does_not_start_more_threads_than_it_has_episodes(tmp_path):
    """3,000 stacks of 2 MB do not fit into the memory that the process may have."""
    resource = pytest.importorskip("resource", reason="limits of processes are of Unix")
    written(tmp_path, "a tank")
    run = [
        sys.executable,
        "-m",
        "smpl",
        "simulate",
        "tank.eq",
        "--episodes",
        "3",
        "--threads",
        "3000",
        "--summary",
        "s.csv",
    ]

    def limited():
        resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))

    result = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, preexec_fn=limited)
    assert result.returncode == 0, result.stderr
    assert len((tmp_path / "s.csv").read_text().splitlines()) == 4


def test_a_batch_and_a_rollout_take_any_number_of_threads(tmp_path):
    model = smpl.compile(written(tmp_path, "a tank"))
    before = threading.active_count()
    env = smpl.VectorEnv(model, 4, num_threads=3000)
    env.reset(seed=1)
    env.step(np.zeros((4, 1), dtype=np.float32))
    tasks = Path("/proc/self/task")
    if tasks.is_dir():
        assert len(list(tasks.iterdir())) < 200 + before
    model.rollout(np.ones(1), np.zeros((5, 2, 1)), threads=3000)
