"""Files of policies with the formulation that they were trained in, see `save_policy`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from smpl.envs import Env, Interface
from smpl.learning.environments import Formulated, FormulatedVectorEnv
from smpl.learning.formulation import FILE, Form, FormulatedPolicy, Formulation, LearnedBox, names_of
from smpl.learning.policy_files import TRAINED
from smpl.model import Model
from smpl.support.scaling import NOMINAL
from smpl.vector import VectorEnv


def save_policy(policy: Any, path: str | Path, env: Any) -> Path:
    """Writes a trained policy and the formulation of its training, which `--policy` uses.

    The policy is written by its own `save`. `NAME.formulation.json` next to it gets the
    formulation, and of the environment the names of observations and actions, their scaling and the
    sampling interval.

    Args:
        policy: of Stable-Baselines3 (`.zip`), of d3rlpy (`.d3`), or a TorchScript module (`.pt`).
        path: of the file; its ending is that of the kind of policy.
        env: the environment of the training, in its wrappers: `Formulated`, `FormulatedVectorEnv`,
            `SB3VecEnv`, a vector environment of Stable-Baselines3 over them, or an environment
            without a formulation.

    Returns:
        The path of the policy file.

    Raises:
        TypeError: a policy that cannot be saved, or an environment that is not one of smpl.
        ValueError: another ending, or a wrapper that changes observations or actions, which the
            file would not have.

    Example:
        save_policy(model, "ppo.zip", batch)  # python -m smpl.evaluate reactor --policy PPO:ppo.zip
    """
    file = Path(path)
    if file.suffix not in TRAINED:
        raise ValueError(f"path is {str(path)!r}, expected a file that ends in {', '.join(TRAINED)}")
    if not callable(getattr(policy, "save", None)):
        raise TypeError(f"policy is {type(policy).__name__}, expected an object with save")
    form, interface = _beneath(env)
    formulation = Formulation() if form is None else form.formulation
    policy.save(str(file))
    known = {**asdict(formulation), "environment": names_of(interface), "scaling": _scaling(interface)}
    text = json.dumps(known, indent=1)
    _sidecar(file).write_text(text + "\n", encoding="utf-8")
    return file


def _scaling(interface: Interface) -> dict[str, Any]:
    """Scale and bounds of the numbers that a policy meets, and the sampling interval."""
    bounds = ("action_low", "action_high", "observation_low", "observation_high")
    nominal = {"action_nominal": interface.model.action_nominal.tolist()} if interface.normalize == NOMINAL else {}
    given = {name: getattr(interface, name).tolist() for name in bounds}
    return {"normalize": interface.normalize, **given, **nominal, "step": float(interface.model.step)}


def check_scaling(file: Path, env: Interface) -> None:
    """Refuse an environment in which the numbers of a saved policy have another meaning.

    Raises:
        ValueError: another `normalize`, other bounds or another sampling interval than in training.
    """
    written = next((_read(one) for one in sidecars(file) if one.is_file()), None)
    if written is None or not written[2]:
        return
    formulation, names, trained = written
    here, where = _scaling(env), f"{env.model.name} (level {env.model.level!r})"
    plain = formulation.shapes_rewards_only
    scale, other = (one["normalize"] if plain else bool(one["normalize"]) for one in (trained, here))
    if scale != other:
        raise ValueError(
            f"the policy {file} was trained with normalize={scale!r}, {where} has normalize={other!r}: "
            f"evaluate it with normalize={scale!r} (--normalize {str(scale).lower()})"
        )
    if trained["step"] != here["step"]:
        steps, unit = trained["step"], env.model.time_unit
        raise ValueError(
            f"the policy {file} was trained with steps of {steps:g} {unit}, {where} has {here['step']:g} {unit}"
        )
    for key in sorted(set(trained) & set(here) - {"normalize", "step"}) if scale else ():
        for name, one, now in zip(names[f"{key.partition('_')[0]}s"], trained[key], here[key], strict=True):
            if one != now:
                raise ValueError(
                    f"the policy {file} was trained with {key}[{name!r}] = {one:g}, {where} has {now:g}: its scaled "
                    "numbers have another meaning there"
                )


def _beneath(env: Any) -> tuple[Form | None, Interface]:
    """The formulation of a wrapped environment, if any, and the environment of smpl."""
    for one in _layers(env):
        if isinstance(one, FormulatedVectorEnv):
            return one.form, one
        if isinstance(one, Formulated):
            return one.form, one.form.interface
        if isinstance(one, (Env, VectorEnv)):
            return None, one
    raise TypeError(f"env is {type(env).__name__}, expected an environment of smpl")


def _layers(env: Any) -> Iterator[Any]:
    """An environment and those that it wraps, from the outside.

    Raises:
        ValueError: a wrapper changes what the policy sees or does.
    """
    while env is not None:
        yield env
        inner = getattr(env, "env", None) or getattr(env, "venv", None) or next(iter(getattr(env, "envs", ())), None)
        if hasattr(env, "obs_rms") or (inner is not None and _spaces(env) != _spaces(inner)):
            raise ValueError(
                f"the wrapper {type(env).__name__} changes observations or actions, which the file of a policy does "
                "not keep: use a formulation for that, or save the policy and the wrapper yourself"
            )
        env = inner


def _spaces(env: Any) -> tuple[Any, Any]:
    """Observation and action space of one environment."""
    observations = getattr(env, "single_observation_space", None) or env.observation_space
    return observations, getattr(env, "single_action_space", None) or env.action_space


def _sidecar(file: Path) -> Path:
    return file.with_suffix(f".{FILE}")


def sidecars(file: Path) -> tuple[Path, Path]:
    """Files that may hold the formulation of a policy: its own, then that of the folder."""
    return _sidecar(file), file.with_name(FILE)


def in_its_formulation(policy: Any, file: Path, model: Model) -> Any:
    """A policy of a file in the formulation that it was trained in, if one is known.

    Raises:
        ValueError: a damaged file, another one than the policy itself states, or observations and
            actions that are not those of the model.
    """
    space = getattr(policy, "action_space", None)
    own = (space.formulation, space.names) if isinstance(space, LearnedBox) else None
    written = next((_read(one) for one in sidecars(file) if one.is_file()), None)
    if own is None and written is None:
        return policy
    formulation, names, _ = written or (Formulation.of(own[0]), own[1], {})  # type: ignore[index]
    if own is not None and Formulation.of(own[0]) != formulation:
        raise ValueError(
            f"{file} was trained in another formulation than the one that is next to it: remove "
            f"{' or '.join(str(one) for one in sidecars(file) if one.is_file())}, or save the policy anew by "
            "smpl.learning.save_policy"
        )
    _check_names(file, names, model)
    return policy if formulation.shapes_rewards_only else FormulatedPolicy(policy, formulation)


def _read(path: Path) -> tuple[Formulation, Mapping[str, Any], Mapping[str, Any]]:
    """The formulation of a file, the names that it states, and the scaling."""
    try:
        given = json.loads(path.read_text(encoding="utf-8"))
        names = dict(given.pop("environment", {}))
        scaling = dict(given.pop("scaling", {}))
        return Formulation.of(given), names, scaling
    except (ValueError, TypeError, AttributeError) as error:
        raise ValueError(f"{path} is not a formulation: {error}") from error


def _check_names(file: Path, names: Mapping[str, Any], model: Model) -> None:
    here = names_of(model)
    for what, known in names.items():
        if list(known) != here.get(what):
            raise ValueError(
                f"the policy {file} was trained on the {what} {', '.join(known)}; {model.name} (level "
                f"{model.level!r}) has {', '.join(here.get(what, []))}: evaluate it on its own model and level"
            )
