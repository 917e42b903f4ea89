"""Signals, forks and other threads while the compiled module works."""

import os
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import smpl

# An oscillator that takes minutes a step, and a chain that takes seconds to compile.
SLOW = """model Slow
time t : s
action a : 1 = 0 in -1..1
state x : 1 = 1
state y : 1 = 0
eq d/dt x = y / (1 [s])
eq d/dt y = (a - 100*x) / (1 [s])
observe x in -2..2
reward r = x
episode { step = 1e7 [s], max_steps = 3 }
solver { max_steps = 2000000000 }
"""
LARGE = "\n".join(
    [
        "model Large",
        "time t : s",
        "action a : 1 = 0 in -1..1",
        *(f"state x{i} : 1 = 1\neq d/dt x{i} = (a - x{i}*exp(-x{i * 13 % 40000})) / (1 [s])" for i in range(40000)),
        "observe x0 in 0..1",
        "reward r = x0",
        "episode { step = 1 [s], max_steps = 3 }",
    ]
)
# A sum of three million terms and no steady state, since it is positive.
RESTLESS = """model Restless
time t : s
action a : 1 = 0 in -1..1
state x : 1 = 1
eq d/dt x = (sum(sum(exp(-sq(x - i*1e-9 - j*1e-5)) for i in 1..3000) for j in 1..1000) + 1) / (1 [s])
observe x in -2..2
reward r = x
episode { step = 1 [s], max_steps = 3 }
"""

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="signals and forks of POSIX")


class Stop(Exception):
    """Exception of the handler of the signal."""


@pytest.fixture
def stopping():
    """Runs a call that takes long, sends a signal after half a second, and returns how long it then went on."""

    def handler(number, frame):
        raise Stop

    before = signal.signal(signal.SIGUSR1, handler)

    def run(call):
        sent = []

        def send():
            sent.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGUSR1)

        timer = threading.Timer(0.5, send)
        timer.start()
        with pytest.raises(Stop):
            call()
        late = time.monotonic() - sent[0]
        timer.join()
        return late

    yield run
    signal.signal(signal.SIGUSR1, before)


def test_a_long_step_ends_with_a_signal_and_can_be_taken_again(stopping):
    env = smpl.Env(smpl.compile(source=SLOW), normalize=False)
    env.reset(seed=0)
    # Without a look at signals it would be a minute and more.
    assert stopping(lambda: env.step([0.5])) < 3
    np.testing.assert_array_equal(env.state, [1.0, 0.0])
    assert (env.steps, env.time) == (0, 0.0)
    assert stopping(lambda: env.step([0.5])) < 3


@pytest.mark.parametrize("threads", [1, 2])
def test_a_long_step_of_a_batch_ends_with_a_signal_and_wants_a_reset(stopping, threads):
    env = smpl.VectorEnv(smpl.compile(source=SLOW), 3, normalize=False, num_threads=threads)
    actions = np.zeros((3, 1))
    # The first step shows that others are worth threads.
    for _ in range(2):
        env.reset(seed=0)
        assert stopping(lambda: env.step(actions)) < 3
        with pytest.raises(smpl.SimulationError, match="reset"):
            env.step(actions)


def test_a_long_compilation_ends_with_a_signal(stopping):
    assert stopping(lambda: smpl.compile(source=LARGE)) < 3


def test_a_long_search_for_a_steady_state_ends_with_a_signal(stopping):
    model = smpl.compile(source=RESTLESS)
    assert stopping(lambda: model.steady_state([0.0])) < 3


def test_the_command_ends_with_a_signal(tmp_path):
    path = tmp_path / "slow.eq"
    path.write_text(SLOW)
    process = subprocess.Popen([sys.executable, "-m", "smpl", "simulate", str(path)], stderr=subprocess.DEVNULL)
    time.sleep(2)
    assert process.poll() is None
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=20) == -signal.SIGINT


def test_a_child_of_a_fork_steps_on_its_own_threads():
    env = smpl.VectorEnv("pensim", 6, num_threads=2, normalize=False)
    env.reset(seed=1)
    actions = np.tile(env.model.native.defaults("action"), (6, 1))
    for _ in range(5):
        env.step(actions)
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        # Nothing of pytest may run in the child.
        os.write(writer, env.step(actions)[0].tobytes())
        os._exit(0)
    os.close(writer)
    guard = threading.Timer(30, os.kill, (child, signal.SIGKILL))
    guard.start()
    with os.fdopen(reader, "rb") as pipe:
        theirs = pipe.read()
    guard.cancel()
    os.waitpid(child, 0)
    assert theirs == env.step(actions)[0].tobytes()


def test_a_batch_does_not_see_what_other_threads_write_into_its_actions():
    model = smpl.compile(source=SLOW.replace("1e7 [s], max_steps = 3", "20 [s], max_steps = 100"))
    env, quiet = (smpl.VectorEnv(model, 16, normalize=False, num_threads=1) for _ in range(2))
    env.reset(seed=0)
    quiet.reset(seed=0)
    actions, busy = np.zeros((16, 1)), threading.Event()

    def scribble():
        busy.wait()
        for _ in range(100):
            actions[:] = 1.0
            time.sleep(1e-4)

    writer = threading.Thread(target=scribble)
    writer.start()
    interval = sys.getswitchinterval()
    sys.setswitchinterval(10)  # no other thread runs before the step releases the lock
    try:
        busy.set()
        observations = env._native.step(actions)[0]
    finally:
        sys.setswitchinterval(interval)
        writer.join()
    assert actions.all()
    np.testing.assert_array_equal(observations, quiet.step(np.zeros((16, 1)))[0])
