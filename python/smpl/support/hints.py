"""Names of other packages, and frequent wrong names, answered by those of smpl."""

from __future__ import annotations

import difflib
import inspect
from collections.abc import Iterable
from typing import Any, NoReturn

_ENVIRONMENT = {
    "action_mode": "give normalize, or a formulation of smpl.learning.environments.Formulated",
    "disturbances": "give a scenario, or reset(options={'disturbances': ...})",
    "dt": "give settings={'step': ...}",
    "frame": "give observation, the name of a level",
    "horizon": "give max_steps",
    "initial_state": "use reset(options={'state': ...})",
    "level": "give observation, the name of a level",
    "max_episode_steps": "give max_steps",
    "noise": "give observation, the name of a level with noise, or a scenario",
    "obs": "give observation, the name of a level",
    "observation_level": "give observation, the name of a level",
    "options": "use reset(options=...)",
    "parameters": "give settings, or reset(options={'parameters': ...})",
    "params": "give settings, or reset(options={'parameters': ...})",
    "seed": "use reset(seed=...)",
    "time_limit": "give max_steps",
}
_PREDICTIVE = {
    "N": "give horizon",
    "P": "give terminal, weights by name",
    "Q": "give cost, weights by name",
    "R": "give rate_weight, or cost with names of actions",
    "dt": "give settings={'step': ...} to smpl.compile",
    "lterm": "give cost",
    "mterm": "give terminal",
    "rterm": "give rate_weight",
    **dict.fromkeys(("u_max", "u_min", "umax", "umin"), "bounds of actions are those of the model"),
}
_ESTIMATOR = {
    "P": "give deviation, standard deviations by name",
    "P0": "give deviation, standard deviations by name",
    "P_v": "give noise, standard deviations by name",
    "P_w": "give process_noise, standard deviations by name",
    "P_x": "give deviation, standard deviations by name",
    "Q": "give process_noise, standard deviations by name",
    "R": "give noise, standard deviations by name",
    "n_horizon": "give horizon",
    "t_step": "give settings={'step': ...} to smpl.compile",
    "x0": "give initial",
}
_FIT = {
    "bounds": "bounds are those of the model: declare `in low..high`",
    "p0": "give parameters={NAME: guess}",
    "params": "give parameters",
    "sigma": "give noise, standard deviations by name",
    "theta": "give parameters",
    "weights": "give noise, standard deviations by name",
    "x0": "give parameters={NAME: guess}",
}
_EVALUATION = {
    "deterministic": "policies act deterministically",
    "n_episodes": "give episodes",
    "n_eval_episodes": "give episodes",
    "num_episodes": "give episodes",
}
_TRAJECTORY = {
    "params": "give parameters by name: parameters={NAME: value}, or p in derivatives",
    "x0": "give the states first",
}
# Names of do-mpc by class, with what does the same here.
DO_MPC: dict[str, dict[str, str]] = {
    "NMPC": {
        "n_horizon": "horizon",
        "t_step": "the model's sampling interval (`settings={'step': ...}` of smpl.compile)",
        "n_robust": "not available: robust horizons are not implemented",
        "set_objective": "the arguments cost, terminal and set_point",
        "set_rterm": "the argument rate_weight, per squared unit of the action (do-mpc's counts scaled actions)",
        "set_nl_cons": "a `constraint` of the model, or the argument bounds",
        "set_param": "the arguments of smpl.controllers.NMPC",
        "set_tvp_fun": "the argument forecast",
        "set_p_fun": "the argument p",
        "set_initial_guess": "reset(env); further guesses by the argument starts",
        "setup": "reset(env)",
        "make_step": "action(env)",
        "u0": "action(env)",
        "x0": "the state of the environment, or of the argument estimator",
        "bounds_lower": "bounds",
        "collocation_deg": "degree",
        "collocation_ni": "elements",
        "state_discretization": "nodes",
        "nlpsol_opts": "solver, iterations and tolerance",
        "store_full_solution": "plan and predicted",
    },
}
# Arguments by function or class.
ARGUMENTS: dict[str, dict[str, str]] = {
    "Env": _ENVIRONMENT,
    "VectorEnv": {**_ENVIRONMENT, "n_envs": "give num_envs", "n_threads": "give num_threads"},
    "compile": _ENVIRONMENT,
    "NMPC": _PREDICTIVE,
    "SamplingMPC": {
        "N": "give horizon",
        "lambda_": "give temperature",
        "n_horizon": "give horizon",
        "n_samples": "give samples",
        "num_samples": "give samples",
        "sigma": "give deviation, by name of an action",
    },
    "ExtendedKalmanFilter": _ESTIMATOR,
    "MovingHorizonEstimator": _ESTIMATOR,
    "PID": {
        "K": "give gain",
        "Kd": "give derivative_time, which is Kd/Kp",
        "Ki": "give integral_time, which is Kp/Ki",
        "Kp": "give gain",
        "Td": "give derivative_time",
        "Ti": "give integral_time",
        "dt": "a loop acts at each sampling instant of the model",
        "kp": "give gain",
        "output_limits": "give low and high",
        "sp": "give set_point",
        "tau_d": "give derivative_time",
        "tau_i": "give integral_time",
        "ti": "give integral_time",
    },
    "LQR": {
        "N": "cross weights are not available; give output_weight for weights of outputs",
        "Q": "give state_weight, by name",
        "R": "give action_weight, by name",
        "dt": "the interval is that of the model; discrete=False is the continuous regulator",
    },
    "fit": _FIT,
    "information": _FIT,
    "design": {
        **_FIT,
        "bounds": "give limits={NAME: (low, high)} for actions",
        "level": "compile the model with observation=...",
        "n_steps": "give steps",
    },
    "evaluate": _EVALUATION,
    "rollout": _TRAJECTORY,
    "sensitivity": {**_TRAJECTORY, "params": "give parameters, names for derivatives, or p, values by name"},
    "linearize_step": {**_TRAJECTORY, "params": "give parameters, names for derivatives, or p, values by name"},
    "gradient": {**_TRAJECTORY, "params": "give parameters, names for derivatives, or p, values by name"},
    "steady_state": {"x0": "give guess={NAME: value}", "params": "give p={NAME: value}"},
    "step": {"params": "give p={NAME: value}", "t": "give first_step, the number of the step"},
    "formulation": {
        "action_mode": "give centre and reach",
        "excluded": "give left, the names of actions that the centre keeps",
        "frame_stack": "give history",
        "left_out": "give left, the names of actions that the centre keeps",
        "n_stack": "give history",
        "residual_of": "give centre",
        "scale": "give reach for actions, reward_scale for rewards",
    },
}
# Attributes by class or module.
ATTRIBUTES: dict[str, dict[str, str]] = {
    "Model": {
        "action_space": "smpl.Env(model).action_space, or action_low and action_high",
        "actions": "action_names",
        "dt": "sampling_interval",
        "inputs": "action_names",
        "jac": "jacobian(t, y, yp, u)",
        "n_actions": "len(model.action_names)",
        "n_states": "len(model.state_names)",
        "observation_space": "smpl.Env(model).observation_space, or observation_low and observation_high",
        "outputs": "observation_names, or algebraic_names",
        "p": "parameters",
        "reset": "smpl.Env(model).reset",
        "rewards": "reward_names",
        "simulate": "rollout(states, actions), or smpl.Env(model)",
        "states": "state_names",
        "step_size": "sampling_interval",
        "time_step": "sampling_interval",
        "u": "action_names; action_nominal has values",
        "x": "state_names",
    },
    "Env": {
        "action_nominal": "model.action_nominal",
        "dt": "model.sampling_interval",
        "get_state": "snapshot()",
        "horizon": "max_steps",
        "num_envs": "smpl.VectorEnv for several environments",
        "obs": "reading, in physical units",
        "observation": "reading, in physical units",
        "seed": "reset(seed=...)",
        "set_state": "restore(snapshot), or reset(options={'state': ...})",
        "state_dict": "snapshot()",
        "states": "state",
        "units": "state_units, action_units, observation_units",
        "x0": "state, after reset",
    },
    "VectorEnv": {
        "env_is_wrapped": "smpl.sb3.SB3VecEnv(batch) for Stable-Baselines3",
        "envs": "the arrays of the batch; it has no single environments",
        "step_async": "smpl.sb3.SB3VecEnv(batch) for Stable-Baselines3",
    },
    "ExtendedKalmanFilter": {
        "P": "covariance",
        "Q": "the argument process_noise",
        "R": "the argument noise",
        "make_step": "update(env)",
        "predict": "update(env), which predicts and corrects",
        "state": "estimate, by name",
        "x": "estimate, by name",
        "x_hat": "estimate, by name",
    },
    "NMPC": {
        "bounds": "the argument bounds",
        "opt_x": "plan and predicted",
        "settings": "the arguments of NMPC",
        "solve": "action(env)",
    },
    "MovingHorizonEstimator": {
        "make_step": "update(env)",
        "state": "estimate, by name",
        "x": "estimate, by name",
        "x0": "the argument initial",
    },
    "smpl.controllers": {
        "CEM": "SamplingMPC(method='cem')",
        "ConstantPolicy": "Constant",
        "EKF": "ExtendedKalmanFilter",
        "KalmanFilter": "ExtendedKalmanFilter",
        "MHE": "MovingHorizonEstimator",
        "MPC": "NMPC or SamplingMPC",
        "MPPI": "SamplingMPC(method='mppi')",
        "NominalPolicy": "Nominal",
        "PIDController": "PID",
        "Random": "Uniform",
        "RandomController": "Uniform",
        "RandomPolicy": "Uniform",
        "Recipe": "OpenLoop, or Policy(NAME) for a policy of the model",
        "ResidualPolicy": "the key centre of smpl.learning.environments.Formulated",
        "UKF": "ExtendedKalmanFilter or MovingHorizonEstimator",
        "UniformPolicy": "Uniform",
        "ZeroPolicy": "Constant or Nominal",
    },
    "smpl": {
        "Environment": "Env",
        "MPC": "controllers.NMPC or controllers.SamplingMPC",
        "RandomPolicy": "controllers.Uniform",
        "Simulator": "Env, or Model.rollout",
        "collect": "datasets.collect",
        "compile_model": "compile",
        "design": "analysis.design.design",
        "evaluate": "evaluation.evaluate",
        "identification": "fit, analysis.information and analysis.design",
        "information": "analysis.information.information",
        "load": "compile",
        "load_model": "compile",
        "make": "Env, or gymnasium.make",
        "register": "gymnasium.register",
    },
}


