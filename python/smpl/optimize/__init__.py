"""Optimisation of models: steady states with exact derivatives, and whole episodes by simulation.

from smpl import optimize
found = optimize.steady("reactor", maximize="q_in*c_Af - q_out*c_A", vary=["T_c"], fixed={"h": 0.6})
found = optimize.episode("beer", vary={"T": (9, 16)}, moves=6, file="beer.csv")
"""

from smpl.optimize.episodes import EpisodeOptimum, EpisodeOptions, episode
from smpl.optimize.search import METHODS, Search
from smpl.optimize.steady import SteadyOptimum, SteadyOptions, steady

__all__ = [
    "METHODS",
    "EpisodeOptimum",
    "EpisodeOptions",
    "Search",
    "SteadyOptimum",
    "SteadyOptions",
    "episode",
    "steady",
]
