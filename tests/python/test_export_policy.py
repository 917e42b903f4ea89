"""Exported controllers and policies give the actions of the originals, and refuse plants that are not theirs."""

import json
import shutil
import subprocess
import types
import zipfile

import numpy as np
import pytest

import smpl
from smpl.controllers import LQR, NMPC, PID, Constant, Loops, OpenLoop
from smpl.deploy import Contract, export_policy, load_artefact
from smpl.learning.agents import agent
from smpl.learning.formulation import FormulatedPolicy, Formulation

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")


@pytest.fixture(scope="module")
def reactor():
    return smpl.compile("reactor")


def targets(*names):
    """Formats, those without their package skipped by its name."""
    return [
        pytest.param(
            name,
            marks=pytest.mark.skipif(
                name == "onnx" and not (has("onnx") and has("onnxruntime")),
                reason="onnx and onnxruntime are not installed",
            ),
        )
        for name in names
    ]


def has(package):
    try:
        __import__(package)
    except ImportError:
        return False
    return True


def largest_difference(env, original, exported, episodes=3, steps=40):
    """Largest difference of the actions along episodes that the original drives."""
    original, worst = agent(original, env.model), 0.0
    for seed in range(episodes):
        observation, _ = env.reset(seed=seed)
        original.check(env)
        exported.reset(env)
        for step in range(steps):
            rows = smpl.policies.Rows(env, observation[None], env.state[None], np.array([step]), [{}])
            action = original.policy.act(rows)[0]
            physical = action if original.policy.physical else env.to_physical(action)
            worst = max(worst, np.abs(physical - exported.action(env)).max())
            observation, _, terminated, truncated, _ = env.step(env.from_physical(physical))
            if terminated or truncated:
                break
    return worst


def loops(model):
    return Loops(
        PID("T", "T_c", 2.0, 0.5, 0.1, set_point=lambda t: 51.0 + t, anti_windup="clamping"),
        PID("h", "q_out", 0.5, 2.0, set_point=0.66, form="velocity", bumpless=True),
    )


CONTROLLERS = {
    "lqr": lambda model: "lqr",
    "lqr_with_integrals": lambda model: LQR(model, integral=["T", "h"]),
    "proportional": lambda model: "pid",
    "constant": lambda model: Constant([26.0, 0.11]),
    "recorded": lambda model: OpenLoop([[26.0, 0.1], [27.0, 0.11], [28.0, 0.09]], hold=True),
    "nominal": lambda model: "nominal",
}
LOOPS = {
    "pid": lambda model: PID("T", "T_c", 2.0, 0.5, 0.1, set_point=52.0),
    "pid_bumpless": lambda model: PID("T", "T_c", 2.0, set_point=52.0, bumpless=True, set_point_weight=0.5),
    "velocity": lambda model: PID("T", "T_c", 2.0, 0.5, 0.2, form="velocity", set_point_weight=0.7),
    "loops": loops,
}


@pytest.mark.parametrize("target", targets("c", "onnx"))
@pytest.mark.parametrize("name", CONTROLLERS)
def test_exported_controllers_give_the_actions_of_the_originals(tmp_path, reactor, name, target):
    controller = CONTROLLERS[name](reactor)
    file = export_policy(controller, reactor, target, tmp_path / f"policy.{target}")
    env = smpl.Env(reactor)
    assert largest_difference(env, controller, load_artefact(file, env)) < 1e-12


@pytest.mark.filterwarnings("ignore:the gains? ")
@pytest.mark.parametrize("name", LOOPS)
def test_exported_loops_give_the_actions_of_the_originals(tmp_path, reactor, name):
    controller = LOOPS[name](reactor)
    file = export_policy(controller, reactor, "c", tmp_path / "policy.c")
    env = smpl.Env(reactor)
    assert largest_difference(env, controller, load_artefact(file, env)) < 1e-11


