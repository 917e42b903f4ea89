"""Policies by names: `agent` makes one of a name, a file or an object."""

from __future__ import annotations

import hashlib
import importlib
import re
import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import smpl.controllers as controllers
from smpl._arguments import FloatArray
from smpl.controllers.identity import AnonymousError, Description, identity, name_of
from smpl.envs import Env
from smpl.model import Model
from smpl.policies import FILES, Rows, as_policy, load_policy


class Agent:
    """A controller or policy by its name.

    Args:
        name: what reports and data sets call it.
        chooser: a controller, a policy or a function, see `smpl.policies.as_policy`.
        physical: whether a function or policy gives physical units.
        version: changes when the controller does. With a version, a collection is continued with a controller of this
            class or qualified name whose constructor arguments are unknown, see `smpl.controllers.Recorded`.

    Raises:
        TypeError: `chooser` is none of these.
    """

    def __init__(self, name: str, chooser: Any, physical: bool = False, version: str | int | None = None) -> None:
        self.name, self.chooser, self.physical, self.version = name, chooser, physical, version
        # Text and model that it was made from: in another process it is made anew, whatever it has built meanwhile.
        self.origin: tuple[str, Model] | None = None
        self.policy = as_policy(chooser)
        if physical:
            self.policy.physical = True

    def __reduce__(self) -> tuple[Any, ...]:
        state = {"batched": self.batched}
        if self.origin is not None:
            files = _files(self.origin[0])
            made = (_unpacked, (*self.origin, self.name, files)) if files else (agent, (*self.origin, self.name))
            return (*made, state)
        return Agent, (self.name, self.chooser, self.physical, self.version), state

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        # A policy that was found to draw its actions acts alone in other processes too.
        if self.batched and not state["batched"]:
            self.policy.batched = False

    @property
    def batched(self) -> bool:
        """Whether `act` takes more than one row."""
        return self.policy.batched

    @property
    def needs(self) -> str:
        """Source of the actions, see `smpl.policies.Policy`."""
        return self.policy.needs

    def act(self, rows: Rows) -> FloatArray:
        """Actions of the rows in the action space.

        Raises:
            ValueError: they have another shape.
        """
        given, expected = self.policy.act(rows), (len(rows.steps), len(rows.interface.action_names))
        if given.shape != expected:
            raise ValueError(f"{self.name} gave actions of shape {given.shape}, expected {expected}")
        return rows.interface.from_physical(given) if self.policy.physical else given

    def check(self, env: Env) -> None:
        """Refuse an environment that the agent is not for: reset once as an episode would.

        Raises:
            ValueError: a policy has other observations or actions than the environment.
        """
        self.policy.check(env)
        self.policy.reset(env, env.episode[0])


def agent(spec: Any, model: Model, name: str | None = None) -> Agent:
    """An agent of a name, a file or an object.

    Args:
        spec: a name of `names(model)`; `constant:26.85,0.1` (physical units); `module:attribute`; a path of a policy
            file (`.zip` of Stable-Baselines3 as `PPO:policy.zip`, `.d3` of d3rlpy, `.pt` of TorchScript); an `Agent`;
            a controller, a policy or a function.
        model: of the environment that it is for.
        name: in place of the one that it would have.

    Raises:
        ValueError: a name that nobody has; the message lists the right ones.
        ImportError: a package is missing that the file or controller needs.
    """
    if isinstance(spec, Agent):
        return spec
    if not isinstance(spec, str):
        return Agent(name or type(spec).__name__, spec)
    if (named := re.match(r"([\w -]+)=(.+)", spec)) is not None:
        name, spec = name or named[1], named[2]
    made = Agent(name or _title(spec), _made(spec, model))
    made.origin = (spec, model)
    return made


def _files(spec: str) -> dict[str, bytes]:
    """The file of a policy and its formulation, for a machine that has them not; nothing for anything else."""
    file = _policy_file(spec)
    if file is None:
        return {}
    from smpl.learning.saved import sidecars

    return {one.name: one.read_bytes() for one in (file, *sidecars(file)) if one.is_file()}


