"""Quantities in [-1, 1] and in physical units."""

from __future__ import annotations

import numpy as np

from smpl.support.arguments import FloatArray


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
