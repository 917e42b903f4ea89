"""Predictive control tuned by gradients: against central differences of returns, and detuned weights."""

import json

import numpy as np
import pytest

import smpl
from smpl.learning import Task
from smpl.learning.agents import agent
from smpl.learning.formulation import Formulation

pytest.importorskip("casadi", reason="CasADi is not installed")

from smpl_benchmarks.predictive import PredictiveTrainer

NEAR = "reward near = -sq((T - 51.3466 [degC])/5 [K]) - sq((h - 0.659 [m])/0.05 [m])"
TUNED = ("cost:T", "cost:h", "cost:T_c", "cost:q_out", "rate:T_c")
# Solved tightly, so that differences of returns show derivatives.
NMPC = {
    "horizon": 5, "cost": {"T": 0.4, "h": 3000.0, "T_c": 0.4, "q_out": 200.0}, "rate_weight": {"T_c": 0.02},
    "solver": "ipopt", "tolerance": 1e-10,
}  # fmt: skip


def trainer_of(tuned=TUNED, nmpc=None, steps=12, variants=(), **hyper):
    task = Task.of("reactor", extra=NEAR, reward="near", max_steps=steps, variants=variants)
    settings = {"nmpc": {**NMPC, **(nmpc or {})}, "tuned": tuned, **hyper}
    return PredictiveTrainer(task, Formulation(reward_scale=0.5), settings)


@pytest.mark.parametrize("variants", [(), ("feed_disturbances",)])
def test_the_gradient_of_a_return_equals_central_differences(variants):
    nmpc = {"set_point": {"T": 51.0}, "p": {"U": 50.0}}
    trainer = trainer_of((*TUNED, "target:T", "U"), nmpc, variants=variants)
    found = trainer.gradient(3)
    assert found.steps == 12 and found.value < 0
    for i in range(len(found.by)):
        held, sides = trainer._state["logarithms"][i], []
        step = 1e-5 if i > 4 else 1e-3
        for shift in (step, -step):
            trainer._state["logarithms"][i] = held + shift
            sides.append(trainer.gradient(3).value)
        trainer._state["logarithms"][i] = held
        expected = (sides[0] - sides[1]) / (2 * step)
        assert found.by[i] == pytest.approx(expected, rel=5e-3, abs=1e-4 * np.abs(found.by).max())


def test_detuned_weights_come_back_to_returns_of_tuned_ones(tmp_path):
    # Moves of the jacket count far too much, so that the temperature stays away.
    good = trainer_of(nmpc={"cost": {"T": 0.4, "h": 3000.0, "T_c": 1e-3, "q_out": 2.0}})
    detuned = trainer_of(nmpc={"cost": {"T": 0.004, "h": 3000.0, "T_c": 0.4, "q_out": 2.0}}, rate=0.5, episodes=2)
    seeds = (900, 901, 902)
    best, before = (np.mean([one.gradient(seed).value for seed in seeds]) for one in (good, detuned))
    for part in range(3):
        detuned.train(6 * 24, 10 * part, part / 3)
    after = np.mean([detuned.gradient(seed).value for seed in seeds])
    assert before < best and after > best - 0.1 * (best - before)
    # The file decides as the learner does.
    file = tmp_path / detuned.export(tmp_path)
    assert json.loads(file.read_text())["values"] == detuned.values
    env = smpl.Env("reactor", normalize=False, max_steps=12)
    env.reset(seed=900)
    chosen = agent(str(file), env.model).chooser
    chosen.reset(env)
    detuned.controller.adjust(detuned.values)
    detuned.controller.reset(env)
    assert chosen.action(env) == pytest.approx(detuned.controller.action(env), rel=1e-6)


def test_invalid_settings_are_refused_by_name():
    with pytest.raises(NotImplementedError, match="no controller for this process"):
        trainer_of(tuned=())
    with pytest.raises(ValueError, match="tuned has 'cost:c_A'"):
        trainer_of(tuned=("cost:c_A",))
    with pytest.raises(ValueError, match="expected a positive number"):
        trainer_of(tuned=("cost:T",), nmpc={"cost": {"T": 0.0, "T_c": 1.0}})
