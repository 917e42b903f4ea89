"""Analytic policy gradients over short horizons: against central differences and LQR."""

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from smpl.learning import Task
from smpl.learning.formulation import Formulation

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from smpl_benchmarks.short_horizon import ShortHorizonTrainer  # noqa: E402
from smpl_benchmarks.windows import pieces  # noqa: E402

LINEAR = """model Spring "an unstable mass with a force"
time t : s
action u = 0 in -8..8
state x = 0 in -5..5
state v = 0 in -5..5
initial x ~ uniform(-1, 1)
initial v ~ uniform(-1, 1)
eq d/dt x = v*1[1/s]
eq d/dt v = (0.5*x - 0.2*v + u)*1[1/s]
observe x, v
reward cost default = -(sq(x) + 0.1*sq(v) + 0.1*sq(u))
episode { step = 0.2 [s], max_steps = 40 }
"""
KEPT = """model Kept "a tank with an event and a discrete variable"
time t : s
action q = 0.5 in 0..2
action b = 0 in -1..1
state h = 1 in 0..3
initial h ~ uniform(0.9, 1.1)
discrete start = h
discrete fills = 0
eq d/dt h = (q - 0.6*h + 0.1*b*h*fills)*1[1/s]
event full when h > 1.3
at full { reset h = 0.4*h ; next fills = fills + 1 }
observe h, fills in 0..100
reward level default = -sq(h - 1.2)/sq(0.1 + start) - 0.01*sq(b)
episode { step = 0.5 [s], max_steps = 30 }
"""


class Feedback:
    """-0.8 x - 0.9 v of the states, and -0.2 of the observed v in the action space, clipped."""

    needs = "states"

    def reset(self, env):
        pass

    def action(self, env):
        return np.clip(env.state @ [-0.8, -0.9] - 0.2 * env.reading[1], -8, 8)[None]

    def actions(self, rows):
        seen = 5 * rows.observations[:, 1:]  # of -1..1
        return np.clip((rows.states @ [-0.8, -0.9])[:, None] - 0.2 * seen, -8, 8)


def model_of(text, tmp_path):
    path = tmp_path / "model.eq"
    path.write_text(text)
    return Task.of(str(path))


def randomised(trainer, seed):
    """A policy and a value whose last layers are not nearly zero."""
    trainer.begin(seed)
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for one in trainer._trained("actor")[:-1]:
            one.add_(0.3 * torch.randn(one.shape, generator=generator, dtype=torch.float64))
    return trainer


def value_of(trainer, seed, noise):
    """Discounted rewards of a window and the value of its end, from the episodes alone."""
    seen, _ = trainer.batch.reset(seed=seed)
    window = trainer.window(seen, noise)
    assert not window.done.any()
    with torch.no_grad():
        end = trainer._nets["target"](torch.as_tensor(window.following[-1]))[:, 0].numpy()
    discounts = trainer.hyper.gamma ** np.arange(len(window.rewards))
    total = discounts @ window.rewards + trainer.hyper.gamma ** len(window.rewards) * end
    return window, float(total.mean())


