"""Contract of an exported policy, checked when it is loaded: plant, inputs, actions, units."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from smpl import _native
from smpl.envs import Env, Interface
from smpl.model import Model

FORMAT = 1


@dataclass(frozen=True)
class Signal:
    """An input or an action.

    Attributes:
        name, unit: as the model has them.
        low, high: bounds in the unit; inputs are not limited by theirs, actions are within them.
        source: `observation` or `state`, of an input; `action`.
    """

    name: str
    unit: str
    low: float
    high: float
    source: str


@dataclass(frozen=True)
class Contract:
    """Requirements of an exported policy on a plant.

    Attributes:
        controller: what was exported.
        model, hash: name of the model and digest of its files, variants and settings.
        level: observation level; scenario: empty for the default one.
        interval, time_unit: time between two calls.
        inputs, actions: in the order of the arrays.
        memory: number of values that are carried from call to call, zeros at the start of an
            episode.
        formulation: of the training, if there is one.
        version: of smpl.
    """

    controller: str
    model: str
    hash: str
    level: str
    scenario: str
    interval: float
    time_unit: str
    inputs: tuple[Signal, ...]
    actions: tuple[Signal, ...]
    memory: int
    formulation: Mapping[str, Any] | None = None
    version: str = _native.__version__

    def text(self) -> str:
        """JSON in one line; infinite bounds are null."""
        tree = {"smpl_policy": FORMAT, **asdict(self)}
        for one in (*tree["inputs"], *tree["actions"]):
            one.update({end: None if math.isinf(one[end]) else one[end] for end in ("low", "high")})
        return json.dumps(tree, default=str)

    @classmethod
    def of_text(cls, text: str, where: str) -> Contract:
        """The contract in JSON.

        Raises:
            ValueError: it is not one, or of a later format; the message names the file.
        """
        try:
            tree = json.loads(text)
            version = tree.pop("smpl_policy")
            if version != FORMAT:
                raise ValueError(f"format {version}, expected {FORMAT}")
            for key in ("inputs", "actions"):
                tree[key] = tuple(_signal(one) for one in tree[key])
            return cls(**tree)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise ValueError(f"{where} does not hold a policy exported by smpl: {error}") from error

    def check(self, env: Interface, where: str, *, any_model: bool = False) -> None:
        """Refuse an environment that is not the one of the contract.

        Args:
            env: the environment.
            where: name of the file, for the message.
            any_model: accept another version of the model with the same names, units and limits.

        Raises:
            ValueError: names what differs.
        """
        model = env.model
        if any(one.source == "observation" for one in self.inputs) and model.level != self.level:
            raise ValueError(
                f"{where} needs the observation level {self.level!r}, {model.name} shows {model.level!r}; "
                f"pass observation={self.level!r}"
            )
        for role in dict.fromkeys(one.source for one in (*self.inputs, *self.actions)):
            self._check_signals(env, role, where)
        if not math.isclose(model.step, self.interval, rel_tol=1e-12) or model.time_unit != self.time_unit:
            raise ValueError(
                f"{where} acts every {self.interval:g} {self.time_unit}, the sampling interval of {model.name} is "
                f"{float(model.step):g} {model.time_unit}"
            )
        if not any_model and model_hash(model) != self.hash:
            raise ValueError(
                f"{where} was exported for another version of {self.model} (hash {self.hash[:12]}, this one is "
                f"{model_hash(model)[:12]}); export it again, or pass any_model=True if the change does not matter"
            )

    def _check_signals(self, env: Interface, role: str, where: str) -> None:
        mine = [one for one in (*self.inputs, *self.actions) if one.source == role]
        names, units = getattr(env.model, f"{role}_names"), getattr(env.model, f"{role}_units")
        low, high = env.model.native.bounds(role)
        if role == "action" and tuple(one.name for one in mine) != tuple(names):
            raise ValueError(
                f"{where} gives the actions {', '.join(one.name for one in mine)}; {env.model.name} has "
                f"{', '.join(names)}"
            )
        for one in mine:
            if one.name not in names:
                raise ValueError(f"{where} needs the {role} {one.name!r}, which {env.model.name} does not have")
            at = names.index(one.name)
            if units[at] != one.unit:
                raise ValueError(
                    f"{where} has {one.name!r} in [{one.unit}], the {role} of {env.model.name} is in [{units[at]}]"
                )
            ends = float(low[at]), float(high[at])
            if role == "action" and (one.low < ends[0] or one.high > ends[1]):
                raise ValueError(
                    f"{where} gives {one.name!r} in {one.low:g}..{one.high:g}, the limits of {env.model.name} are "
                    f"{ends[0]:g}..{ends[1]:g}"
                )


def contract_of(
    controller: str, env: Env, inputs: list[tuple[str, int]], memory: int, formulation: Mapping[str, Any] | None = None
) -> Contract:
    """The contract of a controller of an environment; `inputs` are sources and positions."""
    model = env.model
    return Contract(
        controller,
        model.name,
        model_hash(model),
        model.level,
        "" if model._arguments["scenario"] is None else Path(str(model._arguments["scenario"])).name,
        float(model.step),
        model.time_unit,
        tuple(_of_model(model, source, at) for source, at in inputs),
        tuple(_of_model(model, "action", at) for at in range(len(model.action_names))),
        memory,
        formulation,
    )


def model_hash(model: Model) -> str:
    """SHA-256 of the files of model and scenario, variants, settings and further statements.

    Reward, observation level and the arguments of an environment do not enter it.
    """
    digest = hashlib.sha256()
    for source in model.native.sources:
        digest.update(Path(source).read_bytes() if Path(source).is_file() else b"")
    kept = {name: model._arguments.get(name) for name in ("source", "variants", "settings", "extra")}
    digest.update(json.dumps(kept, sort_keys=True, default=str).encode())
    return digest.hexdigest()


def _of_model(model: Model, source: str, at: int) -> Signal:
    low, high = model.native.bounds(source)
    names, units = getattr(model, f"{source}_names"), getattr(model, f"{source}_units")
    return Signal(names[at], units[at], float(low[at]), float(high[at]), source)


def _signal(one: Mapping[str, Any]) -> Signal:
    ends = {"low": -math.inf, "high": math.inf}
    given: dict[str, Any] = {name: ends.get(name) if value is None else value for name, value in one.items()}
    return Signal(**given)
