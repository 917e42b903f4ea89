"""Exported policies in C99: one function without allocation; the caller keeps the state."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from smpl.deploy.contract import Contract, Signal
from smpl.deploy.laws import Law, Linear, Loops, Network, Table


def sources(law: Law, contract: Contract, name: str) -> dict[str, str]:
    """Texts of `NAME.h` and `NAME.c`."""
    body = _BODIES[type(law)](law)
    top = (
        f"/* {_comment(contract.controller)} for the model {contract.model}, exported by smpl {contract.version}. "
        "Generated: do not edit. */\n"
    )
    return {f"{name}.h": top + _header(contract, name), f"{name}.c": top + _source(contract, name, body)}


def _header(contract: Contract, name: str) -> str:
    upper = name.upper()
    rows = [
        f"#ifndef {upper}_H\n#define {upper}_H\n",
        f"/* Model {contract.model}, scenario {contract.scenario or 'default'}, observation level {contract.level},",
        f" * called every {contract.interval!r} {contract.time_unit}.",
        " *",
        *_listing("inputs", contract.inputs),
        " *",
        *_listing("actions", contract.actions),
        " */",
        f'#define {upper}_MODEL_HASH "{contract.hash}"',
        f"#define {upper}_INTERVAL {contract.interval!r}",
        f"#define {upper}_INPUTS {len(contract.inputs)}",
        f"#define {upper}_ACTIONS {len(contract.actions)}",
        f"#define {upper}_MEMORY {contract.memory}",
        "",
        "/* The contract as JSON: names, units, limits, model. */",
        f"extern const char {name}_contract[];",
        "",
        "/* Actions for inputs in physical units. `memory` has zeros at the start of an episode and is changed by each",
        " * call. Returns 0; 1 if an input is not finite, and 2 after the end of a table: nothing is changed then. */",
        f"int {name}_action(const double *input, double *memory, double *action);",
        "\n#endif\n",
    ]
    return "\n".join(rows)


def _listing(what: str, signals: Iterable[Signal]) -> list[str]:
    rows = [f" * {what}:"]
    for at, one in enumerate(signals):
        rows.append(f" *   {at}: {one.name} [{_comment(one.unit)}], {one.low:.17g} to {one.high:.17g} ({one.source})")
    return rows if len(rows) > 1 else [f" * {what}: none"]


def _source(contract: Contract, name: str, body: tuple[str, str]) -> str:
    text = contract.text().encode() + b"\0"
    signs = ",".join(map(str, text))
    return (
        f'#include "{name}.h"\n\n#include <math.h>\n\n'
        f"const char {name}_contract[] = {{\n{_wrapped(signs)}\n}};\n\n"
        f"#define INPUTS {len(contract.inputs)}\n#define ACTIONS {len(contract.actions)}\n\n"
        f"{body[0]}"
        f"int {name}_action(const double *input, double *memory, double *action)\n{{\n"
        f"{_FINITE if contract.inputs else '    (void)input;' + chr(10)}"
        f"{body[1]}    memory[0] += 1.0;\n    return 0;\n}}\n"
    )


_FINITE = "    for (int i = 0; i < INPUTS; ++i)\n        if (!isfinite(input[i])) return 1;\n"


def _table(law: Table) -> tuple[str, str]:
    steps = len(law.actions)
    end = f"step > {steps - 1} ? {steps - 1} : (int)step" if law.hold else "(int)step"
    check = "" if law.hold else f"    if (step > {steps - 1}) return 2;\n"
    return (
        _array("table", law.actions),
        f"    const double step = memory[0];\n{check}    const double *row = table + ACTIONS * ({end});\n"
        "    for (int j = 0; j < ACTIONS; ++j) action[j] = row[j];\n",
    )


def _linear(law: Linear) -> tuple[str, str]:
    errors = len(law.rows)
    data = "".join(_array(name, getattr(law, name)) for name in ("gain", "state", "rest", "low", "high"))
    code = (
        f"    double deviation[INPUTS]{', wanted[ACTIONS]' if errors else ''};\n"
        "    for (int i = 0; i < INPUTS; ++i) deviation[i] = input[i] - state[i];\n"
        "    for (int j = 0; j < ACTIONS; ++j) {\n"
        "        double sum = rest[j];\n"
        "        for (int i = 0; i < INPUTS; ++i) sum -= gain[j * INPUTS + i] * deviation[i];\n"
        + (
            "        for (int k = 0; k < ERRORS; ++k) sum -= integral_gain[j * ERRORS + k] * memory[1 + k];\n"
            if errors
            else ""
        )
        + ("        wanted[j] = sum;\n" if errors else "")
        + "        action[j] = sum < low[j] ? low[j] : sum > high[j] ? high[j] : sum;\n    }\n"
    )
    if errors:
        data += f"#define ERRORS {errors}\n"
        data += "".join(_array(name, getattr(law, name)) for name in ("integral_gain", "rows", "through"))
        code += _SUMS
    return data + "\n", code


# An error is not summed up while it would drive a saturated action further out.
_SUMS = """    for (int k = 0; k < ERRORS; ++k) {
        double error = 0.0;
        int blocked = 0;
        for (int i = 0; i < INPUTS; ++i) error += rows[k * INPUTS + i] * deviation[i];
        for (int j = 0; j < ACTIONS; ++j) error += through[k * ACTIONS + j] * (action[j] - rest[j]);
        for (int j = 0; j < ACTIONS; ++j) {
            double push = -integral_gain[j * ERRORS + k] * error;
            if ((wanted[j] - action[j]) * push > 0.0) blocked = 1;
        }
        if (!blocked) memory[1 + k] += error;
    }
