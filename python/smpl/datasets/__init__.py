"""Data sets: collection, storage in Parquet, layouts, and exchange with other packages."""

from smpl.datasets.collecting import collect
from smpl.datasets.exports import d3rlpy_arrays, to_d3rlpy, to_d4rl, to_hdf5, to_minari, to_torch
from smpl.datasets.imports import from_legacy, from_pensim_csv
from smpl.datasets.layouts import LegacyRows, Transitions, legacy_rows, transitions
from smpl.datasets.loading import Dataset, load
from smpl.datasets.store import DatasetError
from smpl.learning.grids import initial_grid

__all__ = [
    "Dataset",
    "DatasetError",
    "LegacyRows",
    "Transitions",
    "collect",
    "d3rlpy_arrays",
    "from_legacy",
    "from_pensim_csv",
    "initial_grid",
    "legacy_rows",
    "load",
    "to_d3rlpy",
    "to_d4rl",
    "to_hdf5",
    "to_minari",
    "to_torch",
    "transitions",
]
