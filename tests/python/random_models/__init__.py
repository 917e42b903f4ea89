"""Random models with an evaluation of their own."""

from .model import RandomModel
from .terms import Key, Number, World, flat, real

__all__ = ["Key", "Number", "RandomModel", "World", "flat", "real"]
