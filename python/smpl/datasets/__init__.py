"""Data sets: collection, storage in Parquet, layouts, and exchange with the packages of offline learning."""

from smpl.datasets.collecting import collect
from smpl.datasets.layouts import LegacyRows, Transitions, initial_grid, legacy_rows, transitions
from smpl.datasets.loading import Dataset, load
from smpl.datasets.store import DatasetError

__all__ = [
    "Dataset",
    "DatasetError",
    "LegacyRows",
    "Transitions",
    "collect",
    "initial_grid",
    "legacy_rows",
    "load",
    "transitions",
]
