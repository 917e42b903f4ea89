"""Exported policies as FMI 3.0 co-simulation units: inputs are measurements, outputs actions.

The action of a sampling instant is computed from the inputs that are set then: at the first reading
of an output, else at the beginning of the next step. An importer that sets the measurements, reads
the actions and steps the plant gets the loop of an environment.
"""

from __future__ import annotations

import io
import re
import tempfile
import zipfile
from functools import lru_cache
from pathlib import Path
from xml.sax.saxutils import quoteattr

from smpl.deploy import c
from smpl.deploy.artefact import compiled
from smpl.deploy.contract import Contract, Signal
from smpl.deploy.laws import Law
from smpl.model import compile

# A model of which the FMU has the header of the interface.
_ANY = """model Any
state x = 0
eq d/dt x = 0[1/s]
observe x in 0..1
reward r = x
episode { step = 1 [s], max_steps = 1 }
"""
_DATE = (1980, 1, 1, 0, 0, 0)


def write(law: Law, contract: Contract, file: Path, name: str) -> None:
    """Write the FMU, with sources and a binary for Linux on x86-64.

    Raises:
        ValueError: there is no C compiler, or it refuses the sources.
    """
    texts = {**c.sources(law, contract, name), "fmi3.h": _header(), "fmi3.c": _interface(contract, name)}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for path, text in texts.items():
            (folder / path).write_text(text, encoding="utf-8")
        whole = folder / "whole.c"
        whole.write_text(f'#include "{name}.c"\n#undef INPUTS\n#undef ACTIONS\n#include "fmi3.c"\n', encoding="utf-8")
        binary = compiled(whole, folder).read_bytes()
    files = {
        "modelDescription.xml": _description(contract, name).encode(),
        "resources/contract.json": (contract.text() + "\n").encode(),
        "sources/buildDescription.xml": _build(name).encode(),
        **{f"sources/{path}": text.encode() for path, text in texts.items()},
        f"binaries/x86_64-linux/{name}.so": binary,
    }
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, content in files.items():
            archive.writestr(zipfile.ZipInfo(path, _DATE), content, zipfile.ZIP_DEFLATED)
    file.write_bytes(packed.getvalue())


@lru_cache(maxsize=1)
def _header() -> str:
    """The interface of FMI 3.0, as the FMUs of models have it."""
    content, _ = compile(source=_ANY).native.fmu(False)
    return zipfile.ZipFile(io.BytesIO(content)).read("sources/fmi3.h").decode()


def _description(contract: Contract, name: str) -> str:
    units = dict.fromkeys(one.unit for one in (*contract.inputs, *contract.actions))
    inputs = [_variable(one, at + 1, "input") for at, one in enumerate(contract.inputs)]
    first = 1 + len(contract.inputs)
    outputs = [_variable(one, first + at, "output") for at, one in enumerate(contract.actions)]
    sources = " ".join(str(at + 1) for at in range(len(contract.inputs)))
    structure = "".join(
        f'    <{kind} valueReference="{first + at}" dependencies="{sources}"/>\n'
        for kind in ("Output", "InitialUnknown")
        for at in range(len(contract.actions))
    )
    text = f"{contract.controller} for {contract.model}, called every {contract.interval!r} {contract.time_unit}"
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<fmiModelDescription fmiVersion="3.0" modelName={quoteattr(name)} instantiationToken="{contract.hash}" '
        f'description={quoteattr(text)} generationTool="smpl {contract.version}">\n'
        f'  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"/>\n'
        "  <UnitDefinitions>\n"
        + "".join(f"    <Unit name={quoteattr(one)}/>\n" for one in units)
        + "  </UnitDefinitions>\n"
        f'  <DefaultExperiment startTime="0" stepSize="{contract.interval!r}"/>\n'
        "  <ModelVariables>\n"
        '    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>\n'
        + "".join([*inputs, *outputs])
        + f"  </ModelVariables>\n  <ModelStructure>\n{structure}  </ModelStructure>\n</fmiModelDescription>\n"
    )


def _variable(one: Signal, reference: int, causality: str) -> str:
    name = f"obs_{one.name}" if one.source == "observation" else one.name
    bounds = "".join(
        f' {key}="{end!r}"' for key, end in (("min", one.low), ("max", one.high)) if abs(end) != float("inf")
    )
    start = "" if causality == "output" else f' start="{min(max(0.0, one.low), one.high)!r}"'
    return (
        f'    <Float64 name={quoteattr(name)} valueReference="{reference}" causality="{causality}" '
        f'variability="discrete" unit={quoteattr(one.unit)}{bounds}{start}/>\n'
    )


def _build(name: str) -> str:
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<fmiBuildDescription fmiVersion="3.0">\n'
        f'  <BuildConfiguration modelIdentifier="{name}">\n    <SourceFileSet language="C99">\n'
        f'      <SourceFile name="{name}.c"/>\n      <SourceFile name="fmi3.c"/>\n'
        "    </SourceFileSet>\n  </BuildConfiguration>\n</fmiBuildDescription>\n"
    )


def _interface(contract: Contract, name: str) -> str:
    starts = [repr(min(max(0.0, one.low), one.high)) for one in contract.inputs]
    values = {
        "NAME": name,
        "TOKEN": contract.hash,
        "INTERVAL": repr(contract.interval),
        "STARTS": ", ".join(starts or ["0"]),
        "UPPER": name.upper(),
    }
    text = _SOURCE
    for key, value in values.items():
        text = text.replace(f"@{key}@", value)
    done = set(re.findall(r"^\w[\w *]*?\b(fmi3\w+)\(", text, re.M))
    return text + "".join(_refusal(*one) for one in _prototypes() if one[1] not in done)


