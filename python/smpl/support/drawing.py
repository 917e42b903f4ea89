"""Pictures of models."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

from smpl import _native
from smpl._native import Picture

if TYPE_CHECKING:
    from smpl.model import Model

# Steps of the episode that a model shows of itself in a notebook.
_MOST_STEPS = 200


def names(show: str | Sequence[str]) -> list[str]:
    """Names to be shown: one, or several."""
    return [show] if isinstance(show, str) else list(show)


def of_model(model: Model, show: str | Sequence[str] = ()) -> Picture:
    """An episode of the model with its nominal policy, at most 200 steps of it."""
    return _native.nominal_picture(model.native, names(show), _MOST_STEPS)


def model_as_html(model: Model) -> str:
    """View of a model in a notebook: text, names with units, an episode."""
    roles = ("action", "observation", "state", "algebraic", "discrete", "reward")
    rows = "".join(_row(model, role) for role in roles)
    title = html.escape(f"{model.name}: {model.text}" if model.text else model.name)
    try:
        picture = of_model(model)._repr_html_()
    except (_native.SimulationError, ValueError) as error:
        picture = f"<p>{html.escape(str(error))}</p>"
    return f"<div><b>{title}</b><table>{rows}</table>{picture}</div>"


def _row(model: Model, role: str, most: int = 20) -> str:
    named = getattr(model, f"{role}_names")
    if not named:
        return ""
    units = getattr(model, f"{role}_units", ("1",) * len(named))
    shown = [name if unit == "1" else f"{name} [{unit}]" for name, unit in list(zip(named, units, strict=False))[:most]]
    if len(named) > most:
        shown.append(f"... ({len(named)} in all)")
    return f"<tr><th>{role}s</th><td style='text-align:left'>{html.escape(', '.join(shown))}</td></tr>"