def _unpacked(spec: str, model: Model, name: str, files: Mapping[str, bytes]) -> Agent:
    """The agent of a policy whose files came along."""
    prefix, colon, file = spec.rpartition(":")
    with tempfile.TemporaryDirectory() as place:
        for one, content in files.items():
            (Path(place) / one).write_bytes(content)
        return agent(f"{prefix}{colon}{Path(place) / Path(file).name}", model, name)


def described(one: Agent) -> Description:
    """Identity of a controller: results are not continued with another one.

    Raises:
        AnonymousError: it cannot be compared, see `smpl.controllers.identity`.
    """
    spec = "" if one.origin is None else one.origin[0]
    if _policy_file(spec) is not None:
        return {"": name_of(one.chooser), "file": hashlib.sha256(b"".join(_files(spec).values())).hexdigest()}
    physical = {"physical": "True"} if one.physical else {}
    version = {} if one.version is None else {"version": str(one.version)}
    try:
        return {**identity(one.chooser), **physical, **version}
    except AnonymousError:
        if spec or version:  # `MODULE:NAME` says what it is
            return {"": spec or name_of(one.chooser), **physical, **version}
        raise


def _policy_file(spec: str) -> Path | None:
    """The path of a policy file; None for another text."""
    file = Path(spec.rpartition(":")[2])
    return file if file.suffix in FILES and file.is_file() else None


def _title(spec: str) -> str:
    """Name of a policy file without its folder and ending; of anything else the text itself."""
    file = Path(spec.rpartition(":")[2])
    return file.stem if file.suffix in FILES else spec


def _made(spec: str, model: Model) -> Any:
    known = _known(model)
    if spec in known:
        return known[spec]()
    if spec.startswith("constant:"):
        return controllers.Constant(_numbers(spec))
    if Path(spec.rpartition(":")[2]).suffix in FILES:
        from smpl.learning.saved import in_its_formulation

        return in_its_formulation(load_policy(spec), Path(spec.rpartition(":")[2]), model)
    if ":" in spec:
        return _imported(spec)
    later = _baseline(model, spec)
    if later is not None:
        return later
    raise ValueError(
        f"controller is {spec!r}; {model.name} has: {', '.join(names(model))}; "
        "others: constant:NUMBER,..., MODULE:ATTRIBUTE, PPO:FILE.zip, FILE.d3, FILE.pt"
    )


def names(model: Model) -> tuple[str, ...]:
    """Names of the controllers for a model."""
    listed: Any = getattr(controllers, "baselines", None)
    try:
        more = listed(model.name) if listed is not None else ()
    except ValueError:  # a model that is not shipped has none
        more = ()
    return tuple(dict.fromkeys((*_known(model), *more)))


def _known(model: Model) -> dict[str, Callable[[], Any]]:
    """Controllers by name: those of every model, the baselines of this one, and the policies that it declares."""
    known: dict[str, Callable[[], Any]] = {"nominal": controllers.Nominal, "random": controllers.Uniform}
    if model.action_names == ("T_c", "q_out"):
        known |= {"pid": controllers.Proportional, "mpc": _reactor_mpc}
    if model.action_names == ("T",) and "S" in model.state_names:
        known |= {"profile": controllers.Profile, "isothermal": controllers.isothermal}
    for policy in model.policies:
        known.setdefault(policy, partial(controllers.Policy, policy))
    return known


def _reactor_mpc() -> Any:
    from smpl.controllers.reactor import ReactorNMPC

    return ReactorNMPC()


def _baseline(model: Model, name: str) -> Any:
    """What `smpl.controllers.baseline` has under a name, none if it has not."""
    baseline = getattr(controllers, "baseline", None)
    if baseline is None:
        return None
    try:
        return baseline(model.name, name)
    except (ValueError, KeyError):
        return None


def _imported(spec: str) -> Any:
    module, _, attribute = spec.partition(":")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"controller {spec!r} is not there: {error}") from error
    return found() if isinstance(found, type) else found


def _numbers(spec: str) -> list[float]:
    try:
        return [float(number) for number in spec.partition(":")[2].split(",")]
    except ValueError as error:
        raise ValueError(f"controller is {spec!r}, expected constant:NUMBER,NUMBER,...") from error