def _prototypes() -> list[tuple[str, str, str]]:
    """Type, name and parameters of the functions of the interface."""
    text = re.sub(r"/\*.*?\*/", "", _header(), flags=re.S)
    found = re.findall(r"FMI3_EXPORT\s+([\w \*]+?)\s*\b(fmi3\w+)\s*\(([^;]*)\)\s*;", text)
    return [(kind.strip(), name, " ".join(parameters.split())) for kind, name, parameters in found]


def _refusal(kind: str, name: str, parameters: str) -> str:
    """A function that this unit does not have: it fails."""
    types = [one.strip() for one in parameters.split(",")] if parameters not in ("", "void") else []
    named = []
    for at, one in enumerate(types):
        plain = re.sub(r"\[\]$", "", one)
        words = plain.replace("*", " * ").split()
        has_name = len([w for w in words if w not in ("*", "const", "unsigned", "struct")]) > 1
        base = plain[: plain.rindex(words[-1])] if has_name else plain
        named.append(f"{base} a{at}{'[]' if one.endswith('[]') else ''}")
    uses = "".join(f"    (void)a{at};\n" for at in range(len(types)))
    result = {"fmi3Status": "fmi3Error", "void": ""}.get(kind, "NULL")
    back = f"    return {result};\n" if kind != "void" else ""
    return f"\n{kind} {name}({', '.join(named) or 'void'})\n{{\n{uses}{back}}}\n"


_SOURCE = """/* The functions of FMI 3.0 for a controller. */
#include "@NAME@.h"

#include "fmi3.h"

#include <stdlib.h>
#include <string.h>

#define COUNT(n) ((n) > 0 ? (n) : 1)

typedef struct {
    double time, first, next;
    int due, ready;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    double input[COUNT(@UPPER@_INPUTS)], action[@UPPER@_ACTIONS], memory[@UPPER@_MEMORY];
} instance_data;

#define S ((instance_data *)instance)

static fmi3Status failed(instance_data *s, const char *message)
{
    if (s->log) s->log(s->environment, fmi3Error, "logStatusError", message);
    return fmi3Error;
}

static void clear(instance_data *s)
{
    static const double starts[] = {@STARTS@};
    memset(s->memory, 0, sizeof s->memory);
    memset(s->action, 0, sizeof s->action);
    memcpy(s->input, starts, sizeof starts);
    s->time = s->first = s->next = 0.0;
    s->due = s->ready = 0;
}

/* The action of a sampling instant, once. */
static fmi3Status act(instance_data *s)
{
    int status;
    if (!s->due) return fmi3OK;
    status = @NAME@_action(s->input, s->memory, s->action);
    if (status == 1) return failed(s, "an input is not finite");
    if (status == 2) return failed(s, "the table of actions has ended");
    s->due = 0;
    return fmi3OK;
}

const char *fmi3GetVersion(void)
{
    return "3.0";
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference *intermediate, size_t count,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback change)
{
    instance_data *s = NULL;
    (void)name, (void)resources, (void)visible, (void)logging, (void)early, (void)intermediate, (void)change;
    if (!events && count == 0 && token && strcmp(token, "@TOKEN@") == 0) s = malloc(sizeof *s);
    if (!s) {
        if (log) log(environment, fmi3Error, "logStatusError", "another token, event mode, or no memory");
        return NULL;
    }
    s->environment = environment;
    s->log = log;
    clear(s);
    return s;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t count, const fmi3String *categories)
{
    (void)instance, (void)on, (void)count, (void)categories;
    return fmi3OK;
}

fmi3Status fmi3EnterInitializationMode(
    fmi3Instance instance, fmi3Boolean has_tolerance, fmi3Float64 tolerance, fmi3Float64 start,
    fmi3Boolean has_stop, fmi3Float64 stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    S->time = S->first = S->next = start;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    S->ready = S->due = 1;
    S->next = S->first + @INTERVAL@;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    S->ready = 0;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    clear(S);
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(
    fmi3Instance instance, const fmi3ValueReference *references, size_t count, const fmi3Float64 *values, size_t length)
{
    if (count != length) return failed(S, "one value is needed for each variable");
    for (size_t i = 0; i < count; ++i) {
        if (references[i] < 1 || references[i] > @UPPER@_INPUTS) return failed(S, "only inputs can be set");
        S->input[references[i] - 1] = values[i];
    }
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(
    fmi3Instance instance, const fmi3ValueReference *references, size_t count, fmi3Float64 *values, size_t length)
{
    if (count != length) return failed(S, "one value is needed for each variable");
    for (size_t i = 0; i < count; ++i) {
        const fmi3ValueReference at = references[i];
        if (at > @UPPER@_INPUTS + @UPPER@_ACTIONS) return failed(S, "there is no such variable");
        if (at > @UPPER@_INPUTS && S->ready && act(S) != fmi3OK) return fmi3Error;
        values[i] = at == 0 ? S->time : at <= @UPPER@_INPUTS ? S->input[at - 1] : S->action[at - 1 - @UPPER@_INPUTS];
    }
    return fmi3OK;
}

fmi3Status fmi3DoStep(
    fmi3Instance instance, fmi3Float64 time, fmi3Float64 size, fmi3Boolean no_state, fmi3Boolean *event,
    fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    const double interval = @INTERVAL@, slack = 1e-9 * interval;
    (void)no_state;
    *event = *terminate = *early = false;
    if (!S->ready) return failed(S, "fmi3DoStep cannot be called here");
    if (act(S) != fmi3OK) return fmi3Error;
    if (time + size > S->next + interval - slack) return failed(S, "the step is longer than the sampling interval");
    S->time = *last = time + size;
    if (S->time >= S->next - slack) {
        S->due = 1;
        S->next += interval;
    }
    return fmi3OK;
}
"""