@pytest.mark.parametrize("name", ["lqr_with_integrals", "recorded", "loops"])
def test_the_c_compiles_without_warnings(tmp_path, reactor, name):
    file = export_policy((CONTROLLERS | LOOPS)[name](reactor), reactor, "c", tmp_path / "policy.c")
    flags = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Wno-overlength-strings", "-O2", "-c", "-o", "/dev/null"]
    done = subprocess.run(["cc", *flags, str(file)], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert "malloc" not in file.read_text()


def test_the_header_states_units_limits_level_and_model(tmp_path, reactor):
    export_policy("lqr", reactor, "c", tmp_path / "policy.c")
    text = (tmp_path / "policy.h").read_text()
    assert f'#define POLICY_MODEL_HASH "{smpl.deploy.model_hash(reactor)}"' in text
    assert "observation level default" in text
    assert "0: T_c [degC], 15 to 35 (action)" in text
    assert "1: T [degC]" in text and "(state)" in text


@pytest.mark.parametrize("target", targets("c", "onnx"))
def test_recipes_of_models_export_as_tables(tmp_path, target):
    env = smpl.Env("pensim")
    file = export_policy("nominal", env.model, target, tmp_path / f"policy.{target}")
    assert largest_difference(env, "nominal", load_artefact(file, env), 1, 30) == 0
    beer = smpl.Env("beer")
    file = export_policy("profile", beer.model, target, tmp_path / f"profile.{target}")
    assert largest_difference(beer, "profile", load_artefact(file, beer), 1, 60) == 0


@pytest.mark.parametrize("target", targets("c", "onnx"))
def test_a_table_without_hold_ends(tmp_path, reactor, target):
    file = export_policy(OpenLoop([[26.0, 0.1]] * 2), reactor, target, tmp_path / f"policy.{target}")
    found = load_artefact(file)
    assert found.act(np.empty(0)).tolist() == found.act(np.empty(0)).tolist() == [26.0, 0.1]
    with pytest.raises(ValueError, match="the table of actions has ended"):
        found.act(np.empty(0))


@pytest.mark.parametrize("target", targets("c", "onnx"))
def test_inputs_that_are_not_finite_are_refused(tmp_path, reactor, target):
    found = load_artefact(export_policy("lqr", reactor, target, tmp_path / f"policy.{target}"))
    with pytest.raises(ValueError, match="an input is not finite"):
        found.act(np.array([0.88, np.nan, 0.66]))


# Networks: modules with the names of PyTorch's, so that no package is needed; NumPy has their values.


class Tensor:
    def __init__(self, values):
        self.values = np.asarray(values, dtype=np.float32)

    def detach(self):
        return self

    cpu = detach

    def numpy(self):
        return self.values


class Linear:
    def __init__(self, generator, inputs, outputs):
        self.weight = Tensor(generator.normal(0, 0.6, (outputs, inputs)))
        self.bias = Tensor(generator.normal(0, 0.3, outputs))

    def __call__(self, x):
        return x @ self.weight.values.T + self.bias.values


class Tanh:
    def __call__(self, x):
        return np.tanh(x)


class ReLU:
    def __call__(self, x):
        return np.maximum(x, 0)


class ELU:
    alpha = 0.7

    def __call__(self, x):
        return np.where(x > 0, x, 0.7 * np.expm1(x)).astype(np.float32)


class LeakyReLU:
    negative_slope = 0.2

    def __call__(self, x):
        return np.where(x > 0, x, 0.2 * x).astype(np.float32)


class Sigmoid:
    def __call__(self, x):
        return (1 / (1 + np.exp(-x))).astype(np.float32)


class Sequential:
    def __init__(self, *parts):
        self.parts = parts

    def children(self):
        return self.parts

    def named_modules(self):
        return ()

    def __call__(self, x):
        for part in self.parts:
            x = part(x)
        return x


class Dreamy:
    def __call__(self, x):
        return x


def network(inputs, outputs, hidden=Tanh, last=Tanh, seed=0):
    generator = np.random.default_rng(seed)
    parts = [
        Linear(generator, inputs, 16),
        hidden(),
        Linear(generator, 16, 16),
        hidden(),
        Linear(generator, 16, outputs),
    ]
    return Sequential(*parts, *([last()] if last else []))


class Acting:
    """A policy of Stable-Baselines3 by its attributes."""

    def __init__(self, net, kind="ppo"):
        self.net = net
        parts = net.parts
        if kind == "ppo":
            self.policy = types.SimpleNamespace(
                mlp_extractor=types.SimpleNamespace(policy_net=Sequential(*parts[:-1])), action_net=parts[-1]
            )
        elif kind == "sac":
            actor = types.SimpleNamespace(latent_pi=Sequential(*parts[:-2]), mu=parts[-2])
            self.policy = types.SimpleNamespace(actor=actor)
        else:
            self.policy = types.SimpleNamespace(actor=types.SimpleNamespace(mu=net))

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        return np.clip(self.net(np.asarray(observation, dtype=np.float32)), -1, 1), state


@pytest.mark.parametrize("target", targets("c", "onnx"))
@pytest.mark.parametrize("kind", ["ppo", "sac", "td3"])
@pytest.mark.parametrize("hidden", [Tanh, ReLU, ELU, LeakyReLU, Sigmoid])
def test_networks_of_stable_baselines_give_their_actions(tmp_path, reactor, kind, hidden, target):
    policy = Acting(network(3, 2, hidden, None if kind == "ppo" else Tanh), kind)
    env = smpl.Env(reactor)
    file = export_policy(policy, env, target, tmp_path / f"policy.{target}")
    scale = env.action_high - env.action_low
    assert largest_difference(env, policy, load_artefact(file, env)) < 2e-6 * scale.max()


@pytest.mark.parametrize("target", targets("c", "onnx"))
def test_networks_around_the_nominal_action_give_their_actions(tmp_path, reactor, target):
    policy, env = Acting(network(3, 2), "td3"), smpl.Env(reactor, normalize="nominal")
    file = export_policy(policy, env, target, tmp_path / f"policy.{target}")
    scale = env.action_high - env.action_low
    assert largest_difference(env, policy, load_artefact(file, env)) < 2e-6 * scale.max()


@pytest.mark.parametrize("target", targets("c", "onnx"))
@pytest.mark.parametrize(
    "formulation",
    [
        Formulation(centre="nominal", reach=0.3, windows={"T": (48.0, 55.0)}),
        Formulation(history=3, left=("q_out",), centre="nominal"),
        Formulation(limits={"T_c": (22.0, 30.0)}, centre="constant:25.0,0.1"),
    ],
)
def test_a_formulation_is_inside_of_the_exported_policy(tmp_path, reactor, formulation, target):
    net = network(3 * formulation.history, 2 - len(formulation.left))
    policy = FormulatedPolicy(Acting(net, "td3"), formulation)
    env = smpl.Env(reactor)
    file = export_policy(policy, env, target, tmp_path / f"policy.{target}")
    found = load_artefact(file, env)
    assert found.contract.formulation["reach"] == formulation.reach
    original, worst = agent(policy, env.model), 0.0
    for seed in range(2):
        observation, _ = env.reset(seed=seed)
        original.check(env)
        found.reset(env)
        memory = {}
        for step in range(30):
            rows = smpl.policies.Rows(env, observation[None], env.state[None], np.array([step]), [memory])
            physical = env.to_physical(original.policy.act(rows)[0])
            worst = max(worst, np.abs(physical - found.action(env)).max())
            observation, _, terminated, truncated, _ = env.step(env.from_physical(physical))
            if terminated or truncated:
                break
    assert worst < 3e-5


@pytest.mark.parametrize(
    ("policy", "says"),
    [
        (Acting(Sequential(Linear(np.random.default_rng(0), 3, 2), Dreamy()), "td3"), "a module Dreamy"),
        (Acting(network(4, 2), "td3"), "maps 4 numbers to 2; Reactor .* needs 3 to 2"),
        (FormulatedPolicy(Acting(network(3, 2), "td3"), Formulation(centre="pid")), "the centre 'pid'"),
        (lambda observation: np.zeros(2), "function cannot be exported"),
    ],
)
def test_policies_that_cannot_be_exported_are_refused_by_name(tmp_path, reactor, policy, says):
    with pytest.raises(ValueError, match=says):
        export_policy(policy, reactor, "c", tmp_path / "policy.c")


def test_controllers_that_optimise_are_refused_by_name(tmp_path, reactor):
    pytest.importorskip("casadi", reason="CasADi is not installed")
    with pytest.raises(ValueError, match="NMPC cannot be exported"):
        export_policy(NMPC(reactor, 5), reactor, "c", tmp_path / "policy.c")


def test_wrong_targets_and_names_of_files_are_refused(tmp_path, reactor):
    with pytest.raises(ValueError, match="target is 'pdf'; there are: c, onnx, fmu"):
        export_policy("lqr", reactor, "pdf", tmp_path / "policy.pdf")
    with pytest.raises(ValueError, match=r"expected a file that ends in \.c"):
        export_policy("lqr", reactor, "c", tmp_path / "policy.txt")
    with pytest.raises(ValueError, match="the name becomes a prefix in C"):
        export_policy("lqr", reactor, "c", tmp_path / "1-policy.c")


# The contract.


@pytest.fixture(scope="module")
def exported(tmp_path_factory, reactor):
    return export_policy(PID("T", "T_c", 2.0, 0.5), reactor, "c", tmp_path_factory.mktemp("contract") / "policy.c")


TANK = """model Tank
time t : min
action T_c : degC = 26.85 in {low}..{high}
action {second} : m^3/min = 0.1 in 0.05..0.2
state T : {unit} = 50 in 0..100
eq d/dt T = 0 [{unit}/min]
observe {seen}
reward r = 1
episode {{ step = {step} [min], max_steps = 10 }}
"""


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"second": "q_in"}, "gives the actions T_c, q_out; Tank has T_c, q_in"),
        ({"high": "30"}, r"gives 'T_c' in 15\.\.35, the limits of Tank are 15\.\.30"),
        ({"unit": "K"}, r"has 'T' in \[degC\], the observation of Tank is in \[K\]"),
        ({"seen": "T_c"}, "needs the observation 'T', which Tank does not have"),
        ({"step": "0.2"}, "acts every 0.1 min, the sampling interval of Tank is 0.2 min"),
        ({}, "was exported for another version of Reactor"),
    ],
)
def test_a_plant_that_does_not_fit_is_refused_by_what_differs(exported, reactor, changes, says):
    given = {"second": "q_out", "high": "35", "low": "15", "unit": "degC", "seen": "T", "step": float(reactor.step)}
    given |= changes
    text = TANK.format(**given)
    if given["unit"] == "degC":
        text = text.replace("0 [degC/min]", "0 [K/min]")
    env = smpl.Env(smpl.compile(source=text))
    with pytest.raises(ValueError, match=says):
        load_artefact(exported, env)


