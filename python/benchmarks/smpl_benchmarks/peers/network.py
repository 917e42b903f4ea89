"""Reaction networks of BioNetGen (`.net`): read, and written as a model text."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from smpl.support.arguments import FloatArray

Indices = NDArray[np.int64]
# Terms of a sum in one pair of parentheses: the nesting of expressions is limited.
GROUP = 20


@dataclass(frozen=True)
class Network:
    """Reactions of mass action with at most two reactants, all arrays by reaction or entry.

    A missing second reactant has the index `len(start)`, whose amount is 1.
    `rows`, `reactions` and `counts` are the entries of the stoichiometric matrix.
    """

    start: FloatArray
    constants: FloatArray
    first: Indices
    second: Indices
    rows: Indices
    reactions: Indices
    counts: FloatArray


def read_network(path: Path) -> Network:
    """Read a generated network.

    Raises:
        ValueError: a reaction has more than two reactants, or a value is not a number.
    """
    text = re.sub(r"#.*", "", path.read_text())
    values: dict[str, float] = {}
    for _, name, *rest in block(text, "parameters"):
        values[name] = value_of(" ".join(rest), values)
    start = np.array([value_of(" ".join(rest), values) for _, _, *rest in block(text, "species")])
    constants, pairs, entries = [], [], []
    for number, (_, reactants, products, *law) in enumerate(block(text, "reactions")):
        left, right = members(reactants), members(products)
        if len(left) > 2:
            raise ValueError(f"{path}: reaction {number + 1} has more than two reactants")
        constants.append(value_of(" ".join(law), values))
        pairs.append((left + [len(start)] * 2)[:2])
        changed = {one: right.count(one) - left.count(one) for one in (*left, *right)}
        entries += [(one, number, count) for one, count in changed.items() if count]
    first, second = np.array(pairs).T
    rows, reactions, counts = np.array(entries).T
    return Network(start, np.array(constants), first, second, rows, reactions, counts.astype(float))


def block(text: str, name: str) -> list[list[str]]:
    """Fields of the lines of a block."""
    _, _, rest = text.partition(f"begin {name}\n")
    return [line.split() for line in rest.partition(f"end {name}")[0].splitlines() if line.strip()]


def members(text: str) -> list[int]:
    """Species of one side of a reaction, from 0; a 0 in the file is an empty side."""
    return [int(one) - 1 for one in text.split(",") if one != "0"]


def value_of(text: str, values: dict[str, float]) -> float:
    """Value of products and quotients of names and numbers.

    Raises:
        ValueError: the text has other operations or unknown names.
    """
    found = 1.0
    for operator, operand in re.findall(r"(^|[*/])\s*([\w.+-]+)\s*", text.strip()):
        value = values[operand] if operand in values else float(operand)
        found = found / value if operator == "/" else found * value
    return found


def scale_of(network: Network) -> float:
    """Scale of all amounts: the power of ten below the smallest positive one at the start."""
    return float(10.0 ** math.floor(math.log10(network.start[network.start > 0].min())))


def model_text(network: Network, sampling: float, steps: int) -> str:
    """A model text: a scalar state for each species, a definition for each reaction."""
    size = len(network.start)
    scale = scale_of(network)
    lines = ["model Network", "time t : s", ""]
    lines += [f"state S{i + 1} = {value!r} scale {scale!r}" for i, value in enumerate(network.start.tolist())]
    pairs = zip(network.constants.tolist(), network.first.tolist(), network.second.tolist(), strict=True)
    for number, (constant, one, other) in enumerate(pairs):
        second = "" if other == size else f"*S{other + 1}"
        lines.append(f"let R{number + 1} = {constant!r}*S{one + 1}{second}")
    terms: list[list[str]] = [[] for _ in range(size)]
    entries = zip(network.rows.tolist(), network.reactions.tolist(), network.counts.tolist(), strict=True)
    for row, reaction, count in entries:
        factor = "" if abs(count) == 1 else f"{abs(count):g}*"
        terms[row].append(f"{'-' if count < 0 else '+'} {factor}R{reaction + 1}")
    lines += [f"eq d/dt S{i + 1} * 1 [s] = {grouped(each)}" for i, each in enumerate(terms)]
    lines.append(f"observe S1 in 0..{10 * float(network.start.max())!r}")
    lines.append(f"episode {{ step = {sampling!r} [s], max_steps = {steps} }}")
    return "\n".join([*lines, "solver { rtol = 1e-6, max_steps = 1000000 }", ""])


def grouped(terms: Sequence[str]) -> str:
    """A sum in nested parentheses of a limited depth."""
    if not terms:
        return "0"
    while len(terms) > GROUP:
        terms = [f"+ (0 {' '.join(terms[k : k + GROUP])})" for k in range(0, len(terms), GROUP)]
    return f"0 {' '.join(terms)}"
