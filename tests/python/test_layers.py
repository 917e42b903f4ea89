"""Control steps as layers of PyTorch and JAX: against closed forms and differences."""

import math

import numpy as np
import pytest

import smpl

DECAY = """model Decay "a first-order lag"
time t : s
param k : 1/s = 0.7 in 0..5
param c[i in 1..2] = 2 - i in -5..5
action u = 0.3 in -2..2
state x = 1 in -10..10
state y = 0 in -10..10
eq d/dt x = -k*x + u*1[1/s]
eq d/dt y = (c[1]*u + c[2])*1[1/s]
observe x, y
reward last default = x
reward gone = x - initial(x)
episode { step = 0.8 [s], max_steps = 50 }
"""

BALL = """model Ball "a ball on a plate"
time t : s
param e = 0.8 in 0..1
action push : m/s^2 = 0 in -5..5
state h : m = 1 in -1..100
state v : m/s = 0 in -100..100
discrete hits = 0
eq d/dt h = v
eq d/dt v = push - 10 [m/s^2]
event bounce when h < 0
at bounce { reset v = -e*v ; reset h = 0 ; next hits = hits + 1 }
observe h, v
reward height = h / 1 [m]
episode { step = 0.7 [s], max_steps = 10 }
"""

COUNTED = """model Counted "a tank that remembers its last action in a discrete variable"
time t : s
action u = 0.3 in -2..2
state x = 1 in -10..10
discrete d = 0
eq d/dt x = d*1[1/s]
at start { next d = d + u }
observe x
reward last = x
episode { step = 1 [s], max_steps = 10 }
"""

K, H = 0.7, 0.8


def decayed(x, u, k=K):
    """x after one step of `DECAY`, and its derivatives by x, u and k: the solution of the linear equation."""
    e = math.exp(-k * H)
    gain = (1 - e) / k
    return e * x + gain * u, e, gain, -H * e * x + u * (H * e / k - (1 - e) / k**2)


def bounced(h, v, push, e):
    """Height and speed after 0.7 s of one bounce on a plate."""
    a = push - 10.0
    at = (-v - math.sqrt(v * v - 2 * a * h)) / a
    up, rest = -e * (v + a * at), 0.7 - at
    return np.array([up * rest + a * rest**2 / 2, up + a * rest])


def differences(function, at, step=1e-6):
    """Jacobian by central differences."""
    columns = []
    for i in range(len(at)):
        ahead, behind = list(at), list(at)
        ahead[i] += step
        behind[i] -= step
        columns.append((np.asarray(function(*ahead)) - np.asarray(function(*behind))) / (2 * step))
    return np.stack(columns, axis=-1)


@pytest.fixture(scope="module")
def decay():
    return smpl.compile(source=DECAY, settings={"rtol": 1e-11})


@pytest.fixture(scope="module")
def ball():
    return smpl.compile(source=BALL, settings={"rtol": 1e-11})


@pytest.fixture
def torch():
    return pytest.importorskip("torch", reason="PyTorch is not installed")


@pytest.fixture
def jax():
    found = pytest.importorskip("jax", reason="JAX is not installed")
    before = found.config.jax_enable_x64
    found.config.update("jax_enable_x64", True)
    yield found
    found.config.update("jax_enable_x64", before)


def doubles(torch, values, grad=True):
    return torch.tensor(values, dtype=torch.float64, requires_grad=grad)


def test_torch_step_of_a_linear_model_has_its_closed_form_and_derivatives(torch, decay):
    x, u, k = doubles(torch, [1.4, 0.0]), doubles(torch, [0.5]), doubles(torch, K)
    after = smpl.torch.step(decay, x, u, {"k": k})
    value, by_x, by_u, by_k = decayed(1.4, 0.5)
    assert after.detach().numpy() == pytest.approx([value, 0.5 * H], abs=1e-9)
    after[0].backward()
    assert x.grad.numpy() == pytest.approx([by_x, 0.0], abs=1e-8)
    assert u.grad.numpy() == pytest.approx([by_u], abs=1e-8)
    assert k.grad.item() == pytest.approx(by_k, abs=1e-8)


