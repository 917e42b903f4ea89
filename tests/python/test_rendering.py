"""Pictures and text of episodes, models and saved runs, headless."""

import copy
import pickle
import subprocess
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest

import smpl

SVG = "{http://www.w3.org/2000/svg}"


def texts(svg):
    return [element.text for element in ET.fromstring(svg).iter(f"{SVG}text")]


def played(name="reactor", steps=5, **options):
    env = smpl.Env(name, render_mode="rgb_array", **options)
    env.reset(seed=0)
    for _ in range(steps):
        env.step(np.zeros(env.action_space.shape))
    return env


@pytest.mark.parametrize("name", ["reactor", "beer"])
def test_a_picture_is_an_image_in_bytes(name):
    env = smpl.Env(name, render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    env.step(np.zeros(env.action_space.shape))
    second = env.render()
    assert second.dtype == np.uint8 and second.ndim == 3 and second.shape[2] == 3
    assert first.ndim == 3 and not np.array_equal(first, second)


def test_curves_are_drawn_in_colour():
    picture = played().render().astype(int)
    assert np.any(np.ptp(picture, axis=2) > 80), "no curve was drawn"


def test_a_picture_shows_what_is_asked_for():
    env = played()
    picture = env.picture(["T", "q_out"])
    assert picture.names == ["T", "q_out"]
    shown = texts(picture.svg())
    assert "T" in shown and "q_out" in shown and "c_A" not in shown
    with pytest.raises(ValueError, match="did you mean `q_out`"):
        env.picture("q_ot")


def test_pictures_are_saved_by_their_ending(tmp_path):
    picture = played().picture()
    for name, first in [
        ("p.svg", b"<svg "),
        ("p.png", b"\x89PNG"),
        ("p.pdf", b"%PDF-"),
        ("p.html", b"<!DOCTYPE html>"),
    ]:
        picture.save(tmp_path / name)
        assert (tmp_path / name).read_bytes().startswith(first)
    with pytest.raises(ValueError, match=r"\.svg, \.png"):
        picture.save(tmp_path / "p.gif")
    with pytest.raises(OSError, match="nowhere"):
        picture.save(tmp_path / "nowhere" / "p.svg")


def test_a_notebook_shows_models_environments_and_pictures():
    model = smpl.compile("reactor")
    page = model._repr_html_()
    assert "<svg" in page and "Continuous stirred-tank reactor" in page and "kmol/m^3" in page
    assert "T" in texts(model._repr_svg_())
    env = played()
    first, second = env._repr_html_(), env._repr_html_()
    assert first.count("<svg") == 1 and "<script>" in first
    assert first != second, "two pictures on a page share their names"
    assert smpl.Env(model)._repr_html_() is None


def test_a_saved_run_is_drawn_with_and_without_its_model(tmp_path):
    table = tmp_path / "run.csv"
    table.write_text("step,time,T,T_c,reward\n0,0,50,,\n1,0.1,51,20,-1\n2,0.2,52,21,-2\n")
    assert smpl.plot(table, show="T").names == ["T"]
    picture = smpl.plot([table, table], show=["T", "T_c"], model="reactor")
    assert "[°C]" in texts(picture.svg())
    with pytest.raises(ValueError, match="unknown quantity to show `h`"):
        smpl.plot(table, show="h", model="reactor")
    with pytest.raises(OSError, match="no such file"):
        smpl.plot(tmp_path / "missing.csv")
    with pytest.raises(ValueError, match="empty"):
        smpl.plot([])


def test_a_picture_follows_the_environment_back_to_a_snapshot():
    env = played(steps=3)
    before, point = env.picture("T").svg(), env.snapshot()
    env.step(np.ones(2))
    assert env.picture("T").svg() != before
    env.restore(point)
    assert env.picture("T").svg() == before


def test_a_copy_draws_its_own_episode():
    env = played(steps=3)
    twin = copy.deepcopy(env)
    assert twin.picture("T").svg() == env.picture("T").svg()
    twin.step(np.ones(2))
    assert "step 4" in " ".join(texts(twin.picture("T").svg())) and "step 3" in " ".join(texts(env.picture("T").svg()))
    other = pickle.loads(pickle.dumps(env))
    with pytest.raises(ValueError, match="reset"):
        other.picture()
    other.reset(seed=1)
    assert other.render().ndim == 3


def test_text_names_states_actions_and_the_end():
    env = smpl.Env("reactor", render_mode="ansi", normalize=False)
    env.reset(seed=0)
    assert "c_A" in env.render()
    env.step([40.0, 0.1])
    text = env.render()
    assert "T_c" in text and "40" in text and "action_box" in text


def test_rendering_without_a_mode_gives_nothing():
    env = smpl.Env("reactor")
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None
    with pytest.raises(ValueError, match="render_mode"):
        env.picture()


def test_info_names_the_condition_of_a_success():
    model = smpl.compile(
        source="model M\nstate x = 1\neq d/dt x = -x / 1 [s]\naction u = 0 in 0..1\nobserve x in 0..1\n"
        "success half when x < 0.5\nreward r default = x\nepisode { step = 0.4 [s], max_steps = 9 }"
    )
    env = smpl.Env(model)
    _, info = env.reset(seed=0)
    assert info["success_name"] == ""
    assert env.step([0.0])[4]["success_name"] == ""
    info = env.step([0.0])[4]  # exp(-0.8) = 0.449
    assert info["success"] is True and info["success_name"] == "half"
    envs = smpl.VectorEnv(model, 2, autoreset_mode="disabled")
    envs.reset(seed=0)
    envs.step(np.zeros((2, 1)))
    infos = envs.step(np.zeros((2, 1)))[4]
    assert infos["success_name"].tolist() == ["half", "half"] and infos["_success_name"].all()


def test_saved_tables_are_read_from_parquet_as_from_csv(tmp_path):
    model = str(tmp_path / "plant.eq")
    (tmp_path / "plant.eq").write_text(
        "time t : s\nstate x : m = 1\neq d/dt x = -x / 1 [s]\nreward r = 0\nepisode { step = 1 [s], max_steps = 4 }"
    )
    for ending in ("csv", "parquet"):
        command = [sys.executable, "-m", "smpl", "simulate", model, "--out", str(tmp_path / f"run.{ending}")]
        assert subprocess.run(command, capture_output=True).returncode == 0
    pictures = [smpl.plot(tmp_path / f"run.{ending}", model=model).svg() for ending in ("csv", "parquet")]
    assert pictures[0] == pictures[1]


def test_tables_of_pyarrow_are_read_and_compressed_ones_refused(tmp_path):
    arrow = pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    table = arrow.table({"time": [0.0, 1.0, 2.0], "x": [1.0, None, 3.0], "n": [1, 2, 3]})
    parquet.write_table(table, tmp_path / "plain.parquet", compression="none")
    assert {"x", "n"} & set(smpl.plot(tmp_path / "plain.parquet").names)
    parquet.write_table(table, tmp_path / "small.parquet", compression="snappy")
    with pytest.raises(ValueError, match="SNAPPY"):
        smpl.plot(tmp_path / "small.parquet")
    nested = arrow.table({"time": [0.0], "x": [[1.0, 2.0]]})
    parquet.write_table(nested, tmp_path / "lists.parquet", compression="none")
    with pytest.raises(ValueError, match="column `x`"):
        smpl.plot(tmp_path / "lists.parquet")
