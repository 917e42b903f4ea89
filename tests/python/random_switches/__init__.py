"""Random models with events, comparisons and tables, and trajectories of them that are computed elsewhere."""

from .equations import random_equation
from .events import random_event
from .feedback import random_feedback
from .running import GRIDS, METHODS, Case, mismatches

__all__ = ["GRIDS", "METHODS", "Case", "mismatches", "random_equation", "random_event", "random_feedback"]