def test_another_level_and_another_version_are_refused_unless_allowed(exported, reactor):
    with pytest.raises(ValueError, match="needs the observation level 'default', Reactor shows 'full'"):
        load_artefact(exported, smpl.Env(reactor, observation="full"))
    other = smpl.Env("reactor", settings={"U": 60.0})
    with pytest.raises(ValueError, match="another version of Reactor"):
        load_artefact(exported, other)
    assert load_artefact(exported, other, any_model=True).contract.model == "Reactor"
    assert load_artefact(exported, smpl.Env("reactor", reward=reactor.reward_names[-1], normalize=False))


def test_files_that_are_not_exported_policies_are_refused(tmp_path):
    (tmp_path / "plain.c").write_text("int f(void) { return 0; }\n")
    (tmp_path / "plain.h").write_text("")
    with pytest.raises(ValueError, match=r"plain\.c does not hold a policy exported by smpl"):
        load_artefact(tmp_path / "plain.c")
    with pytest.raises(ValueError, match="is not there"):
        load_artefact(tmp_path / "other.c")
    with pytest.raises(ValueError, match="expected a file that ends in"):
        load_artefact(tmp_path / "other.txt")
    with pytest.raises(ValueError, match="does not hold a policy"):
        Contract.of_text('{"smpl_policy": 99}', "x.c")


