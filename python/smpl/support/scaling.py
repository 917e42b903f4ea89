"""Quantities in [-1, 1] and in physical units."""

from __future__ import annotations

from typing import Any

import numpy as np

from smpl.support.arguments import FloatArray, as_flag

# Value of `normalize` by which 0 of an action is its nominal value.
NOMINAL = "nominal"


def to_unit(values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Values scaled to [-1, 1]; unchanged with open bounds, 0 if the bounds coincide."""
    bounded = np.isfinite(low) & np.isfinite(high)
    a, b = np.where(bounded, low, -1.0), np.where(bounded, high, 1.0)
    return np.where(b > a, (2 * values - (b + a)) / np.where(b > a, b - a, 1.0), 0.0 * values)


def from_unit(values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """The inverse of `to_unit`: where the bounds are one number, that number."""
    bounded = np.isfinite(low) & np.isfinite(high)
    a, b = np.where(bounded, low, -1.0), np.where(bounded, high, 1.0)
    return (values * (b - a) + b + a) / 2


def to_share(values: FloatArray, low: FloatArray, middle: FloatArray, high: FloatArray) -> FloatArray:
    """Values scaled to -1, 0 and 1 at low, middle and high, linear in between.

    Bounds are finite. Where the middle is a bound, all values beyond it become 0.
    """
    width = np.where(values < middle, middle - low, high - middle)
    return np.divide(values - middle, width, out=np.zeros_like(values), where=width > 0)


def from_share(shares: FloatArray, low: FloatArray, middle: FloatArray, high: FloatArray) -> FloatArray:
    """The inverse of `to_share`; exactly the bounds and the middle at -1, 1 and 0."""
    size = np.abs(shares)
    return (1.0 - size) * middle + size * np.where(shares < 0, low, high)


def as_normalize(value: Any) -> bool | str:
    """An argument `normalize`: a truth value, or `"nominal"`.

    Raises:
        ValueError: it is neither.
    """
    if isinstance(value, str):
        if value != NOMINAL:
            raise ValueError(f"normalize is {value!r}, expected True, False or {NOMINAL!r}")
        return value
    return as_flag("normalize", value)