@pytest.mark.parametrize("keep", [True, False])
def test_torch_gradcheck_passes_across_an_event(torch, ball, keep):
    x = doubles(torch, [[1.0, 0.0], [0.5, -2.0], [0.9, 1.0]])
    u, e = doubles(torch, [[0.0], [1.0], [-1.0]]), doubles(torch, [0.8, 0.7, 0.9])

    def step(x, u, e):
        return smpl.torch.step(ball, x, u, {"e": e}, keep=keep)

    assert torch.autograd.gradcheck(step, (x, u, e), eps=1e-5, atol=1e-5, rtol=1e-5)


def test_torch_derivatives_across_a_bounce_are_those_of_the_closed_form(torch, ball):
    x, u, e = doubles(torch, [0.9, 1.0]), doubles(torch, [-1.0]), doubles(torch, 0.9)
    rows = [torch.autograd.grad(smpl.torch.step(ball, x, u, {"e": e})[i], (x, u, e)) for i in range(2)]
    found = np.array([np.concatenate([np.atleast_1d(part.numpy()) for part in row]) for row in rows])
    assert found == pytest.approx(differences(bounced, [0.9, 1.0, -1.0, 0.9]), abs=1e-6)


def test_torch_batch_equals_single_points_and_broadcasts(torch, ball):
    x, u = doubles(torch, [[[1.0, 0.0], [0.5, -2.0]], [[0.9, 1.0], [0.3, 0.2]]]), doubles(torch, [[0.0], [1.0]])
    whole = smpl.torch.step(ball, x, u)
    assert whole.shape == (2, 2, 2)
    for i in range(2):
        for j in range(2):
            assert torch.equal(whole[i, j], smpl.torch.step(ball, x[i, j], u[j]))
    gradient = torch.autograd.grad(whole.sum(), u)[0]
    single = [torch.autograd.grad(smpl.torch.step(ball, x[:, j], u[j]).sum(), u)[0][j] for j in range(2)]
    assert gradient.numpy() == pytest.approx(torch.stack(single).numpy(), rel=1e-9)


def test_torch_takes_parameters_as_a_tensor_and_array_parameters_whole(torch, decay):
    x, u = doubles(torch, [1.4, 0.0], False), doubles(torch, [0.5], False)
    p = doubles(torch, [0.9, 2.0, 0.25])
    after = smpl.torch.step(decay, x, u, p, parameters=("k", "c"))
    assert after.detach().numpy() == pytest.approx([decayed(1.4, 0.5, 0.9)[0], (2.0 * 0.5 + 0.25) * H], abs=1e-9)
    after[1].backward()
    assert p.grad.numpy() == pytest.approx([0.0, 0.5 * H, H], abs=1e-9)
    whole = smpl.torch.step(decay, x, u, doubles(torch, [0.9, 2.0, 0.25], False))
    assert whole.numpy() == pytest.approx(after.detach().numpy(), rel=1e-9)
    named = smpl.torch.step(decay, x, u, {"k": 0.9, "c": doubles(torch, [2.0, 0.25])})
    assert named.detach().numpy() == pytest.approx(after.detach().numpy(), rel=1e-9)


def test_torch_outputs_have_derivatives(torch, decay):
    x, u = doubles(torch, [1.4, 0.0]), doubles(torch, [0.5])
    found = smpl.torch.step(decay, x, u, outputs=True)
    assert found.rewards.detach().numpy() == pytest.approx([decayed(1.4, 0.5)[0], decayed(1.4, 0.5)[0] - 1.4], abs=1e-9)
    gradient = torch.autograd.grad(found.rewards[1] + found.observations[1], (x, u))
    assert gradient[0].numpy() == pytest.approx([decayed(0, 0)[1] - 1, 1.0], abs=1e-8)
    assert gradient[1].numpy() == pytest.approx([decayed(0, 0)[2] + H], abs=1e-8)