def test_the_command_exports_and_evaluation_takes_the_file(tmp_path, capsys):
    from smpl.commands.main import main
    from smpl.evaluate import main as evaluate

    file = tmp_path / "lqr.c"
    assert main(["export-policy", "lqr", "--env", "smpl/Reactor-v0", "--to", "c", "-o", str(file)]) == 0
    out = str(tmp_path / "out")
    done = ["reactor", "--controller", "lqr", "--policy", str(file), "--episodes", "2", "--quiet", "--out", out]
    assert evaluate(done) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())["controllers"]
    assert report["lqr"]["returns"] == pytest.approx(report["lqr 2"]["returns"], rel=1e-9)
    assert main(["export-policy", "none", "--env", "reactor", "--to", "c", "-o", str(file)]) == 1
    assert "controller is 'none'" in capsys.readouterr().err


def test_the_fmu_holds_description_sources_and_contract(tmp_path, reactor):
    file = export_policy("lqr", reactor, "fmu", tmp_path / "lqr.fmu")
    with zipfile.ZipFile(file) as archive:
        names = set(archive.namelist())
        description = archive.read("modelDescription.xml").decode()
        contract = json.loads(archive.read("resources/contract.json"))
    assert {"sources/lqr.c", "sources/lqr.h", "sources/fmi3.c", "sources/buildDescription.xml"} <= names
    assert 'unit="degC" min="15.0" max="35.0"' in description
    assert contract["hash"] == smpl.deploy.model_hash(reactor)
    env = smpl.Env(reactor)
    assert largest_difference(env, "lqr", load_artefact(file, env)) < 1e-12


