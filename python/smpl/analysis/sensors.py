"""Sensors of the observation levels of a model."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl import _native
from smpl.model import Model, scenario_file
from smpl.support.arguments import FloatArray, as_mapping, as_number
from smpl.support.names import listing

IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Sensors:
    """Sensors of an observation level, in the order of `observation_names`.

    A sample is taken at every step that is a multiple of `every` and read `delay` steps later; the reading is held in
    between. At the start all are read at once.

    Attributes:
        noise: standard deviations, physical units; 0 for an exact reading.
        every, delay: in steps.
        unused: numbers of sensors that an estimator leaves out.
    """

    noise: FloatArray
    every: IntArray
    delay: IntArray
    unused: frozenset[int] = frozenset()

    def arriving(self, step: int) -> dict[int, list[int]]:
        """Samples that are read for the first time at a step: step at which they were taken -> sensors."""
        if step == 0:
            return {0: [sensor for sensor in range(len(self.noise)) if sensor not in self.unused]}
        found: dict[int, list[int]] = {}
        for sensor, (every, delay) in enumerate(zip(self.every.tolist(), self.delay.tolist(), strict=True)):
            taken = step - delay
            if taken > 0 and taken % every == 0 and sensor not in self.unused:
                found.setdefault(taken, []).append(sensor)
        return found

    @property
    def longest(self) -> int:
        """The longest delay."""
        return int(self.delay.max(initial=0))


def sensors(model: Model, noise: Mapping[str, float] | None = None) -> Sensors:
    """Sensors of the model's observation level.

    Args:
        model: the model, compiled with that level.
        noise: standard deviations by name instead of the declared ones.

    Raises:
        ValueError: an unknown name, or a negative deviation.
    """
    arguments = dict(model._arguments)
    arguments["observation"] = model.level
    arguments["settings"] = tuple(arguments["settings"].items())
    declared = _declared(tuple(arguments.items()))
    by_name = {entry["name"]: entry for entry in declared}
    entries = [by_name[name] for name in model.observation_names]
    deviation = np.array([float(entry["noise"]) for entry in entries])
    for name, value in as_mapping("noise", noise).items():
        if name not in model.observation_names:
            known = listing(model.observation_names, model.observation_units)
            raise ValueError(f"noise: unknown {name!r}; the level {model.level!r} has: {known}")
        given = as_number(f"noise[{name!r}]", value)
        if not given >= 0:
            raise ValueError(f"noise[{name!r}] is {value!r}, expected a number that is not negative")
        deviation[model.observation_names.index(name)] = given
    return Sensors(
        deviation,
        np.array([max(1, int(entry["every"])) for entry in entries], dtype=np.int64),
        np.array([int(entry["delay"]) for entry in entries], dtype=np.int64),
    )


@lru_cache(maxsize=16)
def _declared(arguments: tuple[tuple[str, Any], ...]) -> list[dict[str, Any]]:
    """The list `observations` that `smpl compile --emit json` writes for these arguments of `smpl.compile`."""
    given = dict(arguments)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        path = given["path"]
        if path is None:
            path = str(folder / "model.eq")
            Path(path).write_text(given["source"], encoding="utf-8")
        # The command knows levels by scenarios alone.
        scenario, out = folder / "level.yaml", folder / "model.json"
        file = scenario_file(given["path"], given["scenario"])
        lines = [] if file is None else file.read_text(encoding="utf-8").splitlines()
        kept = [line for line in lines if not line.startswith("observation:")]
        scenario.write_text("\n".join([*kept, f"observation: {given['observation']}", ""]), encoding="utf-8")
        command = ["smpl", "compile", path, "--emit", "json", "-o", str(out), "--scenario", str(scenario)]
        for variant in given["variants"]:
            command += ["--variant", variant]
        for name, value in given["settings"]:
            command += ["--set", f"{name}={value}"]
        if given.get("extra") is not None:
            command += ["--extra", given["extra"]]
        if _native.main(command) != 0:
            raise ValueError(f"the sensors of {path} could not be read")
        found: list[dict[str, Any]] = json.loads(out.read_text(encoding="utf-8"))["observations"]
    return found