def test_torch_keeps_the_type_of_its_arguments(torch, decay):
    after = smpl.torch.step(decay, torch.tensor([1.4, 0.0]), torch.tensor([0.5]))
    assert after.dtype == torch.float32 and not after.requires_grad
    assert after.numpy() == pytest.approx([decayed(1.4, 0.5)[0], 0.5 * H], rel=1e-6)


def test_torch_transforms_map_over_points(torch, decay):
    x, u = doubles(torch, [[1.4, 0.0], [1.0, 0.5]], False), doubles(torch, [0.5], False)
    jacobian = torch.func.vmap(torch.func.jacrev(lambda one: smpl.torch.step(decay, one, u)))(x)
    assert jacobian.numpy() == pytest.approx(np.tile(np.diag([decayed(0, 0)[1], 1.0]), (2, 1, 1)), abs=1e-8)


@pytest.mark.parametrize("checkpoint", [None, 2])
def test_torch_rollout_of_a_policy_has_the_gradient_of_the_closed_form(torch, decay, checkpoint):
    gain = doubles(torch, -0.6)
    found = smpl.torch.rollout(
        decay, doubles(torch, [1.4, 0.0], False), lambda x, t: gain * x[..., :1], steps=5, checkpoint=checkpoint
    )
    assert [tuple(part.shape) for part in found] == [(6, 2), (5, 1), (5, 1), (5, 2)]
    e, through, _ = decayed(0, 0)[1:]
    factor = e - 0.6 * through
    assert found.rewards.detach().numpy()[:, 0] == pytest.approx(1.4 * factor ** np.arange(1, 6), abs=1e-8)
    found.rewards.sum().backward()
    expected = 1.4 * through * sum(n * factor ** (n - 1) for n in range(1, 6))
    assert gain.grad.item() == pytest.approx(expected, abs=1e-7)


def test_torch_rollout_of_actions_equals_the_gradient_of_an_episode(torch):
    near = smpl.compile("reactor", extra="reward near = -sq((T - 52 [degC])/5 [K]) - sq((h - 0.65 [m])/0.05 [m])")
    actions = doubles(torch, [[26.8, 0.1], [27.2, 0.1], [26.5, 0.11]])
    x = doubles(torch, [0.88, 51.3, 0.66])
    found = smpl.torch.rollout(near, x, actions, rewards=("near",))
    found.rewards.sum().backward()
    other = near.gradient(x.detach().numpy(), actions.detach().numpy(), reward="near")
    assert actions.grad.numpy() == pytest.approx(other.by_action, rel=1e-6)
    assert x.grad.numpy() == pytest.approx(other.by_state, rel=1e-6)


def test_torch_rollout_across_bounces_agrees_with_differences(torch, ball):
    x, u = doubles(torch, [1.0, 0.0]), doubles(torch, [[0.5], [-0.5], [0.2]])
    smpl.torch.rollout(ball, x, u).states[-1, 0].backward()

    def height(*pushes):
        state = [1.0, 0.0]
        for push in pushes:
            state = ball.step(state, [push])
        return state[0]

    assert u.grad.numpy()[:, 0] == pytest.approx(differences(height, [0.5, -0.5, 0.2], 1e-5), rel=1e-5)


