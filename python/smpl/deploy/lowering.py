"""Control laws of controllers and policies, in the forms that can be exported."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from smpl.controllers import LQR, PID, Constant, Nominal, OpenLoop, Policy, Profile, Proportional
from smpl.controllers import Loops as PIDLoops
from smpl.controllers.beer import profile_temperature
from smpl.controllers.names import action_index, operating_action
from smpl.controllers.reactor import SET_POINT, STATES, STEADY_ACTION
from smpl.deploy.laws import Law, Layer, Linear, Loop, Loops, Network, Table
from smpl.deploy.networks import network_of
from smpl.envs import Env
from smpl.learning.formulation import Form, FormulatedPolicy
from smpl.policies import Rows
from smpl.support.arguments import FloatArray
from smpl.support.scaling import NOMINAL

# Starts that are tried for the longest course of a recipe.
_SEEDS = 5


def law_of(chooser: Any, env: Env) -> Law:
    """The law of a controller or policy that was reset with `env`.

    Raises:
        ValueError: it cannot be exported; the message says why.
    """
    known = _LAWS.get(type(chooser))
    if known is not None:
        return known(chooser, env)
    form = None
    if isinstance(chooser, FormulatedPolicy):
        form, chooser = chooser._laid_over(env), chooser._policy
    found = network_of(chooser)
    if found is None:
        names = ", ".join(kind.__name__ for kind in _LAWS)
        raise ValueError(
            f"{type(chooser).__name__} cannot be exported; laws with a fixed amount of arithmetic can: {names}, and "
            "networks of linear layers of Stable-Baselines3 or TorchScript"
        )
    return _network(found, env, form)


def _constant(chooser: Constant, env: Env) -> Law:
    return Table(np.atleast_2d(chooser.action(env)))


def _open_loop(chooser: OpenLoop, env: Env) -> Law:
    return Table(np.array(chooser._actions), chooser._hold)


def _nominal(chooser: Nominal, env: Env) -> Law:
    if "nominal" in env.model.policies:
        return _recipe("nominal", env)
    return Table(env.model.native.defaults("action")[None])


def _policy(chooser: Policy, env: Env) -> Law:
    return _recipe(chooser._name, env)


def _recipe(name: str, env: Env) -> Law:
    """A policy of the model that is a function of the step alone."""
    model = env.model
    if not model.native.is_recipe(name):
        raise ValueError(
            f"the policy {name!r} of {model.name} reads more than the step, so it is not a table; it runs where the "
            "model does: export the model (`smpl export`)"
        )
    own = Env(model, normalize=False)
    courses: list[list[FloatArray]] = []
    for seed in range(_SEEDS):
        own.reset(seed=seed)
        course, ended = [], False
        while not ended:
            course.append(own.policy(name))
            _, _, terminated, truncated, _ = own.step(course[-1])
            ended = terminated or truncated
        courses.append(course)
    longest = max(courses, key=len)
    return Table(np.array(longest), hold=False)


def _profile(chooser: Profile, env: Env) -> Law:
    return Table(np.array([[profile_temperature(step)] for step in range(env.max_steps)]))


def _proportional(chooser: Proportional, env: Env) -> Law:
    inputs = [("state", env.state_names.index(name)) for name in (STATES[0], STATES[2])]
    return _feedback(inputs, -np.diag(chooser._gains), SET_POINT[[0, 2]], STEADY_ACTION, env)


def _lqr(chooser: LQR, env: Env) -> Law:
    n = len(chooser.state)
    inputs = [("state", i) for i in range(n)]
    errors = len(chooser._integral)
    law = _feedback(inputs, chooser.gain[:, :n], chooser.state, chooser.action_at_rest, env)
    rows = np.array([row for row, _, _ in chooser._integral]).reshape(errors, n)
    through = np.array([one for _, one, _ in chooser._integral]).reshape(errors, len(law.rest))
    return Linear(law.inputs, law.gain, law.state, law.rest, law.low, law.high, chooser.gain[:, n:], rows, through)


def _feedback(
    inputs: Iterable[tuple[str, int]], gain: FloatArray, state: FloatArray, rest: FloatArray, env: Env
) -> Linear:
    """Linear feedback without summed errors."""
    count = len(rest)
    nothing = np.zeros((count, 0)), np.zeros((0, len(state))), np.zeros((0, count))
    return Linear(tuple(inputs), gain, state, rest, env.action_low, env.action_high, *nothing)


def _pid(chooser: PID, env: Env) -> Law:
    return _loops([chooser], operating_action(env), env)


def _pid_loops(chooser: PIDLoops, env: Env) -> Law:
    base = operating_action(env)
    for name, value in chooser._others.items():
        base[action_index(env.model, name)] = value
    return _loops(list(chooser._loops), base, env)


def _loops(given: list[Any], base: FloatArray, env: Env) -> Law:
    inputs: list[tuple[str, int]] = []
    loops = []
    for one in given:
        if type(one) is not PID:
            raise ValueError(f"{type(one).__name__} cannot be exported; its loops can one by one")
        assert one._measured is not None
        source = "state" if one._measured.of_state else "observation", one._measured.index
        if source not in inputs:
            inputs.append(source)
        loops.append(
            Loop(
                inputs.index(source), one._index, one.gain, one.integral_time, one.derivative_time, one.filter,
                one.set_point_weight, one._tracking_time() if math.isfinite(one.integral_time) else 1.0,
                float(one.interval), one.low, one.high, float(one._base[one._index]), one.form == "velocity",
                one.anti_windup == "clamping", one.anti_windup == "back_calculation", one.bumpless,
                _set_points(one, env),
            )
        )  # fmt: skip
    return Loops(tuple(inputs), base, tuple(loops))


def _set_points(loop: PID, env: Env) -> FloatArray:
    """The set-point of each step, one for all of a constant."""
    if not callable(loop.set_point):
        return np.array([loop._goal(env)])
    times = env.time + np.arange(env.max_steps) * float(env.model.step)
    return np.array([float(loop.set_point(time)) for time in times])


def _network(layers: tuple[Layer, ...], env: Env, form: Form | None) -> Law:
    """A network between the scaled observations and actions of an environment or formulation."""
    n, m = len(env.observation_names), len(env.action_names)
    clip_low, clip_high = env.observation_low, env.observation_high
    scaled = np.isfinite(clip_low) & np.isfinite(clip_high) & (clip_high > clip_low) & bool(env.normalize)
    low, high = np.where(scaled, clip_low, np.nan), np.where(scaled, clip_high, np.nan)
    windows, history, learned = np.zeros(n, dtype=np.bool_), 1, np.arange(m)
    space: Any = env.action_space
    physical = not env.normalize and form is None
    a_low, a_high, reach = env.action_low, env.action_high, 1.0
    centre = env.model.action_nominal if env.normalize == NOMINAL else (a_low + a_high) / 2
    formulation = None
    if form is not None:
        name = form.formulation.centre
        if name not in ("box", "nominal") and not name.startswith("constant:"):
            raise ValueError(
                f"the policy corrects the centre {name!r} of its formulation, which cannot be exported; box, nominal "
                "and constant:... can"
            )
        formulation, history, learned = asdict(form.formulation), form.formulation.history, form.learned
        windows[form._windowed] = True
        low[form._windowed], high[form._windowed] = form._window
        a_low, a_high, reach = form.low, form.high, form.formulation.reach
        centre = np.clip(form._centre(_row(env)), a_low, a_high)[0]
    bounded = np.isfinite(a_low) & np.isfinite(a_high)
    middle = centre.copy()
    middle[learned] = np.where(bounded, centre, 0.0)[learned]
    down = np.where(bounded, (middle - a_low) * reach, 1.0)[learned]
    up = np.where(bounded, (a_high - middle) * reach, 1.0)[learned]
    ends = (space.low, space.high) if physical else (np.full(len(learned), -1.0), np.full(len(learned), 1.0))
    _check_sizes(layers, n * history, len(learned), env)
    return Network(
        tuple(("observation", i) for i in range(n)), low, high, clip_low, clip_high, windows, layers,
        ends[0].astype(np.float32), ends[1].astype(np.float32), tuple(int(one) for one in learned), middle, down, up,
        history, physical, formulation,
    )  # fmt: skip


def _row(env: Env) -> Any:
    return Rows(env, np.asarray(env._returned)[None], env.state[None], np.array([0]), [{}])


def _check_sizes(layers: tuple[Layer, ...], inputs: int, outputs: int, env: Env) -> None:
    sizes = [layers[0].weight.shape[1], *(one.weight.shape[0] for one in layers)]
    for before, layer in zip(sizes, layers, strict=False):
        if layer.weight.shape[1] != before:
            raise ValueError(f"the network has a layer of {layer.weight.shape[1]} inputs after one of {before} outputs")
    if sizes[0] != inputs or sizes[-1] != outputs:
        raise ValueError(
            f"the network maps {sizes[0]} numbers to {sizes[-1]}; {env.model.name} (level {env.model.level!r}) needs "
            f"{inputs} to {outputs}"
        )


_LAWS: dict[type, Callable[[Any, Env], Law]] = {
    Constant: _constant,
    OpenLoop: _open_loop,
    Nominal: _nominal,
    Policy: _policy,
    Profile: _profile,
    Proportional: _proportional,
    LQR: _lqr,
    PID: _pid,
    PIDLoops: _pid_loops,
}
