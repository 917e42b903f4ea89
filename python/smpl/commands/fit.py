"""`smpl fit MODEL --data RUN.csv --parameters k_0,U`: parameters from recorded runs.

The function is `smpl.fit`, in the module `smpl.analysis.fitting`.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path

from smpl._native import CompileError, ScenarioError, SimulationError
from smpl.analysis.fitting import fit
from smpl.analysis.least_squares import DERIVATIVES
from smpl.model import compile


def main(arguments: list[str] | None = None) -> int:
    """Runs the command and returns its exit status: 1 for an invalid file or argument."""
    parser = argparse.ArgumentParser(prog="smpl fit", description="fit parameters of a model to recorded runs")
    parser.add_argument("model", help="model, or the name of a shipped one")
    parser.add_argument(
        "--data", action="append", required=True, metavar="RUN.csv", help="run, or folder of a data set; repeatable"
    )
    parser.add_argument("--parameters", required=True, metavar="NAME,...", help="parameters to fit; NAME=GUESS")
    parser.add_argument("--outputs", metavar="NAME,...", help="observations (or states) to compare")
    parser.add_argument("--initial", default="", metavar="NAME,...", help="states whose start is not known")
    parser.add_argument("--observation", default="default", metavar="LEVEL", help="observation level of the runs")
    parser.add_argument("--scenario", help="scenario of the model, or a YAML file")
    parser.add_argument("--variant", action="append", default=[], help="variant; repeatable")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="parameter or setting")
    parser.add_argument(
        "--noise", action="append", default=[], metavar="NAME=S", help="deviation of an output; repeatable"
    )
    parser.add_argument("--derivatives", choices=DERIVATIVES, default="auto", help="exact, or differences")
    parser.add_argument(
        "--resample", choices=("hold", "linear"), default="hold", help="course of inputs between the times of a table"
    )
    parser.add_argument("--plot", type=Path, metavar="FIT.svg", help="picture of fit and residuals (.svg, .png, .pdf)")
    parser.add_argument("--out", type=Path, metavar="S.yaml", help="write a scenario with the values found")
    given = parser.parse_args(arguments)
    try:
        model = compile(
            given.model,
            scenario=given.scenario,
            variants=given.variant,
            settings=dict(_pair(text) for text in given.set),
            observation=given.observation,
        )
        guesses = {n: float(v) for n, v in (_pair(one) for one in given.parameters.split(",") if "=" in one)}
        names = [one.split("=")[0].strip() for one in given.parameters.split(",")]
        begin = {n: guesses.get(n, model.native.defaults("parameter")[model.parameter_names.index(n)])
                 if n in model.parameter_names else 0.0 for n in names}  # fmt: skip
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            found = fit(
                model, given.data, begin, outputs=_names(given.outputs), initial=_names(given.initial) or (),
                noise={name: float(value) for name, value in map(_pair, given.noise)}, derivatives=given.derivatives,
                resample=given.resample,
            )  # fmt: skip
        if given.plot is not None:
            found.figure().savefig(given.plot)
    except (CompileError, ScenarioError, SimulationError, ImportError, ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    for one in told:
        if not str(one.message).startswith("the runs determine only a combination"):  # the result says it too
            print(f"warning: {one.message}", file=sys.stderr)
    print(found)
    if given.out is not None:
        given.out.write_text(found.scenario(), encoding="utf-8")
    return 0


def _pair(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise ValueError(f"{text!r}, expected NAME=VALUE")
    return name.strip(), value.strip()


def _names(text: str | None) -> list[str] | None:
    return [name.strip() for name in text.split(",")] if text else None


if __name__ == "__main__":
    raise SystemExit(main())
