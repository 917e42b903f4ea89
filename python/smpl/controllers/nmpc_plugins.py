"""CasADi's solvers of a horizon's programme, with their options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from smpl.controllers.collocation import Programme
from smpl.controllers.nmpc_watch import Watched

# Above so many variables a stage IPOPT's sparse factorisation is faster than fatrop's dense blocks.
WIDE = 60
# Changes of the active set after which a quadratic programme is given up: by `auto`, and where
# `sqp` is chosen.
_CHANGES, _MOST_CHANGES = 30, 100
# Iterations of `sqp` after which it is given up: by `auto` from a warm start, and where it is
# chosen.
_WARM, _MOST = 6, 30
# Interior points that need more iterations go to and fro at a kink.
ENDLESS = 500


@dataclass(frozen=True)
class Settings:
    """Settings of the solvers.

    Attributes:
        name: of the controller's `solver`.
        tolerance, iterations, budget: as of `NMPC`.
    """

    name: str
    tolerance: float
    iterations: int | None
    budget: float | None


def plugin(name: str, programme: Programme, settings: Settings) -> Watched:
    """A solver of a programme: `fatrop`, `ipopt`, `ipopt_warm` or `sqp`."""
    import casadi as ca

    functions = programme.functions
    # Evaluations that fail are reported by the result, not on the screen.
    quiet: dict[str, Any] = {"print_time": False, "show_eval_warnings": False, "error_on_fail": False}
    quiet["calc_lam_p"] = False
    options = {"fatrop": _fatrop, "ipopt": _ipopt, "ipopt_warm": _ipopt_warm, "sqp": _sqp}[name](programme, settings)
    kind = {"sqp": "sqpmethod", "ipopt_warm": "ipopt"}.get(name, name)

    def make(further: Mapping[str, Any]) -> Any:
        return ca.nlpsol("horizon", kind, functions, {**quiet, **options, **further})

    sizes = tuple(int(functions[key].numel()) for key in ("x", "g", "p"))
    return Watched(make, (sizes[0], sizes[1], sizes[2]), kind != "fatrop")


def _fatrop(programme: Programme, settings: Settings) -> dict[str, Any]:
    options: dict[str, Any] = {"print_level": 0, "tolerance": settings.tolerance}
    options["max_iter"] = settings.iterations or ENDLESS
    return {"fatrop": options, **programme.structure}


def _ipopt(programme: Programme, settings: Settings) -> dict[str, Any]:
    options: dict[str, Any] = {"print_level": 0, "sb": "yes", "tol": settings.tolerance, "max_iter": ENDLESS}
    if max(programme.structure["nu"]) > WIDE:
        options["mumps_pivot_order"] = 0  # minimum degree orders a long band better than what MUMPS chooses
    if settings.budget is not None:
        options["max_wall_time"] = settings.budget
    if settings.iterations is not None and settings.name == "ipopt":
        options["max_iter"] = settings.iterations
    return {"ipopt": options}


def _ipopt_warm(programme: Programme, settings: Settings) -> dict[str, Any]:
    """IPOPT from a point near the solution and its multipliers."""
    options = _ipopt(programme, settings)["ipopt"]
    push = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac", "mult_bound_push")
    options |= {f"warm_start_{name}": 1e-6 for name in push}
    return {"ipopt": {**options, "warm_start_init_point": "yes", "mu_init": 1e-4}}


def _sqp(programme: Programme, settings: Settings) -> dict[str, Any]:
    quiet = {"print_header": False, "print_iteration": False, "print_status": False}
    inner = {"print_time": False, "print_iter": False, "print_header": False, "print_info": False}
    auto = settings.name == "auto"
    return {
        **quiet,
        "qpsol": "qrqp",
        "qpsol_options": {**inner, "error_on_fail": False, "max_iter": _CHANGES if auto else _MOST_CHANGES},
        "max_iter": settings.iterations or (_WARM if auto else _MOST),
        "tol_pr": settings.tolerance,
        "tol_du": settings.tolerance,
    }