def test_rollouts_refuse_models_and_rewards_that_remember_more_than_states(torch, decay):
    with pytest.raises(ValueError, match=r"Counted remembers more than its states.*x after 2 steps"):
        smpl.torch.rollout(smpl.compile(source=COUNTED), [1.0], [[0.3], [0.2]])
    with pytest.raises(ValueError, match=r"reward gone after 2 steps.*choose others by rewards"):
        smpl.torch.rollout(decay, [1.0, 0.0], [[0.3], [0.2]], rewards=("gone",))
    assert smpl.torch.rollout(decay, [1.0, 0.0], [[0.3], [0.2]], rewards=()).rewards.shape == (2, 0)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"x": [1.0]}, r"x has shape \(1,\), expected \(\.\.\., 2\)"),
        ({"u": [1.0, 2.0]}, r"u has shape \(2,\), expected \(\.\.\., 1\)"),
        ({"p": {"kk": 1.0}}, "p: unknown 'kk'; there are: k, c"),
        ({"p": {"k": "much"}}, r"p\['k'\] is 'much', expected a number"),
        ({"p": {"c": [1.0, 2.0, 3.0]}}, r"p\['c'\] has shape \(3,\), expected \(\.\.\., 2\)"),
        ({"p": [1.0, 2.0]}, r"p has shape \(2,\), expected \(\.\.\., 3\)"),
        ({"p": 3.0}, "p is float, expected a mapping"),
        ({"p": {"k": 1.0}, "parameters": ("k",)}, "parameters names the columns of p"),
        ({"x": [[1.0, 0.0]] * 2, "u": [[1.0]] * 3}, "cannot be broadcast|incompatible|broadcast"),
        ({"first_step": -1}, "first_step is -1"),
        ({"method": "euler"}, "method is 'euler'"),
    ],
)
@pytest.mark.parametrize("framework", ["torch", "jax"])
def test_invalid_arguments_are_named(request, framework, decay, arguments, says):
    package = request.getfixturevalue(framework)
    as_array = package.tensor if framework == "torch" else package.numpy.array
    given = {"x": [1.0, 0.0], "u": [0.5], **arguments}
    for name in ("x", "u", "p"):
        if isinstance(given.get(name), list):
            given[name] = as_array(given[name])
    if "c" in (given.get("p") if isinstance(given.get("p"), dict) else ()):
        given["p"] = {"c": as_array(given["p"]["c"])}
    with pytest.raises(ValueError, match=says):
        getattr(smpl, framework).step(decay, **given)


def test_a_text_instead_of_a_model_is_refused(torch):
    with pytest.raises(TypeError, match="model is str, expected a compiled model"):
        smpl.torch.step("reactor", [1.0], [1.0])


@pytest.mark.parametrize(("framework", "name"), [("torch", "PyTorch"), ("jax", "JAX")])
def test_a_missing_package_is_named(framework, name, decay, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, framework, None)
    with pytest.raises(ImportError, match=f"smpl.{framework} needs {name}: pip install {framework}"):
        getattr(smpl, framework).step(decay, [1.0, 0.0], [0.5])


def test_jax_step_of_a_linear_model_has_its_closed_form_and_derivatives(jax, decay):
    def first(x, u, k):
        return smpl.jax.step(decay, x, u, {"k": k})[0]

    given = jax.numpy.array([1.4, 0.0]), jax.numpy.array([0.5]), jax.numpy.array(K)
    value, by_x, by_u, by_k = decayed(1.4, 0.5)
    assert float(first(*given)) == pytest.approx(value, abs=1e-9)
    found = jax.jit(jax.grad(first, argnums=(0, 1, 2)))(*given)
    assert np.asarray(found[0]) == pytest.approx([by_x, 0.0], abs=1e-8)
    assert np.asarray(found[1]) == pytest.approx([by_u], abs=1e-8)
    assert float(found[2]) == pytest.approx(by_k, abs=1e-8)


@pytest.mark.parametrize("keep", [True, False])
def test_jax_derivatives_across_a_bounce_are_those_of_the_closed_form(jax, ball, keep):
    def step(x, u, e):
        return smpl.jax.step(ball, x, u, {"e": e}, keep=keep)

    given = jax.numpy.array([0.9, 1.0]), jax.numpy.array([-1.0]), jax.numpy.array(0.9)
    parts = jax.jacrev(step, argnums=(0, 1, 2))(*given)
    found = np.concatenate([np.asarray(parts[0]), np.asarray(parts[1]), np.asarray(parts[2])[:, None]], axis=1)
    assert found == pytest.approx(differences(bounced, [0.9, 1.0, -1.0, 0.9]), abs=1e-6)


