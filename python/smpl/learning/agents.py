"""Policies by names: `agent` makes one of a name, a file or an object."""

from __future__ import annotations

import hashlib
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from smpl.controllers.identity import AnonymousError, Description, identity, name_of
from smpl.envs import Env
from smpl.learning.names import named, names
from smpl.learning.policy_files import FILES, TRAINED, load_policy
from smpl.learning.saved import check_scaling, in_its_formulation, sidecars
from smpl.model import Model
from smpl.policies import Rows, acted, as_policy
from smpl.support.arguments import FloatArray


class Agent:
    """A controller or policy by its name.

    Args:
        name: what reports and data sets call it.
        chooser: a controller, a policy or a function, see `smpl.policies.as_policy`.
        physical: whether a function or policy gives physical units.
        version: changes when the controller does. With a version, a collection is continued with a
            controller of this class or qualified name whose constructor arguments are unknown, see
            `smpl.controllers.Recorded`.

    Raises:
        TypeError: `chooser` is of another kind.
    """

    def __init__(self, name: str, chooser: Any, physical: bool = False, version: str | int | None = None) -> None:
        self.name, self.chooser, self.physical, self.version = name, chooser, physical, version
        # Text and model that it was made from: in another process it is made anew, whatever it has
        # built meanwhile.
        self.origin: tuple[str, Model] | None = None
        self._trained: Path | None = None
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
        """True if `act` takes more than one row."""
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
        return acted(self.policy, rows, self.name)

    def check(self, env: Env) -> None:
        """Refuse an environment that the agent is not for: reset once as an episode would.

        Raises:
            ValueError: a policy has other observations or actions than the environment, or was
                trained with another scale, other bounds or another sampling interval.
        """
        self.policy.check(env)
        if self._trained is not None:
            check_scaling(self._trained, env)
        self.policy.reset(env, env.episode[0])


def agent(spec: Any, model: Model, name: str | None = None) -> Agent:
    """An agent of a name, a file or an object.

    Args:
        spec: a name of `names(model)`, `constant:26.85,0.1` (physical units), `module:attribute`,
            an `Agent`, a controller, a policy or a function. Or a path of a policy file: `.zip` of
            Stable-Baselines3 as `PPO:policy.zip`, `.d3` of d3rlpy, `.pt` of TorchScript, `.json`
            of a tuned predictive controller.
        model: of the environment that it is for.
        name: instead of the default one.

    Raises:
        ValueError: an unknown name; the message lists the valid ones.
        ImportError: a package is missing that the file or controller needs.
    """
    if isinstance(spec, Agent):
        return spec
    if not isinstance(spec, str):
        return Agent(name or type(spec).__name__, spec)
    if (labelled := re.match(r"([\w -]+)=(.+)", spec)) is not None:
        name, spec = name or labelled[1], labelled[2]
    file = Path(spec.rpartition(":")[2])
    is_file = file.suffix in FILES and spec not in names(model)
    chooser = load_policy(spec) if is_file else named(spec, model)
    trained = is_file and file.suffix in TRAINED
    made = Agent(name or _title(spec), in_its_formulation(chooser, file, model) if trained else chooser)
    made.origin = (spec, model)
    made._trained = file if trained else None
    return made


def _files(spec: str) -> dict[str, bytes]:
    """The file of a policy and its formulation for another machine; empty for others."""
    file = _policy_file(spec)
    if file is None:
        return {}
    beside = sidecars(file) if file.suffix in TRAINED else _header(file)
    return {one.name: one.read_bytes() for one in (file, *beside) if one.is_file()}


def _header(file: Path) -> tuple[Path, ...]:
    """The header of a policy in C."""
    return (file.with_suffix(".h"),) if file.suffix == ".c" else ()


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
