"""`python -m smpl.benchmark gallery`: controllers of the gallery on the same episodes."""

import json
from pathlib import Path

import gymnasium
import pytest

import smpl  # noqa: F401  (registers environments)
from smpl_benchmarks import gallery
from smpl_benchmarks.pages import fill

ROOT = Path(__file__).resolve().parents[2]


def _by_hand(controller, seed, steps):
    """Return of an episode that is stepped through Gymnasium."""
    env = gymnasium.make("smpl/FirstOrder-v0", max_steps=steps, normalize=False)
    env.reset(seed=seed)
    controller.reset(env.unwrapped)
    total, ended = 0.0, False
    observation, _ = env.reset(seed=seed)
    while not ended:
        observation, reward, terminated, truncated, _ = env.step(controller(observation))
        total, ended = total + reward, terminated or truncated
    return total


class _Rest:
    def reset(self, env):
        self.action = env.model.native.defaults("action")

    def __call__(self, observation):
        return self.action


def test_records_hold_returns_of_episodes_with_the_seeds_of_the_command(tmp_path, capsys):
    records = tmp_path / "gallery.json"
    command = ["--env", "FirstOrder", "--episodes", "2", "--steps", "6", "--results", str(records)]
    assert gallery.main(command) == 0
    found = json.loads(records.read_text())["FirstOrder"]
    expected = [_by_hand(_Rest(), gallery.SEED + i, 6) for i in range(2)]
    assert found["nominal"]["returns"] == pytest.approx(expected, rel=1e-12)
    assert "`smpl/FirstOrder-v0`" in capsys.readouterr().out


def test_plants_with_records_are_not_run_again_and_the_page_gets_the_table(tmp_path, monkeypatch):
    one = {"returns": [1.0, 1.1, 0.9], "failures": 0}
    better = {"returns": [2.0, 2.1, 1.9], "failures": 1}
    record = {"episodes": 3, "steps": 6, "smpl": "0", "nominal": one, "baseline": one, "sampling": better}
    records, page = tmp_path / "gallery.json", tmp_path / "page.md"
    records.write_text(json.dumps({"CSTR": record}))
    page.write_text("# Page\n\n<!-- table: scores -->\n<!-- end of table -->\n")
    monkeypatch.setattr(gallery, "score", lambda *_: pytest.fail("run again"))
    command = ["--env", "CSTR", "--episodes", "3", "--steps", "6", "--results", str(records), "--page", str(page)]
    assert gallery.main(command) == 0
    text = page.read_text()
    assert "sampling for 1." in text
    assert "improves on nominal actions for 0 of 1" in text
    assert "+1 to +1 **" in text
    assert "0/0/1" in text


def test_a_plant_that_does_not_exist_is_refused_by_name(capsys):
    assert gallery.main(["--env", "Kettle"]) == 1
    assert "Kettle" in capsys.readouterr().err


def test_the_page_shows_the_records(tmp_path):
    page = ROOT / "docs/gallery.md"
    copy = tmp_path / "gallery.md"
    copy.write_text(page.read_text())
    fill(copy, {"scores": gallery.table(json.loads((ROOT / "docs/results/gallery.json").read_text()))})
    assert copy.read_text() == page.read_text()
