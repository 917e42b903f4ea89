"""Places of the page of results for rows outside the main tables: more seeds, other tracks."""

from __future__ import annotations

from collections.abc import Sequence

from smpl_benchmarks.cells import compared_with, episodes_of, gain, number, share
from smpl_benchmarks.common import SEEDS
from smpl_benchmarks.comparison import LEARNED, Comparison, compare, figures
from smpl_benchmarks.pages import grid
from smpl_benchmarks.records import Result
from smpl_benchmarks.tracks import DERIVED, RESIDUAL, TRACKS, Track, of_controls


def seeds(every: Sequence[Comparison]) -> str:
    """Rows with more training seeds than the main tables, with controls on as many blocks."""
    head = ["process", "suite", "row", "episodes", "return", "gain", "IQM", "worst seed", "row - control"]
    lines, short = [], []
    for one in every:
        short += [f"{one.env} {name} ({why})" for name, why in sorted(one.short.items())]
        lines += _of_more_seeds(one) if one.further else []
    text = grid(head, lines, left=3) if lines else f"No row is compared on more than {SEEDS} training seeds.\n"
    return text + (f"\nNot on all blocks, and therefore not compared: {'; '.join(short)}.\n" if short else "")


def _of_more_seeds(one: Comparison) -> list[list[str]]:
    """Rows of a process on all blocks, by their gain; the selected control is marked."""
    wide, selected = one.widest([]), one.selected(("control",))
    control = None if selected is None else wide.row_of(selected)
    lines = []
    for row in sorted(wide.rows, key=lambda row: -float(row.returns.mean())):
        if row is not wide.nominal:
            mine = figures(wide.nominal, row, None)
            lines.append(
                [
                    one.env, row.suite, row.controller, episodes_of(row), f"{mine['return']:.5g}", gain(mine),
                    f"{mine['iqm']:+.4g}", f"{mine['worst']:+.4g}", compared_with(row, control),
                ]
            )  # fmt: skip
    return lines


def tracks(results: Sequence[Result], every: Sequence[Comparison]) -> str:
    """Rows of the tracks with the selected control of each, and commands for those not run."""
    head = ["track", "process", "row", "episodes", "return", "gain", "row - control", "at a limit", "failures"]
    lines: list[list[str]] = []
    left: list[str] = []
    commands: list[str] = []
    for name, track in TRACKS.items():
        if name == RESIDUAL or not track.learners:
            continue
        mine = _of_track(name, results)
        envs = list(track.processes) or [one.env for one in every]
        for env in envs:
            rows, lacking = _of_process(name, env, mine)
            lines += rows
            left += lacking
        commands += _missing(name, track, envs, mine)
    main = [one for one in results if one.run.track == RESIDUAL]
    for learner, able in DERIVED.items():
        envs = [one.env for one in every if one.env in able and not _has(main, one.env, learner)]
        commands += _commands("online", RESIDUAL, envs, [learner])
    text = grid(head, lines, left=3) if lines else ""
    if left:
        text += f"\nWithout all episodes or without the nominal policy on them, not compared: {'; '.join(left)}.\n"
    if commands:
        text += "\nNot run at this budget:\n\n```sh\n" + "\n".join(commands) + "\n```\n"
    return text


def _of_track(name: str, results: Sequence[Result]) -> list[Result]:
    """Learned results of a track, and controls on its episodes."""
    where = {"control": of_controls(name), "online": name}
    return [one for one in results if where.get(one.run.suite) == one.run.track]


def _of_process(name: str, env: str, mine: Sequence[Result]) -> tuple[list[list[str]], list[str]]:
    """Rows of a process in a track, and those that are not compared."""
    learned = dict.fromkeys(one.run.controller for one in mine if (one.run.env, one.run.suite) == (env, "online"))
    if not learned:
        return [], []
    one = compare(env, mine)
    if one is None:
        return [], [f"{name} {env} {learner} (no nominal policy)" for learner in learned]
    control = one.selected(("control",))
    shown = [row for row in one.rows if row.suite in LEARNED or row is control]
    lines = []
    for row in sorted(shown, key=lambda row: -float(row.returns.mean())):
        numbers = figures(one.nominal, row, None)
        lines.append(
            [
                name, env, row.controller, episodes_of(row), f"{numbers['return']:.5g}", gain(numbers),
                compared_with(row, control), share(numbers["at_limit"]), number(numbers["failures"]),
            ]
        )  # fmt: skip
    left = [
        f"{name} {env} {learner} ({one.left[key]})" for learner in learned if (key := f"online {learner}") in one.left
    ]
    return lines, left


def _missing(name: str, track: Track, envs: Sequence[str], mine: Sequence[Result]) -> list[str]:
    """Commands for the learners and controls of a track without a record."""
    missing: dict[tuple[str, ...], list[str]] = {}
    for env in envs:
        missing.setdefault(tuple(one for one in track.learners if not _has(mine, env, one)), []).append(env)
    commands = [one for learners, where in missing.items() for one in _commands("online", name, where, learners)]
    bare = [env for env in envs if not _has(mine, env, "nominal")] if of_controls(name) == name else []
    return [*commands, *_commands("control", name, bare)]


def _has(results: Sequence[Result], env: str, controller: str) -> bool:
    return any((one.run.env, one.run.controller) == (env, controller) for one in results)


def _commands(suite: str, track: str, envs: Sequence[str], learners: Sequence[str] = ()) -> list[str]:
    """The command of learners or of all controls; empty without processes or learners to run."""
    if not envs or (suite == "online" and not learners):
        return []
    which = " ".join([*(f"--env {env}" for env in envs), *(f"--algorithm {learner}" for learner in learners)])
    return [
        f"python -m smpl.benchmark --suite {suite} --budget short --track {track} {which} "
        "--out runs --resume --results docs/results/benchmark"
    ]
