"""The kernel of many instances, compiled as C, steps as the environment does; NVRTC compiles the same text."""

import ctypes
import shutil
from pathlib import Path

import numpy as np
import pytest

import smpl
import smpl.cuda

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler `cc`")

MODELS = Path(__file__).resolve().parents[2] / "models"
# Events, phases, tables, implicit rates, projected and solved unknowns, many cells.
GALLERY = [
    "boiler_drum",
    "chylla_haase",
    "distillation",
    "first_order",
    "glucose_insulin",
    "lithium_ion",
    "recycle_cascade",
    "xylene_bed",
]
PLANTS = ["reactor", "beer", "pensim", *(f"gallery/{name}" for name in GALLERY)]


def inputs(env, rng):
    """An action near the nominal one as an environment takes it, and in physical units."""
    model = env.model
    low, high = model.action_low, model.action_high
    width = np.where(np.isfinite(high - low), high - low, 0.0)
    normalised = env.from_physical(
        np.clip(model.action_nominal + 0.1 * width * rng.uniform(-1, 1, len(low)), low, high)
    )
    return normalised, env.to_physical(normalised)


@pytest.mark.parametrize("name", PLANTS)
def test_a_kernel_steps_as_the_environment(name):
    """Both integrate at the tolerance of the model, with steps of different lengths."""
    model = smpl.compile(str(MODELS / f"{name}.eq"))
    constant = {e["name"]: e["nominal"] for e in smpl.export.json(model)["elements"]["disturbances"]}
    env = smpl.Env(model, method="rosenbrock")
    env.reset(seed=0, options={"start": "nominal", "disturbances": constant, "hold_disturbances": True})
    batch = smpl.cuda.Batch(model, 2, device="cpu")
    batch.reset(parameters=constant)
    rng = np.random.default_rng(0)
    scale = np.abs(env.state)
    for _ in range(5):
        normalised, action = inputs(env, rng)
        _, reward, terminated, _, _ = env.step(normalised)
        _, rewards, ended = batch.step(np.tile(action, (2, 1)))
        assert (ended == terminated).all()
        if terminated:
            break
        scale = np.maximum(scale, np.abs(env.state))
        found = batch.unknowns[:, : len(env.state)]
        assert (np.abs(found - env.state) <= 2e-6 * scale + 1e-12).all()
        assert (found[0] == found[1]).all()
        if rewards.shape[1] == 1:
            assert rewards[0, 0] == pytest.approx(reward, rel=1e-4, abs=1e-6)


def test_instances_have_states_parameters_and_ends_of_their_own(tmp_path):
    """Decay from x = 1 and x = 2 with two rates, against exp(-k t); x < 0.2 ends an instance where it is."""
    path = tmp_path / "decay.eq"
    path.write_text(
        'model Decay "x decays"\ntime t : s\nparam k : 1/s = 1 in 0..10 "rate"\nstate x = 1 in 0..3 "amount"\n'
        "action u = 0 in -1..1\neq d/dt x = -k*x + 0*u*k\nfail low event x < 0.2\nreward size = x\nobserve x\n"
        "episode { step = 0.5 [s], max_steps = 20 }\n"
    )
    batch = smpl.cuda.Batch(smpl.compile(path), 3, device="cpu")
    batch.reset(states={"x": [1.0, 2.0, 1.0]}, parameters={"k": [1.0, 1.0, 4.0]})
    _, rewards, ended = batch.step(batch.nominal)
    assert ended.tolist() == [False, False, True]
    assert batch.unknowns[:2, 0] == pytest.approx([np.exp(-0.5), 2 * np.exp(-0.5)], rel=1e-6)
    assert batch.unknowns[2, 0] == pytest.approx(0.2, rel=1e-9)
    assert rewards[0, 0] == pytest.approx(np.exp(-0.5), rel=1e-6)
    batch.step(batch.nominal)
    assert batch.unknowns[2, 0] == pytest.approx(0.2, rel=1e-9)
    batch.reset([False, False, True])
    assert batch.status.tolist() == [0, 0, 0]
    assert batch.unknowns[:, 0] == pytest.approx([np.exp(-1), 2 * np.exp(-1), 1.0], rel=1e-6)


def test_bad_arguments_are_refused_by_name():
    model = smpl.compile("reactor")
    with pytest.raises(ValueError, match="device must be `cuda` or `cpu`"):
        smpl.cuda.Batch(model, 2, device="tpu")
    with pytest.raises(ValueError, match="count must be positive"):
        smpl.cuda.Batch(model, 0, device="cpu")
    batch = smpl.cuda.Batch(model, 2, device="cpu")
    with pytest.raises(KeyError, match="states have no element `y`"):
        batch.reset(states={"y": 1.0})
    with pytest.raises(ValueError, match=r"actions must have the shape \(2, 2\)"):
        batch.step([[0.0, 0.0]])
    with pytest.raises(ValueError, match="history must be positive, not 0"):
        smpl.cuda.Batch(model, 2, device="cpu", history=0)


def test_a_gpu_without_cupy_is_refused_by_name(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "cupy", None)
    with pytest.raises(ImportError, match="cupy"):
        smpl.cuda.Batch(smpl.compile("reactor"), 2)


def nvrtc():
    """The library of the package `nvidia-cuda-nvrtc-cu12`, which compiles without a GPU."""
    pytest.importorskip("nvidia.cuda_nvrtc", reason="nvidia-cuda-nvrtc is not installed")
    import nvidia.cuda_nvrtc

    folder = Path(next(iter(nvidia.cuda_nvrtc.__path__))) / "lib"
    return ctypes.CDLL(str(next(folder.glob("libnvrtc.so.*"))))


LATE = """
model Late
time t : s
state x = 1 in -9..9
action u = 0 in -1..1
eq d/dt x = (u - delay(x, min(max(1 [s] + 0.1*t, 0.5 [s]), 2 [s]), before = sin(t / 1 [s]))) / 1 [s]
observe x
episode { step = 1 [s], max_steps = 5 }
"""


@pytest.mark.parametrize("name", ["reactor", "beer", "gallery/boiler_drum", "a dead time"])
def test_nvrtc_compiles_the_text(name):
    library = nvrtc()
    model = smpl.compile(source=LATE) if name == "a dead time" else smpl.compile(str(MODELS / f"{name}.eq"))
    source = smpl.export.text(model, "kernel")["c"]
    program = ctypes.c_void_p()
    assert library.nvrtcCreateProgram(ctypes.byref(program), source.encode(), b"kernel.cu", 0, None, None) == 0
    options = [b"--gpu-architecture=compute_75", b"--device-as-default-execution-space", b"--fmad=false"]
    result = library.nvrtcCompileProgram(program, len(options), (ctypes.c_char_p * len(options))(*options))
    length = ctypes.c_size_t()
    library.nvrtcGetProgramLogSize(program, ctypes.byref(length))
    log = ctypes.create_string_buffer(length.value)
    library.nvrtcGetProgramLog(program, log)
    assert result == 0, log.value.decode()
