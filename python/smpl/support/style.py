"""Colours, type and number format of figures and reports, as in run pictures."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from smpl.support.optional import load

# The qualitative colours of Okabe and Ito (2008) without yellow, as in colour.rs.
BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY = "#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7", "#56b4e9"
INK, GREY, AXIS, GRID = "#1e1e1e", "#696969", "#8c8c8c", "#e4e4e4"
CURVES = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, INK, "#787878")
BOUND = {"color": "#5a5a5a", "linewidth": 1.0, "linestyle": (0, (5, 3))}
# For HTML; the first is the font of run pictures.
FONTS = "'DejaVu Sans Condensed','DejaVu Sans',Arial,Helvetica,sans-serif"
# Inches; every figure of a report has this width.
WIDTH = 9.0

_SETTINGS = {
    "font.family": ["DejaVu Sans"],
    "font.size": 8.0,
    "axes.titlesize": 9.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.titlepad": 5.0,
    "axes.labelsize": 8.0,
    "axes.labelcolor": GREY,
    "axes.edgecolor": AXIS,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "axes.axisbelow": True,
    "axes.formatter.use_mathtext": True,
    "axes.unicode_minus": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": AXIS,
    "ytick.color": AXIS,
    "xtick.labelcolor": GREY,
    "ytick.labelcolor": GREY,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "text.color": INK,
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "figure.constrained_layout.w_pad": 0.12,
    "figure.constrained_layout.h_pad": 0.08,
    "svg.hashsalt": "smpl",
}


def styled() -> Any:
    """Context in which figures are made and saved, with the colours and the type of run pictures.

    Raises:
        ImportError: Matplotlib is missing.
    """
    matplotlib = load("matplotlib", "a figure")
    return matplotlib.rc_context({**_SETTINGS, "axes.prop_cycle": matplotlib.cycler(color=CURVES)})


def colour(index: int) -> str:
    """Colour of the curve of that number."""
    return CURVES[index % len(CURVES)]


def dashes(index: int) -> str:
    """Line style of a curve by its number: solid in the first round of colours, then dashed."""
    return ("-", "--", ":", "-.")[index // len(CURVES) % 4]


def diverging() -> Any:
    """Colour map from vermilion over grey, which is visible on white, to blue."""
    colors = load("matplotlib.colors", "a figure")
    return colors.LinearSegmentedColormap.from_list("smpl", [VERMILION, "#f0b98f", "#a8a8a8", "#8fbfdc", BLUE])


def ticks_of(axis: Any, least: int = 2) -> None:
    """Give both coordinates of a panel at least that many ticks; one gives no scale."""
    from matplotlib.ticker import MaxNLocator

    for one in (axis.xaxis, axis.yaxis):
        if one.get_scale() == "linear" and isinstance(one.get_major_locator(), MaxNLocator):
            one.get_major_locator().set_params(min_n_ticks=least)


def heading(axis: Any, name: str, unit: str = "", note: str = "") -> None:
    """Write name, unit and a note above a panel."""
    written = typeset(unit)
    title = axis.set_title(f"{name}  [{written}]" if written else name)
    if note:
        axis.annotate(
            note, (1, 0), (8, 0), xycoords=title, textcoords="offset points", color=GREY, fontsize=7.5, va="bottom"
        )


def legend(figure: Any, axis: Any) -> None:
    """Writes the names of several curves of a panel in one line above all panels."""
    handles, labels = axis.get_legend_handles_labels()
    if len(labels) > 1:
        figure.legend(handles, labels, loc="outside upper left", ncols=min(len(labels), 5))


def widen(set_scale: Any, values: Sequence[float], decades: int = 12) -> None:
    """Sets a symmetric logarithmic scale if one curve is far below the others."""
    sizes = np.abs(values)
    if not len(sizes):
        return
    small = max(float(np.quantile(sizes, 0.1)), float(sizes.max()) / 10**decades)
    if small and np.ptp(values) > 100 * small:
        set_scale("symlog", linthresh=10.0 ** np.ceil(np.log10(small)))  # a decade, where the scale has its marks


_MINUS, _TIMES, _DASH = "\u2212", "\u00d7", "\u2013"
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PREFIXES = {"p": -12, "n": -9, "µ": -6, "m": -3, "": 0, "k": 3, "M": 6, "G": 9, "T": 12}
# Units that take prefixes, with the largest power that is in use.
_PREFIXED = {
    "g": 3, "m": 3, "L": 0, "s": 0, "K": 0, "mol": 3, "Pa": 9, "bar": 0, "J": 12, "W": 12, "N": 9, "V": 6, "A": 6,
    "Hz": 12, "Wh": 12, "M": 0,
}  # fmt: skip


def number(value: float, digits: int = 4) -> str:
    """A number with so many significant digits: `0.659`, `1235`, `2.43e6`.

    Integers are written in full below a million; a power of ten replaces more than six digits or
    four leading zeros.
    """
    if isinstance(value, int) and abs(value) < 10**6:
        return str(value).replace("-", _MINUS)
    if not math.isfinite(value):
        return _DASH if math.isnan(value) else ("∞" if value > 0 else f"{_MINUS}∞")
    if value == 0:
        return "0"
    mantissa, power = f"{value:.{digits - 1}e}".split("e")
    exponent = int(power)
    if -4 <= exponent < 6:
        text = _trimmed(f"{value:.{max(digits - 1 - exponent, 0)}f}")
    else:
        raised = f"10{str(exponent).translate(_SUPERSCRIPTS)}"
        factor = _trimmed(mantissa)
        text = {"1": raised, "-1": f"-{raised}"}.get(factor, f"{factor}{_TIMES}{raised}")
    return text.replace("-", _MINUS)


def plain(text: str) -> str:
    """Numbers of a text as programs read them, with the hyphen for a minus sign."""
    return text.replace(_MINUS, "-")


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """A number with its unit and an SI prefix instead of a power of ten: `4.96 µs`, `4.2 MJ/kg`."""
    size = abs(value)
    written = typeset(unit)
    if size and math.isfinite(size) and not 1e-1 <= size < 1e4:
        power = 3 * math.floor(float(f"{math.log10(size):.9f}") / 3)
        prefixed = _prefixed(written, power)
        if prefixed:
            return f"{number(value / 10.0**power, digits)} {prefixed}"
    return f"{number(value, digits)} {written}".rstrip()


def interval(low: float, high: float, digits: int = 4) -> str:
    """The ends of an interval."""
    return f"{number(low, digits)} to {number(high, digits)}"


def typeset(unit: str) -> str:
    """A unit as printed: `m³`, `°C`; empty for that of numbers."""
    if unit in ("", "1"):
        return ""
    raised = re.sub(r"\^(-?\d+)(?![\d.])", lambda found: found[1].translate(_SUPERSCRIPTS), unit)
    return raised.replace("degC", "°C").replace("degF", "°F")


def _prefixed(unit: str, power: int) -> str | None:
    """The unit `10**power` times as large with a prefix; None where its first symbol takes none."""
    found = re.match(r"[^\W\d_⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", unit)
    if not found or unit[found.end() :].startswith(("^", *"⁻⁰¹²³⁴⁵⁶⁷⁸⁹")) or found[0] in ("min", "h", "d"):
        return None
    symbol, rest = found[0], unit[found.end() :]
    splits: Sequence[tuple[str, str]] = [("", symbol), (symbol[0], symbol[1:])]
    for prefix, base in splits:
        if base in _PREFIXED and prefix in _PREFIXES:
            wanted = _PREFIXES[prefix] + power
            fits = [name for name, exponent in _PREFIXES.items() if exponent == wanted <= _PREFIXED[base]]
            return f"{fits[0]}{base}{rest}" if fits else None
    return None


def _trimmed(text: str) -> str:
    return text.rstrip("0").rstrip(".") if "." in text else text