def test_the_fmu_closes_the_loop_in_fmpy(tmp_path, reactor):
    fmpy = pytest.importorskip("fmpy", reason="fmpy is not installed")
    from fmpy.fmi3 import FMU3Slave
    from fmpy.validation import validate_fmu

    file = export_policy("lqr", reactor, "fmu", tmp_path / "lqr.fmu")
    assert validate_fmu(str(file)) == []
    description = fmpy.read_model_description(str(file))
    reference = {one.name: one.valueReference for one in description.modelVariables}
    unit = FMU3Slave(
        guid=description.guid, unzipDirectory=fmpy.extract(str(file)), modelIdentifier="lqr", instanceName="tested"
    )
    env, regulator = smpl.Env(reactor), LQR(reactor)
    env.reset(seed=1)
    regulator.reset(env)
    unit.instantiate()
    unit.enterInitializationMode()
    inputs = [reference[name] for name in reactor.state_names]
    unit.setFloat64(inputs, env.state.tolist())
    unit.exitInitializationMode()
    for step in range(5):
        unit.setFloat64(inputs, env.state.tolist())
        action = unit.getFloat64([reference[name] for name in reactor.action_names])
        assert action == pytest.approx(regulator.action(env).tolist(), abs=1e-12)
        env.step(env.from_physical(np.array(action)))
        unit.doStep(step * float(reactor.step), float(reactor.step))
    unit.terminate()
    unit.freeInstance()


@pytest.mark.parametrize("target", targets("c", "onnx"))
def test_a_trained_policy_of_stable_baselines_exports_from_its_file(tmp_path, target):
    sb3 = pytest.importorskip("stable_baselines3", reason="Stable-Baselines3 is not installed")
    env = smpl.Env("reactor")
    for kind in ("PPO", "SAC", "TD3"):
        model = getattr(sb3, kind)("MlpPolicy", env, seed=1)
        model.save(tmp_path / f"{kind}.zip")
        spec = f"{kind}:{tmp_path / f'{kind}.zip'}"
        file = export_policy(spec, "reactor", target, tmp_path / f"{kind}.{target}")
        assert largest_difference(env, spec, load_artefact(file, env), 2, 20) < 1e-5
