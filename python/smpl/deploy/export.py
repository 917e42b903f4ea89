"""Export of controllers and policies to C, ONNX and FMI 3."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from smpl.deploy import c, fmu, onnx
from smpl.deploy.contract import Contract, contract_of
from smpl.deploy.laws import Law, Network
from smpl.deploy.lowering import law_of
from smpl.learning.agents import agent
from smpl.learning.plan import Task


def export_policy(policy: Any, env: Any, target: str, path: str | Path, **arguments: Any) -> Path:
    """Write a controller or policy as a program for another system.

    The file has one function from inputs to actions, both in physical units. It contains scaling,
    limits, the formulation of the training, and a contract with names, units, limits and a hash of
    the model.

    Args:
        policy: a controller or policy; or a name or file as `python -m smpl.evaluate` takes them
            (`lqr`, `pid`, `PPO:policy.zip`).
        env: id, name or path of a model, a compiled model, or an `smpl.Env`.
        target: one of `TARGETS`: `c` (`FILE.c` and `FILE.h`), `onnx`, `fmu`.
        path: of the file.
        arguments: of the environment (`scenario`, `variants`, `settings`, `observation`,
            `normalize`, ...).

    Returns:
        The file.

    Raises:
        ValueError: an unknown target, or a policy that the target cannot carry; the message says
            why.
        ImportError: `onnx` is missing.

    Example:
        smpl.deploy.export_policy(smpl.controllers.LQR(model), model, "c", "lqr.c")
    """
    if target not in TARGETS:
        raise ValueError(f"target is {target!r}; there are: {', '.join(TARGETS)}")
    file = Path(path)
    if file.suffix != f".{target}":
        raise ValueError(f"path is {str(path)!r}, expected a file that ends in .{target}")
    task = Task.of(env, **arguments)
    chosen = agent(policy, task.model)
    made = task.env()
    made.reset(seed=0, options={"start": "nominal"})
    chosen.check(made)
    law = law_of(chosen.chooser, made)
    formulation = law.formulation if isinstance(law, Network) else None
    contract = contract_of(chosen.name, made, list(law.inputs), law.memory, formulation)
    TARGETS[target](law, contract, file)
    return file


def _c(law: Law, contract: Contract, file: Path) -> None:
    for name, text in c.sources(law, contract, identifier(file)).items():
        file.with_suffix(Path(name).suffix).write_text(text, encoding="utf-8")


def identifier(file: Path) -> str:
    """The prefix of the names in C, that of the file.

    Raises:
        ValueError: the name of the file does not begin as a name in C does.
    """
    if not re.fullmatch(r"[A-Za-z]\w*", file.stem, re.ASCII):
        raise ValueError(f"{file.name}: the name becomes a prefix in C; use letters, digits and underscores")
    return file.stem


# What is written, by the ending of the file.
TARGETS: dict[str, Callable[[Law, Contract, Path], None]] = {
    "c": _c,
    "onnx": onnx.write,
    "fmu": lambda law, contract, file: fmu.write(law, contract, file, identifier(file)),
}
