"""Tracks of the benchmark: the same processes with different information for the learner."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

RESIDUAL = "residual"
# Quick controls, which a track with its own episodes runs; those that need the observations of the
# level `online` alone.
_OBSERVERS = ("nominal", "constant", "open_loop", "pi", "isothermal", "profile", "recipe")
_QUICK = (*_OBSERVERS, "pid", "lqr", "feedback")
# Learners by derivatives and the processes that they train; predictive control needs weights to
# begin with.
DERIVED = {"SHAC": ("Reactor", "Beer", "PenSim", "Atropine", "MAb", "MAbPlant"), "DiffNMPC": ("Reactor",)}


@dataclass(frozen=True)
class Track:
    """A track.

    Attributes:
        what: description.
        bare: without the formulation and the training reward of `benchmark.yaml`.
        arguments: of the environment, in training and in the scores.
        ranges: process to parameter to its ranges in training and in the test.
        learners: one on-policy and one off-policy algorithm that represent the track.
        processes: with this track; all if empty.
        controls: names of the controls that run in a track with its own episodes.
    """

    what: str
    bare: bool = False
    arguments: Mapping[str, Any] = field(default_factory=dict)
    ranges: Mapping[str, Mapping[str, Mapping[str, tuple[float, float]]]] = field(default_factory=dict)
    learners: tuple[str, ...] = ("PPO", "SAC")
    processes: tuple[str, ...] = ()
    controls: tuple[str, ...] = _QUICK


# Ranges of the test contain those of the training and as much again on each side.
RANGES = {
    "Reactor": {
        "train": {"U": (52.2, 57.7), "T_f": (76.0, 77.7)},
        "test": {"U": (49.4, 60.4), "T_f": (75.1, 78.6)},
    },
    # The rate of growth, by a twentieth and by a tenth.
    "Beer": {"train": {"a_mu_x0": (108.26, 108.36)}, "test": {"a_mu_x0": (108.21, 108.41)}},
}
TRACKS = {
    RESIDUAL: Track(
        "the formulation of `benchmark.yaml`: corrections of a controller where it has a `centre` "
        "(reactor, PenSim, atropine, MAb, plant), shaped rewards"
    ),
    "raw": Track("the task of the paper: actions, observations and rewards of the environment, nothing given", True),
    "partial": Track(
        "observation level `online`: noise and hidden states",
        True,
        {"observation": "online"},
        processes=("Reactor", "Beer", "PenSim", "Atropine", "MAb"),
        controls=_OBSERVERS,
    ),
    "constrained": Track(
        "the residual track with cost: return against summed constraint violation of every row; "
        "the suites contain no learner with a cost limit",
        learners=(),
    ),
    "generalisation": Track(
        "parameters drawn per episode: narrow ranges in training, ranges of twice the width in the test",
        ranges=RANGES,
        processes=("Reactor", "Beer"),
    ),
}


def of(name: str, env: str) -> Track:
    """The track of a name, for an environment.

    Raises:
        ValueError: an unknown track, a track that is not trained, or an environment without it.
    """
    track = _known(name)
    if track.processes and env not in track.processes:
        raise ValueError(f"track {name!r} has no process {env!r}; it has: {', '.join(track.processes)}")
    if not track.learners:
        raise ValueError(f"track {name!r} is a table of the rows of the track {RESIDUAL!r}; it is not trained")
    return track


def of_controls(name: str) -> str:
    """The track whose controls have the task and the episodes of a track.

    Raises:
        ValueError: an unknown track.
    """
    track = _known(name)
    return name if track.arguments or track.ranges else RESIDUAL


def in_track(name: str, env: str, settings: Mapping[str, Any], learned: bool = True) -> dict[str, Any]:
    """Settings of a run in a track; those of training only for learned policies."""
    track, found = of(name, env), dict(settings)
    if track.bare and learned:
        found |= {"train": {}, "formulation": {}}
        found.pop("scalers", None)
    if env in track.ranges:
        ranges = track.ranges[env]
        if learned:
            found["curriculum"] = {key: [[0.0, *ends]] for key, ends in ranges["train"].items()}
        found["randomize"] = {key: list(ends) for key, ends in ranges["test"].items()}
    return found


def _known(name: str) -> Track:
    if name not in TRACKS:
        raise ValueError(f"track is {name!r}; there are: {', '.join(TRACKS)}")
    return TRACKS[name]