"""

_LOOP = """typedef struct {
    int measured, action, velocity, clamping, back_calculation, bumpless, set_points;
    const double *set_point;
    double gain, integral_time, derivative_time, filter, weight, tracking_time, interval, low, high, level;
} loop;

/* Memory of a loop: integral, derivative, last measurement, last action, last proportional part, last error. */
static double update(const loop *c, double y, int first, double step, double *m)
{
    const double goal = c->set_point[step > c->set_points - 1 ? c->set_points - 1 : (int)step];
    const double error = goal - y, proportional = c->gain * (c->weight * goal - y);
    const double before = m[1];
    double wanted, action;
    if (first) {
        const double offset = c->gain * (c->weight - 1.0) * goal;
        m[0] = c->bumpless ? c->level - proportional : c->velocity ? c->level : c->level - offset;
        m[1] = 0.0;
        m[2] = y;
        m[3] = c->velocity || c->bumpless ? c->level : c->level - offset;
        m[4] = c->bumpless ? proportional : offset;
        m[5] = 0.0;
    }
    if (c->derivative_time > 0.0)
        m[1] = (c->derivative_time * (first ? 0.0 : before) - c->gain * c->derivative_time * c->filter * (y - m[2]))
            / (c->derivative_time + c->filter * c->interval);
    m[2] = y;
    if (c->velocity) {
        wanted = m[3] + (proportional - m[4] + c->gain * c->interval / c->integral_time * m[5])
            + (m[1] - (first ? 0.0 : before));
        m[4] = proportional;
        m[5] = error;
    } else {
        wanted = proportional + m[0] + m[1];
    }
    action = wanted > c->low ? wanted : c->low;
    action = action < c->high ? action : c->high;
    if (!c->velocity) {
        const double change = c->gain * c->interval / c->integral_time * error;
        if (!c->clamping || (wanted - action) * change <= 0.0) m[0] += change;
        if (c->back_calculation && isfinite(c->integral_time))
            m[0] += c->interval / c->tracking_time * (action - wanted);
    }
    m[3] = action;
    return action;
}