def test_jax_maps_over_points_and_equals_single_points(jax, ball):
    x = jax.numpy.array([[1.0, 0.0], [0.5, -2.0], [0.9, 1.0]])
    u = jax.numpy.array([[0.0], [1.0], [-1.0]])
    mapped = jax.jit(jax.vmap(lambda x, u: smpl.jax.step(ball, x, u)))(x, u)
    assert np.array_equal(mapped, smpl.jax.step(ball, x, u))
    for i in range(3):
        assert np.array_equal(mapped[i], ball.step(np.asarray(x[i]), np.asarray(u[i])))
    gradient = jax.vmap(jax.grad(lambda x: smpl.jax.step(ball, x, u[1])[0]))(x)
    assert np.asarray(gradient) == pytest.approx(ball.sensitivity(np.asarray(x), np.asarray(u[1]))[1][:, 0], rel=1e-9)


@pytest.mark.parametrize("checkpoint", [False, True])
def test_jax_rollout_of_a_policy_has_the_gradient_of_the_closed_form(jax, decay, checkpoint):
    x = jax.numpy.array([1.4, 0.0])

    def total(gain):
        found = smpl.jax.rollout(decay, x, lambda x, t: gain * x[..., :1], steps=5, checkpoint=checkpoint)
        assert [part.shape for part in found] == [(6, 2), (5, 1), (5, 1), (5, 2)]
        return found.rewards.sum()

    e, through, _ = decayed(0, 0)[1:]
    factor = e - 0.6 * through
    value, gradient = jax.jit(jax.value_and_grad(total))(-0.6)
    assert float(value) == pytest.approx(1.4 * sum(factor**n for n in range(1, 6)), abs=1e-8)
    assert float(gradient) == pytest.approx(1.4 * through * sum(n * factor ** (n - 1) for n in range(1, 6)), abs=1e-7)


def test_jax_rollout_of_actions_agrees_with_differences(jax, ball):
    u = jax.numpy.array([[0.5], [-0.5], [0.2]])
    found = jax.grad(lambda u: smpl.jax.rollout(ball, jax.numpy.array([1.0, 0.0]), u).states[-1, 0])(u)

    def height(*pushes):
        state = [1.0, 0.0]
        for push in pushes:
            state = ball.step(state, [push])
        return state[0]

    assert np.asarray(found)[:, 0] == pytest.approx(differences(height, [0.5, -0.5, 0.2], 1e-5), rel=1e-5)


def test_jax_without_doubles_returns_single_precision(jax, decay):
    jax.config.update("jax_enable_x64", False)
    after = smpl.jax.step(decay, jax.numpy.array([1.4, 0.0]), jax.numpy.array([0.5]))
    assert after.dtype == jax.numpy.float32
    assert np.asarray(after) == pytest.approx([decayed(1.4, 0.5)[0], 0.5 * H], rel=1e-6)


@pytest.mark.parametrize("framework", ["torch", "jax"])
def test_a_step_that_fails_raises_its_message(request, framework):
    package = request.getfixturevalue(framework)
    text = "model Burst\ntime t : s\naction u = 1 in 0..9\nstate x = 1 in 0..1e9\neq d/dt x = u*x^2*1[1/s]\nobserve x\n"
    burst = smpl.compile(source=text + "reward r = x\nepisode { step = 2 [s], max_steps = 3 }\n")
    with pytest.raises(smpl.SimulationError if framework == "torch" else Exception, match="point 0"):
        as_array = package.tensor if framework == "torch" else package.numpy.array
        np.asarray(getattr(smpl, framework).step(burst, as_array([1.0]), as_array([1.0])))
