"""Random models with an independent evaluation."""

from .model import PartedModel, RandomModel
from .space import RandomSpace
from .terms import Key, Number, World, flat, real

__all__ = ["Key", "Number", "PartedModel", "RandomModel", "RandomSpace", "World", "flat", "real"]
