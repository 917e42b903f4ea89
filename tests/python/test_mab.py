"""The right-hand side of MAb against its reference, section 10 of the specification."""

import os
from pathlib import Path

import numpy as np
import pytest

import smpl

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = Path(os.environ.get("SMPL_REFERENCE", ROOT.parent / "shared" / "reference"))

# Scales of the tanks' states, section 2 of the specification; those of the column are 1.
TANKS = [3e10, 5e10, 5000, 50, 200, 50, 150, 3000, 2e10, 3e10, 5000, 100, 250, 100, 200, 3000, 37, 3, 200]


@pytest.mark.skipif(not (REFERENCE / "mab_rhs.npz").exists(), reason="reference files are not installed")
def test_rates_of_legacy_are_those_of_the_reference():
    table = np.load(REFERENCE / "mab_rhs.npz")
    model = smpl.compile(ROOT / "models" / "mab.eq", scenario="legacy")
    assert list(model.state_names) == [str(name) for name in table["state_names"]]
    scale = np.ones(len(model.state_names))
    scale[: len(TANKS)] = TANKS
    for state, action, expected in zip(table["states"], table["actions"], table["derivatives_legacy"], strict=True):
        rates = np.asarray(model.rhs(0.0, state, action))
        assert (np.abs(rates - expected) / scale).max() <= 1e-12 * (np.abs(expected) / scale).max()


def test_the_phase_is_shown_by_name_in_single_and_vector_environments():
    env = smpl.Env("mab_plant", normalize=False, max_steps=3)
    vector = smpl.VectorEnv("mab_plant", 2, normalize=False, max_steps=3, autoreset_mode="same_step")
    start = {"start": "steady"}
    _, info = env.reset(options=start)
    vector.reset(options=start)
    assert env.model.phases[:3] == ("idle", "wash", "cut") and info["phase"] == "idle"
    action = env.model.native.defaults("action")
    action[env.action_names.index("switch")] = 1
    # Minutes: wash to 13.8, cut to 16.8, elution to 31.8, strip to 46.8, hold to 91.8, loading to 143.9, wash to 154.3,
    # elution to 174.9, flush to 202.7.
    for phase in ("hold", "load_cex", "flush"):
        info = env.step(action)[4]
        assert info["phase"] == phase
        *_, infos = vector.step(np.stack([action, action]))
        last = infos["final_info"]["phase"] if phase == "flush" else infos["phase"]
        assert list(last) == [phase, phase]
    assert list(infos["phase"]) == ["idle", "idle"]


@pytest.mark.parametrize("phase", [99, 0, -1, 1.5])
def test_a_phase_that_the_schedule_does_not_have_is_refused(phase):
    env = smpl.Env("mab_plant")
    with pytest.raises(ValueError, match="`phase` must be a whole number from 1 to"):
        env.reset(seed=0, options={"discrete": {"phase": phase}})
    last = len(env.model.phases)
    assert env.reset(seed=0, options={"discrete": {"phase": last}})[1]["phase"] == env.model.phases[-1]


@pytest.mark.parametrize("model", ["mab", "mab_plant"])
def test_a_tank_beyond_its_box_is_a_violation_by_its_range(model):
    env = smpl.Env(model, normalize=False)
    env.reset(seed=2, options={"state": {"V1": 3300.0}})
    _, _, terminated, _, info = env.step(env.steady_action)
    volume = env.state[env.state_names.index("V1")]
    assert terminated and info["failure"].startswith("box") and volume > 3290
    # Bounds 2400 and 3000 L, the box 5 % above; section 6 of the specification.
    assert info["constraints"]["box"] == pytest.approx((volume - 3150) / 600, abs=1e-5)


def test_the_published_death_rate_has_a_steady_state_in_its_box():
    env = smpl.Env("mab", variants=["death_linear"], normalize=False)
    env.reset(seed=4)
    steady = dict(zip(env.state_names, env.steady_state, strict=True))
    action = dict(zip(env.action_names, env.steady_action, strict=True))
    # Cells leave by F_2 alone, dead and viable ones alike: what dies is what is not viable of that, over what is.
    leaves = 60 * action["F_2"] * steady["Xv2"] / steady["Xv1"] / steady["V1"]
    died = leaves * (steady["Xt1"] / steady["Xv1"] - 1)
    ammonia = (env.parameters["K_damm"] / steady["AMM1"]) ** env.parameters["n_d"]
    assert died == pytest.approx((-0.0045 * steady["T"] + 0.1682) / (1 + ammonia), rel=1e-6)
    for _ in range(20):
        _, _, terminated, _, info = env.step(env.policy("nominal"))
        assert not terminated, info["failure"]
