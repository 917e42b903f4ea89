"""Exported policies as ONNX graphs, with the contract as metadata."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from smpl.deploy.contract import Contract
from smpl.deploy.laws import Law, Linear, Loops, Network, Table
from smpl.support.optional import load

# Version of the operators, and of the format: readers of several years know both.
_OPERATORS, _FORMAT = 15, 8
# Key of the contract in the metadata.
KEY = "smpl_policy"


def write(law: Law, contract: Contract, file: Path) -> None:
    """Writes the graph from `input` and `memory` to `action` and `next_memory`, in doubles.

    Raises:
        ValueError: PID loops, which branch on their past.
        ImportError: the package `onnx` is missing.
    """
    onnx = load("onnx", "export to ONNX")
    if isinstance(law, Loops):
        raise ValueError(f"{contract.controller} has PID loops, which ONNX cannot carry; use c or fmu")
    graph = _Graph(onnx)
    graph.node("Slice", ["memory", *map(graph.integers, ([0], [1], [1]))], "step")
    {Table: _table, Linear: _linear, Network: _network}[type(law)](law, graph)  # type: ignore[operator]
    double = onnx.TensorProto.DOUBLE
    given = [_value(onnx, "input", len(contract.inputs), double)] if contract.inputs else []
    made = onnx.helper.make_graph(
        graph.nodes, contract.controller, [*given, _value(onnx, "memory", contract.memory, double)],
        [_value(onnx, "action", len(contract.actions), double), _value(onnx, "next_memory", contract.memory, double)],
        graph.constants,
    )  # fmt: skip
    model = onnx.helper.make_model(
        made, producer_name="smpl", producer_version=contract.version,
        opset_imports=[onnx.helper.make_opsetid("", _OPERATORS)], ir_version=_FORMAT,
    )  # fmt: skip
    onnx.helper.set_model_props(model, {KEY: contract.text()})
    onnx.checker.check_model(model)
    file.write_bytes(model.SerializeToString())


class _Graph:
    """Nodes and constants of a graph."""

    def __init__(self, onnx: Any) -> None:
        self._onnx = onnx
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, values: Any, kind: Any = np.float64) -> str:
        """The name of a constant."""
        name = f"constant_{len(self.constants)}"
        self.constants.append(self._onnx.numpy_helper.from_array(np.ascontiguousarray(values, dtype=kind), name))
        return name

    def integers(self, values: Any) -> str:
        """The name of a constant of indices."""
        return self.constant(values, np.int64)

    def node(self, kind: str, inputs: list[str], output: str | None = None, **attributes: Any) -> str:
        """The name of the output of a new node."""
        name = output or f"value_{len(self.nodes)}"
        self.nodes.append(self._onnx.helper.make_node(kind, inputs, [name], **attributes))
        return name

    def cast(self, value: str, single: bool, output: str | None = None) -> str:
        """The value in single or double precision."""
        kind = self._onnx.TensorProto.FLOAT if single else self._onnx.TensorProto.DOUBLE
        return self.node("Cast", [value], output, to=kind)

    def within(self, value: str, low: Any, high: Any, output: str | None = None, kind: Any = np.float64) -> str:
        """The value within bounds, element by element."""
        above = self.node("Max", [value, self.constant(low, kind)])
        return self.node("Min", [above, self.constant(high, kind)], output)

    def count(self, others: list[str]) -> None:
        """The next memory: one step more, and the other values."""
        more = self.node("Add", ["step", self.constant([1.0])])
        self.node("Concat", [more, *others], "next_memory", axis=1)


def _value(onnx: Any, name: str, width: int, kind: Any) -> Any:
    return onnx.helper.make_tensor_value_info(name, kind, ["N", width])


def _table(law: Table, graph: _Graph) -> None:
    # Behind the end of a table that is not held there is no action: not a number.
    rows = law.actions if law.hold else np.vstack([law.actions, np.full_like(law.actions[:1], np.nan)])
    row = graph.node("Cast", [graph.within("step", [0.0], [len(rows) - 1.0])], to=graph._onnx.TensorProto.INT64)
    index = graph.node("Squeeze", [row, graph.integers([1])])
    graph.node("Gather", [graph.constant(rows), index], "action", axis=0)
    graph.count([])


def _linear(law: Linear, graph: _Graph) -> None:
    deviation = graph.node("Sub", ["input", graph.constant(law.state)])
    push = graph.node("MatMul", [deviation, graph.constant(law.gain.T)])
    wanted = graph.node("Sub", [graph.constant(law.rest), push])
    errors = len(law.rows)
    if not errors:
        graph.within(wanted, law.low, law.high, "action")
        graph.count([])
        return
    sums = graph.node("Slice", ["memory", *map(graph.integers, ([1], [1 + errors], [1]))])
    pulled = graph.node("MatMul", [sums, graph.constant(law.integral_gain.T)])
    wanted = graph.node("Sub", [wanted, pulled])
    graph.within(wanted, law.low, law.high, "action")
    moved = graph.node("Sub", ["action", graph.constant(law.rest)])
    error = graph.node(
        "Add",
        [
            graph.node("MatMul", [deviation, graph.constant(law.rows.T)]),
            graph.node("MatMul", [moved, graph.constant(law.through.T)]),
        ],
    )
    # (N, errors, actions): how an error would move each action, where that one is at its limit.
    each = graph.node("Unsqueeze", [error, graph.integers([2])])
    push = graph.node("Mul", [each, graph.constant(-law.integral_gain.T[None])])
    beyond = graph.node("Unsqueeze", [graph.node("Sub", [wanted, "action"]), graph.integers([1])])
    further = graph.node("ReduceMax", [graph.node("Mul", [push, beyond])], axes=[2], keepdims=0)
    blocked = graph.node("Greater", [further, graph.constant(0.0)])
    added = graph.node("Where", [blocked, graph.constant(0.0), error])
    graph.count([graph.node("Add", [sums, added])])


def _network(law: Network, graph: _Graph) -> None:
    observed = _observed(law, graph)
    earlier: list[str] = []
    if law.history > 1:
        width = (law.history - 1) * len(law.inputs)
        kept = graph.cast(graph.node("Slice", ["memory", *map(graph.integers, ([1], [1 + width], [1]))]), True)
        first = graph.node("Equal", ["step", graph.constant([0.0])])
        copies = graph.node("Concat", [observed] * (law.history - 1), axis=1)
        seen = graph.node("Concat", [graph.node("Where", [first, copies, kept]), observed], axis=1)
        later = graph.node("Slice", [seen, *map(graph.integers, ([len(law.inputs)], [2**31], [1]))])
        earlier, observed = [graph.cast(later, False)], seen
    value = observed
    for layer in law.layers:
        value = graph.node("MatMul", [value, graph.constant(layer.weight.T, np.float32)])
        value = graph.node("Add", [value, graph.constant(layer.bias, np.float32)])
        value = _activated(layer.activation, layer.slope, value, graph)
    value = graph.cast(graph.within(value, law.out_low, law.out_high, kind=np.float32), False)
    if not law.physical:
        below = graph.node("Less", [value, graph.constant(0.0)])
        reach = graph.node("Where", [below, graph.constant(law.down), graph.constant(law.up)])
        moved = graph.node("Mul", [value, reach])
        value = graph.node("Add", [moved, graph.constant(law.centre[list(law.learned)])])
    _placed(law, value, graph)
    graph.count(earlier)


def _observed(law: Network, graph: _Graph) -> str:
    """Observations as the network was trained on them."""
    scaled = law.high > law.low
    low, high = np.where(scaled, law.low, -1.0), np.where(scaled, law.high, 1.0)
    value = graph.within("input", law.clip_low, law.clip_high)
    twice = graph.node("Sub", [graph.node("Mul", [graph.constant([2.0]), value]), graph.constant(high + low)])
    value = graph.node("Div", [twice, graph.constant(high - low)])
    if law.windows.any():
        ends = np.where(law.windows, 1.0, np.inf)
        value = graph.within(value, -ends, ends)
    return graph.cast(value, True)


def _activated(kind: str, slope: float, value: str, graph: _Graph) -> str:
    if kind == "linear":
        return value
    names = {"tanh": "Tanh", "relu": "Relu", "elu": "Elu", "leaky_relu": "LeakyRelu", "sigmoid": "Sigmoid"}
    options: dict[str, Any] = {"alpha": slope} if kind in ("elu", "leaky_relu") else {}
    return graph.node(names[kind], [value], **options)


def _placed(law: Network, value: str, graph: _Graph) -> None:
    """All actions, those that the network does not choose at the centre."""
    count = len(law.centre)
    if list(law.learned) == list(range(count)):
        graph.node("Identity", [value], "action")
        return
    place = np.zeros((len(law.learned), count))
    place[np.arange(len(law.learned)), list(law.learned)] = 1.0
    others = law.centre.copy()
    others[list(law.learned)] = 0.0
    spread = graph.node("MatMul", [value, graph.constant(place)])
    graph.node("Add", [spread, graph.constant(others)], "action")
