"""An evaluator of models exported as JSON, written from docs/export.md alone: it knows nothing of the compiler.

Many points at once: a number is an array with one entry for each point.
"""

import itertools
import math

import numpy as np

UNARY = {
    "negate": np.negative,
    "abs": np.abs,
    "sign": np.sign,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "ln": np.log,
    "log10": np.log10,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "erf": np.vectorize(math.erf, otypes=[float]),
    "floor": np.floor,
    "ceil": np.ceil,
    "round": np.round,
    "smooth": lambda x: x,
    "single": lambda x: np.float64(np.float32(x)),
    "not": np.logical_not,
}
BINARY = {
    "add": np.add,
    "subtract": np.subtract,
    "multiply": np.multiply,
    "divide": np.divide,
    "power": np.power,
    "min": np.minimum,
    "max": np.maximum,
    "atan2": np.arctan2,
    "less": np.less,
    "less_equal": np.less_equal,
    "equal": np.equal,
    "unequal": np.not_equal,
    "and": np.logical_and,
    "or": np.logical_or,
}
# Kinds whose first operand is a node and whose second is not.
ONE_AND_MORE = ("integer_power", "passed_below", "passed_up_to", "entry")
REDUCE = {"sum": np.add, "product": np.multiply, "minimum": np.minimum, "maximum": np.maximum}


class Tree:
    """An exported model with the values of its variables.

    `values[copy][variable]` is an array of shape (length, points).
    """

    def __init__(self, tree, points):
        assert (tree["format"], tree["version"]) == ("smpl-model", 3)
        self.tree = tree
        self.points = points
        self.time = np.zeros(points)
        self.nodes = tree["expressions"]
        self.free = [frozenset()] * len(self.nodes)
        for i, node in enumerate(self.nodes):
            self.free[i] = self._free(node)
        lengths = [variable["length"] for variable in tree["variables"]]
        copies = ("value", "derivative", "initial", "previous", "steady")
        self.values = {copy: [np.zeros((n, points)) for n in lengths] for copy in copies}

    def _free(self, node):
        kind, *rest = node
        if kind == "counter":
            return frozenset(rest)
        if kind == "load":
            return frozenset(d for d, factor in enumerate(rest[2][1:]) if factor)
        if kind in REDUCE:
            return self.free[rest[2]] - {rest[0]}
        if kind in ("constant", "truth", "time"):
            return frozenset()
        operands = rest[:1] if kind in ONE_AND_MORE else rest
        return frozenset().union(*(self.free[o] for o in operands))

    def set(self, family, values, copy="value"):
        """Set the elements of a family, in public order; `values` has shape (elements, points)."""
        for element, value in zip(self.tree["elements"][family], values, strict=True):
            self.values[copy][element["variable"]][element["element"]] = value

    def set_nominal(self):
        for family in ("states", "solved", "discretes", "actions", "disturbances", "parameters"):
            for element in self.tree["elements"][family]:
                if element["nominal"] is not None:
                    self.values["value"][element["variable"]][element["element"]] = element["nominal"]

    def residual(self):
        """Rows of the public unknowns: states, then solved algebraic variables."""
        rows = {}
        for equation in self.tree["equations"]:
            variable, address = equation["unknown"]["variable"], equation["unknown"]["at"]
            memo = {}
            for counters in itertools.product(*map(range, equation["extents"])):
                rows[variable, place(address, counters)] = self.value(equation["residual"], counters, memo)
        elements = self.tree["elements"]["states"] + self.tree["elements"]["solved"]
        return np.reshape([rows[e["variable"], e["element"]] for e in elements], (len(elements), self.points))

    def run(self, name):
        """Runs a program in place or returns its outputs."""
        program = self.tree["programs"][name]
        out = {}
        for nest in program["nests"]:
            memo = {}
            for counters in itertools.product(*map(range, nest["extents"])):
                memo = {} if program["in_place"] else memo
                values = [self.value(store["value"], counters, memo) for store in nest["stores"]]
                for store, value in zip(nest["stores"], values, strict=True):
                    if "out" in store:
                        out[place(store["out"], counters)] = value
                    else:
                        self.values["value"][store["variable"]][place(store["at"], counters)] = value
        return np.array([np.broadcast_to(out[i], self.points) for i in range(len(out))], dtype=float)

    def value(self, root, counters, memo):
        """The value of a node at given counters of the loops around."""
        counters = dict(enumerate(counters)) if not isinstance(counters, dict) else counters
        stack = [root]
        while stack:
            top = stack[-1]
            key = self._key(top, counters)
            kind, *rest = self.nodes[top]
            if key in memo:
                stack.pop()
                continue
            if kind in REDUCE:
                depth, extent, body = rest
                passes = ({**counters, depth: i} for i in range(extent))
                memo[key] = REDUCE[kind].reduce(
                    [np.broadcast_to(self.value(body, c, memo), self.points) for c in passes]
                )
                continue
            operands = rest[:1] if kind in ONE_AND_MORE else rest if kind in BINARY or kind in UNARY else []
            operands = rest if kind == "select" else operands
            missing = [o for o in operands if self._key(o, counters) not in memo]
            if missing:
                stack.extend(missing)
                continue
            memo[key] = self._apply(kind, rest, [memo[self._key(o, counters)] for o in operands], counters)
        return memo[self._key(root, counters)]

    def _key(self, node, counters):
        return (node, *((d, counters[d]) for d in sorted(self.free[node])))

    def _apply(self, kind, rest, operands, counters):
        if kind == "constant":
            return np.float64(rest[0])
        if kind == "truth":
            return np.bool_(rest[0])
        if kind == "time":
            return self.time
        if kind == "counter":
            return np.float64(counters[rest[0]])
        if kind == "load":
            variable, copy, address = rest
            return self.values[copy][variable][place(address, counters)]
        if kind == "integer_power":
            return operands[0] ** np.float64(rest[1])
        if kind in ("passed_below", "passed_up_to"):
            return np.searchsorted(rest[1], operands[0], side="left" if kind == "passed_below" else "right").astype(
                float
            )
        if kind == "entry":
            return np.array(rest[1])[np.asarray(operands[0], dtype=int)]
        if kind == "select":
            return np.where(*operands)
        return (UNARY[kind] if kind in UNARY else BINARY[kind])(*operands)


def place(address, counters):
    offset, *factors = address
    return offset + sum(factor * counters[d] for d, factor in enumerate(factors) if factor)
