"""Statements that follow those of a file: `smpl.compile(..., extra=...)`."""

import pickle

import gymnasium
import numpy as np
import pytest

import smpl
from smpl.commands.main import main
from smpl.controllers import ExtendedKalmanFilter

ENERGY = "reward energy = -abs(T_c - 26.85 [degC]) / 1 [K]"


def test_a_reward_and_a_limit_are_added_without_editing_the_file():
    env = smpl.Env("reactor", extra=f"{ENERGY}\nconstraint hot when T > 40 [degC]", reward="energy", normalize=False)
    env.reset(seed=0, options={"start": "nominal"})
    _, reward, _, _, info = env.step([30.0, 0.1])
    assert reward == pytest.approx(-3.15, abs=1e-12)
    assert info["constraints"]["hot"] > 0
    assert set(info["rewards"]) == {"setpoint", "setpoint_change", "energy"}


def test_what_is_added_changes_nothing_else():
    plain, more = smpl.Env("reactor", normalize=False), smpl.Env("reactor", extra=ENERGY, normalize=False)
    for env in (plain, more):
        env.reset(seed=7)
    for _ in range(5):
        one, two = plain.step([24.0, 0.12]), more.step([24.0, 0.12])
        assert one[1] == two[1]
        np.testing.assert_array_equal(one[0], two[0])


@pytest.mark.parametrize(
    ("extra", "line", "told"),
    [
        ("\nreward energy = nonsense", 2, "nonsense"),
        ("reward bad = (", 1, "not closed"),
        ("reward setpoint = 1", 1, "two rewards"),
        ("let a : m = h\nlet b : m = a + T", 2, "added"),
    ],
)
def test_findings_name_extra_and_its_line(extra, line, told):
    with pytest.raises(smpl.CompileError, match=told) as caught:
        smpl.compile("reactor", extra=extra)
    found = caught.value.diagnostics[0]
    assert (found.file, found.line) == ("extra", line)


def test_a_variant_that_is_added_replaces_what_the_file_says():
    model = smpl.compile("reactor", extra="variant wide { param r : m = 0.4 in 0.05..5 }", variants=["wide"])
    assert model.native.defaults("parameter")[model.parameter_names.index("r")] == 0.4


def test_an_added_import_is_found_beside_the_model():
    with pytest.raises(smpl.CompileError, match="nowhere"):
        smpl.compile("reactor", extra='use "lib/nowhere.eq"')


def test_a_model_with_more_statements_is_pickled_and_recompiled_with_them():
    model = smpl.compile("reactor", extra=ENERGY)
    assert pickle.loads(pickle.dumps(model)).reward_names == model.reward_names
    assert model.variant_of(reward="energy").reward == "energy"


def test_a_level_that_is_added_has_its_sensors():
    level = "level gauge { observe h noise normal(0, 0.5), T }"
    env = smpl.Env("reactor", extra=level, observation="gauge", normalize=False)
    kalman = ExtendedKalmanFilter(env, deviation={"c_A": 0.1, "T": 5, "h": 0.1})
    env.reset(seed=0)
    kalman.reset(env)
    assert np.isfinite(kalman.update(env)).all()


def test_gymnasium_makes_environments_with_more_statements():
    env = gymnasium.make("smpl/Reactor-v0", extra=ENERGY, reward="energy")
    assert env.unwrapped.model.reward == "energy"
    vector = smpl.make_vec("reactor", num_envs=2, extra=ENERGY, reward="energy")
    assert vector.model.reward == "energy"


def test_extra_is_a_text_and_goes_to_compile():
    with pytest.raises(ValueError, match="extra is 5"):
        smpl.compile("reactor", extra=5)
    with pytest.raises(ValueError, match=r"give extra to smpl\.compile"):
        smpl.Env(smpl.compile("reactor"), extra=ENERGY)


def test_the_command_takes_statements(tmp_path, capfd):
    out = tmp_path / "run.csv"
    command = ["simulate", "models/reactor.eq", "--start", "nominal", "--steps", "2", "--out", str(out)]
    assert main([*command, "--extra", ENERGY]) == 0
    assert "energy" in out.read_text(encoding="utf-8").splitlines()[0]
    assert main(["check", "models/reactor.eq", "--extra", "reward a = b"]) == 1
    assert "extra:1:12" in capfd.readouterr().err
    assert main(["compile", "models/reactor.eq", "-o", str(tmp_path / "r.smplc"), "--extra", ENERGY]) == 1
    assert "belongs to a file" in capfd.readouterr().err


def test_the_command_fits(tmp_path, capfd):
    run = tmp_path / "run.csv"
    simulate = ["simulate", "models/reactor.eq", "--seed", "3", "--set", "U=50", "--steps", "30"]
    assert main([*simulate, "--out", str(run)]) == 0
    scenario = tmp_path / "found.yaml"
    assert main(["fit", "reactor", "--data", str(run), "--parameters", "U", "--out", str(scenario)]) == 0
    assert "U" in capfd.readouterr().out
    model = smpl.compile("reactor", scenario=str(scenario))
    found = smpl.Env(model)
    found.reset(seed=0)
    assert found.parameters["U"] == pytest.approx(50, rel=1e-4)
    # The function of that name is still the function.
    assert callable(smpl.fit)