def of_argument(who: str, name: str, names: Iterable[str]) -> str:
    """Advice for an unknown argument: the name of smpl, or a similar one; empty without any."""
    known = list(names)
    return _of_do_mpc(who, name) or ARGUMENTS.get(who, {}).get(name) or _similar(name, known)


def of_attribute(owner: str, name: str, names: Iterable[str] = ()) -> str:
    """Advice for an unknown attribute: the name of smpl, or a similar one; empty without any."""
    if name.startswith("_"):
        return ""
    found = ATTRIBUTES.get(owner, {}).get(name)
    return _of_do_mpc(owner, name) or (f"use {found}" if found else _similar(name, names))


def _of_do_mpc(owner: str, name: str) -> str:
    other = DO_MPC.get(owner, {}).get(name)
    return f"do-mpc's {name} is {other}" if other else ""


def _similar(name: str, names: Iterable[str]) -> str:
    known = [one for one in names if not one.startswith("_")]
    close = difflib.get_close_matches(name, known, 1, 0.75)
    return f"did you mean {close[0]!r}?" if close else ""


def refuse_attribute(owner: object, name: str) -> NoReturn:
    """Raise the error of an attribute that an object does not have.

    Args:
        owner: the object.
        name: of the attribute.

    Raises:
        AttributeError: with the name of smpl, if another one is known.
    """
    own = inspect.getattr_static(type(owner), name, None)
    if isinstance(own, property) and own.fget is not None:
        own.fget(owner)  # the property raised an AttributeError: raise that one
    kinds: list[Any] = [one for one in type(owner).__mro__ if one.__name__ in ATTRIBUTES]
    kind = kinds[0].__name__ if kinds else ""
    advice = of_attribute(kind, name, dir(type(owner)))
    text = f"{type(owner).__name__!r} object has no attribute {name!r}{advice and f'; {advice}'}"
    raise AttributeError(text, name=name, obj=owner)