def compare(trainer, horizon):
    """The derivatives by some weights, next to central differences of the episodes."""
    noise = 0.3 * torch.randn(horizon, *trainer.batch.action_space.shape, dtype=torch.float64)
    window, before = value_of(trainer, 3, noise)
    found = trainer.objective(window, noise)
    assert float(found.detach()) == pytest.approx(before, rel=1e-6)
    found.backward()
    pairs = []
    for one in trainer._trained("actor"):
        flat, gradient = one.data.view(-1), one.grad.view(-1)
        for i in (0, len(flat) // 2, int(gradient.abs().argmax())):
            held, sides = float(flat[i]), []
            for shift in (1e-4, -1e-4):
                flat[i] = held + shift
                sides.append(value_of(trainer, 3, noise)[1])
            flat[i] = held
            pairs.append((float(gradient[i]), (sides[0] - sides[1]) / 2e-4))
    return np.array(pairs).T


FORMULATIONS = {
    "the box": {},
    "a nominal action with limits and windows": {
        "centre": "nominal", "limits": {"u": [-4, 6]}, "windows": {"x": [-2, 3]}, "reward_scale": 0.5,
    },
    "a controller that reads the observation": {"centre": "test_short_horizon:Feedback", "reach": 0.5},
}  # fmt: skip


@pytest.mark.parametrize("name", FORMULATIONS)
def test_gradients_of_a_linear_plant_equal_central_differences(name, tmp_path):
    task = model_of(LINEAR, tmp_path)
    trainer = ShortHorizonTrainer(task, Formulation.of(FORMULATIONS[name]), {"horizon": 7, "hidden": 8}, 5)
    mine, differences = compare(randomised(trainer, 1), 7)
    # Observations are in single precision, which the differences see.
    np.testing.assert_allclose(mine, differences, rtol=2e-3, atol=5e-4 * np.abs(differences).max())


def test_gradients_across_events_and_discrete_variables_equal_central_differences(tmp_path):
    task = model_of(KEPT, tmp_path)
    trainer = ShortHorizonTrainer(task, Formulation(), {"horizon": 8, "hidden": 8}, 4)
    mine, differences = compare(randomised(trainer, 2), 8)
    assert "fills" in task.model.discrete_names and np.ptp(trainer.batch.get_attr("discrete"), axis=0)[1] > 0
    # Observations are in single precision, which the differences see.
    np.testing.assert_allclose(mine, differences, rtol=2e-3, atol=5e-4 * np.abs(differences).max())


WANDERING = """model Wandering "a lag with a feed that wanders, a clock and a set-point that jumps"
time t : s
param k = 1 in 0.5..2
param twice = 2*k
action u = 0.4 in -1..2
state x = 1 in -5..5
disturbance feed = 0 ~ 0.8*feed + 0.3*normal(0, 1)
disturbance goal = 1 ~ if n < 4 then 1 else 0.2
eq d/dt x = (-twice*x + u + feed + 0.1*sin(t/(1 [s])))*1[1/s]
initial x ~ uniform(0, 1)
observe x, feed in -3..3, goal in -3..3
reward near default = -sq(x - goal) - 0.1*sq(u)
episode { step = 0.5 [s], max_steps = 30 }
"""


def test_gradients_with_disturbances_and_drawn_parameters_equal_central_differences(tmp_path):
    task = model_of(WANDERING, tmp_path)
    curriculum = {"k": [[0.0, 0.6, 1.6]]}
    trainer = ShortHorizonTrainer(task, Formulation(), {"horizon": 7, "hidden": 8}, 4, curriculum)
    mine, differences = compare(randomised(trainer, 2), 7)
    assert np.ptp(trainer.batch.get_attr("parameter"), axis=0)[0] > 0.1
    np.testing.assert_allclose(mine, differences, rtol=2e-3, atol=5e-4 * np.abs(differences).max())
    # A window of one step, and windows with the ends of episodes.
    for horizon in (1, 11):
        one = ShortHorizonTrainer(task, Formulation(), {"horizon": horizon, "hidden": 8}, 3, curriculum)
        one.begin(0)
        one.train(3 * 33, 0, 0.0)


def regulated(task, policy, starts):
    """Costs of episodes from starts, one per start, with actions in -1..1 of the observations."""
    env = task.env()
    costs = []
    for start in starts:
        seen, _ = env.reset(seed=0, options={"state": dict(zip(("x", "v"), start, strict=True))})
        rewards, ended = [], False
        while not ended:
            seen, reward, terminated, truncated, _ = env.step(policy(seen))
            rewards.append(reward)
            ended = terminated or truncated
        costs.append(-sum(rewards))
    return np.array(costs)


def test_the_policy_of_a_linear_plant_comes_within_some_per_cent_of_lqr(tmp_path):
    task = model_of(LINEAR, tmp_path)
    hyper = {"gamma": 0.99, "actor_rate": 0.005, "hidden": 32, "log_std_init": -2.0}
    trainer = ShortHorizonTrainer(task, Formulation(), hyper, 16)
    trainer.begin(0)
    for part in range(4):
        trainer.train(16 * 16 * 25, part, part / 4)
    # SciPy: the plant with a zero-order hold, weights of the reward at the end of each step.
    whole = expm(0.2 * np.array([[0, 1, 0], [0.5, -0.2, 1], [0, 0, 0]]))
    a, b = whole[:2, :2], whole[:2, 2:]
    p = solve_discrete_are(a, b, np.diag([1.0, 0.1]), [[0.1]])
    gain = np.linalg.solve(0.1 + b.T @ p @ b, b.T @ p @ a)
    exported = torch.jit.load(str(tmp_path / trainer.export(tmp_path)))
    starts = np.random.default_rng(0).uniform(-1, 1, (10, 2))
    mine = regulated(task, lambda seen: exported(torch.as_tensor(seen)).detach().numpy(), starts)
    best = regulated(task, lambda seen: -gain @ (5 * seen) / 8, starts)
    zero = regulated(task, lambda seen: np.zeros(1), starts)
    assert mine.mean() < 1.05 * best.mean() and best.mean() < 0.2 * zero.mean()


def test_a_checkpoint_continues_with_the_bits_of_the_learner(tmp_path):
    task = model_of(LINEAR, tmp_path)
    first, second = (ShortHorizonTrainer(task, Formulation(), {"horizon": 4, "hidden": 8}, 3) for _ in range(2))
    first.begin(5)
    first.train(36, 1, 0.0)
    first.save(tmp_path)
    second.load(tmp_path)
    for one in (first, second):
        one.train(36, 2, 0.5)
    assert all(torch.equal(a, b) for a, b in zip(first._trained("actor"), second._trained("actor"), strict=True))


def test_a_reward_relative_to_the_start_of_an_episode_is_refused(tmp_path):
    task = model_of(LINEAR.replace("+ 0.1*sq(u))", "+ 0.1*sq(u)) / (0.1 + sq(initial(x)))"), tmp_path)
    trainer = ShortHorizonTrainer(task, Formulation(), {"horizon": 4}, 3)
    trainer.begin(0)
    with pytest.raises(
        NotImplementedError, match=r"the reward of an episode is .* keep initial or earlier values in discrete"
    ):
        trainer.train(36, 0, 0.0)


def test_a_centre_that_asks_the_running_model_is_refused(tmp_path):
    task = model_of(LINEAR + "policy back { u = -x - v }\n", tmp_path)
    with pytest.raises(NotImplementedError, match="centre is 'back', a policy that asks the running model"):
        ShortHorizonTrainer(task, Formulation.of({"centre": "back"}), {}, 2)


def test_windows_end_at_failures_and_time_limits(tmp_path):
    task = model_of(LINEAR.replace("episode {", "fail far when x > 0.9\nepisode {"), tmp_path)
    trainer = ShortHorizonTrainer(task, Formulation.of({"failure_reward": -3}), {"horizon": 30, "hidden": 8}, 8)
    trainer.begin(0)
    seen, _ = trainer.batch.reset(seed=1)
    noise = torch.zeros(30, 8, 1, dtype=torch.float64)
    for _ in range(2):  # the second window has the time limit of 40 steps
        window = trainer.window(seen, noise)
        found = pieces(window, trainer.batch)
        steps = sum(len(one.places) * one.rewards.shape[1] for one in found)
        assert steps == window.rewards.size - window.terminated.sum()
        assert np.all(window.rewards[window.terminated] == -3)
        seen = trainer.batch.form.observe(trainer.batch.rows.memory, trainer.batch.rows.observations)
    assert window.truncated.any() and window.terminated.any()
    ends = trainer.returns(window)[window.terminated]
    np.testing.assert_array_equal(ends, -3)


@pytest.mark.parametrize(
    ("formulation", "hyper", "message"),
    [
        ({"history": 2}, {}, "history is 2, expected 1"),
        ({}, {"horizons": 3}, "unknown 'horizons'"),
        ({}, {"horizon": 0}, "horizon"),
        ({}, {"actor_rate": "fast"}, "expected a number"),
    ],
)
def test_invalid_arguments_are_refused_by_name(formulation, hyper, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        ShortHorizonTrainer(model_of(LINEAR, tmp_path), Formulation.of(formulation), hyper, 2)