"""


def _loops(law: Loops) -> tuple[str, str]:
    data = [_array(f"set_point_{k}", one.set_points) for k, one in enumerate(law.loops)]
    rows = [
        "{" + ", ".join([
            *map(str, (one.measured, one.action, int(one.velocity), int(one.clamping), int(one.back_calculation))),
            str(int(one.bumpless)), str(len(one.set_points)), f"set_point_{k}",
            *(_number(value) for value in (
                one.gain, one.integral_time, one.derivative_time, one.filter, one.weight, one.tracking_time,
                one.interval, one.low, one.high, one.level,
            )),
        ]) + "}"
        for k, one in enumerate(law.loops)
    ]  # fmt: skip
    count = len(law.loops)
    before = _LOOP + "".join(data) + _array("base", law.base)
    before += f"static const loop loops[{max(1, count)}] = {{\n    " + ",\n    ".join(rows or ["{0}"]) + "\n};\n\n"
    code = (
        "    const double step = memory[0];\n    for (int j = 0; j < ACTIONS; ++j) action[j] = base[j];\n"
        f"    for (int k = 0; k < {count}; ++k)\n"
        "        action[loops[k].action]\n"
        "            = update(&loops[k], input[loops[k].measured], step == 0.0, step, memory + 1 + 6 * k);\n"
    )
    return before, code


def _network(law: Network) -> tuple[str, str]:
    arrays = {
        "low": law.low, "high": law.high, "clip_low": law.clip_low, "clip_high": law.clip_high, "centre": law.centre,
        **({} if law.physical else {"down": law.down, "up": law.up}),
    }  # fmt: skip
    data = "".join(_array(name, values) for name, values in arrays.items())
    data += _array("window", law.windows.astype(int), "int") + _array("learned", np.array(law.learned), "int")
    data += _array("out_low", law.out_low, "float") + _array("out_high", law.out_high, "float")
    for k, layer in enumerate(law.layers):
        data += _array(f"weight_{k}", layer.weight, "float") + _array(f"bias_{k}", layer.bias, "float")
    width = max(law.layers[0].weight.shape[1], *(len(one.bias) for one in law.layers))
    data += f"#define HISTORY {law.history}\n#define WIDTH {width}\n\n" + _LAYER
    calls, here, there = [], "a", "b"
    for k, layer in enumerate(law.layers):
        rows, columns = layer.weight.shape
        kind = _KINDS.index(layer.activation)
        calls.append(
            f"    layer({rows}, {columns}, weight_{k}, bias_{k}, {kind}, {_single(layer.slope)}, {here}, {there});\n"
        )
        here, there = there, here
    scale = "y" if law.physical else "centre[at] + (double)y * (y < 0.0f ? down[j] : up[j])"
    code = _OBSERVE + "".join(calls) + _ACT.replace("RESULT", here).replace("SCALED", scale)
    return data, code.replace("LEARNED", str(len(law.learned)))


_KINDS = ("linear", "tanh", "relu", "elu", "leaky_relu", "sigmoid")

_LAYER = """static void layer(
    int rows, int columns, const float *w, const float *c, int kind, float slope, const float *x, float *y)
{
    for (int i = 0; i < rows; ++i) {
        float sum = 0.0f;
        for (int j = 0; j < columns; ++j) sum += w[i * columns + j] * x[j];
        sum += c[i];
        if (kind == 1) sum = tanhf(sum);
        if (kind == 2) sum = sum > 0.0f ? sum : 0.0f;
        if (kind == 3) sum = sum > 0.0f ? sum : slope * expm1f(sum);
        if (kind == 4) sum = sum > 0.0f ? sum : slope * sum;
        if (kind == 5) sum = 1.0f / (1.0f + expf(-sum));
        y[i] = sum;
    }
}

"""

_OBSERVE = """    float a[WIDTH], b[WIDTH];
    float *now = a + (HISTORY - 1) * INPUTS;
    for (int i = 0; i < INPUTS; ++i) {
        double x = input[i] < clip_low[i] ? clip_low[i] : input[i] > clip_high[i] ? clip_high[i] : input[i];
        if (high[i] > low[i]) x = (2.0 * x - (high[i] + low[i])) / (high[i] - low[i]);
        if (window[i]) x = x < -1.0 ? -1.0 : x > 1.0 ? 1.0 : x;
        now[i] = (float)x;
    }
    for (int i = 0; i < (HISTORY - 1) * INPUTS; ++i)
        a[i] = memory[0] == 0.0 ? now[i % INPUTS] : (float)memory[1 + i];
    for (int i = 0; i < (HISTORY - 1) * INPUTS; ++i) memory[1 + i] = (double)a[i + INPUTS];
"""

_ACT = """    for (int j = 0; j < ACTIONS; ++j) action[j] = centre[j];
    for (int j = 0; j < LEARNED; ++j) {
        const int at = learned[j];
        const float y = RESULT[j] < out_low[j] ? out_low[j] : RESULT[j] > out_high[j] ? out_high[j] : RESULT[j];
        action[at] = SCALED;
    }
"""


_BODIES: dict[type, Callable[[Any], tuple[str, str]]] = {
    Table: _table,
    Linear: _linear,
    Loops: _loops,
    Network: _network,
}


def _array(name: str, values: npt.NDArray[np.generic], kind: str = "double") -> str:
    flat = np.asarray(values).reshape(-1).tolist()
    writers: dict[str, Callable[[Any], str]] = {"double": _number, "float": _single, "int": str}
    texts = ", ".join(map(writers[kind], flat)) or "0"
    return f"static const {kind} {name}[{max(1, len(flat))}] = {{\n{_wrapped(texts)}\n}};\n"


def _number(value: float) -> str:
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(float(value))


def _single(value: float) -> str:
    if not math.isfinite(value):
        return _number(value)
    text = f"{np.float32(value):.9g}"
    return f"{text}f" if any(sign in text for sign in ".en") else f"{text}.0f"


def _wrapped(text: str, width: int = 110) -> str:
    """Items in lines of at most `width` columns."""
    lines, line = [], "   "
    for item in text.replace(", ", ",").split(","):
        if len(line) + len(item) + 2 > width:
            lines.append(line)
            line = "   "
        line += f" {item},"
    return "\n".join([*lines, line.rstrip(",")])


def _comment(text: str) -> str:
    return text.replace("*/", "* /")
