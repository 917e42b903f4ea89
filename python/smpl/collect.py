"""`python -m smpl.collect ENV --controller NAME --episodes N --out DIR`: collects a data set."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any

from smpl._native import CompileError
from smpl.datasets import collect

_NORMALIZE: dict[str, bool | str] = {"true": True, "false": False, "nominal": "nominal"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Collect as the command line says; the exit status is 1 where it cannot be done."""
    parser = argparse.ArgumentParser("python -m smpl.collect", description="A data set from any controller.")
    once(parser)
    add_environment(parser)
    parser.add_argument(
        "--out", required=True, metavar="DIR", help="folder of the data set; what it has is not run again"
    )
    parser.add_argument("--weights", nargs="+", type=float, default=(), metavar="W", help="shares of the controllers")
    parser.add_argument("--workers", type=int, metavar="W", help="threads or processes; default: all processors")
    add_ray(parser)
    parser.add_argument("--noise", type=float, default=0.0, help="standard deviation of noise on actions in [-1, 1]")
    parser.add_argument("--epsilon", type=float, default=0.0, help="probability of a random action at each step")
    parser.add_argument("--randomize", action="append", default=[], metavar="NAME=LOW..HIGH", help="draw a parameter")
    parser.add_argument("--states", nargs="*", metavar="NAME", help="keep the states: all, or those that are named")
    parser.add_argument("--part", type=int, metavar="N", help="episodes a file")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    given = parser.parse_args(arguments)
    return guarded(lambda: _collect(given))


def _collect(given: argparse.Namespace) -> int:
    states = given.states is not None if not given.states else given.states
    dataset = collect(
        given.env,
        given.controller or ["nominal"],
        given.episodes,
        given.out,
        seed=given.seed,
        workers=given.workers,
        starts=given.starts,
        weights=given.weights,
        noise=given.noise,
        epsilon=given.epsilon,
        randomize=dict(_range(text) for text in given.randomize),
        states=states,
        part=given.part,
        progress=not given.quiet,
        ray=given.ray,
        **environment(given),
    )
    print(f"{len(dataset)} episodes in {dataset.folder}")
    return 0


class _Once(argparse.Action):
    """An option that takes one value, and says so where it is given two."""

    def __call__(
        self, parser: argparse.ArgumentParser, given: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        seen: set[str] = given.__dict__.setdefault("_seen", set())
        if self.dest in seen:
            raise argparse.ArgumentError(self, "is given twice, expected once")
        seen.add(self.dest)
        setattr(given, self.dest, values)


def once(parser: argparse.ArgumentParser) -> None:
    """Refuse options that are given twice, where argparse would keep the last without a word."""
    parser.register("action", None, _Once)


def add_environment(parser: argparse.ArgumentParser) -> None:
    """Arguments that say which environment, which controllers and which episodes."""
    parser.add_argument("env", metavar="ENV", help="smpl/Reactor-v0, the name of a model, or a path of one")
    parser.add_argument("--controller", action="append", metavar="NAME", help="a name, MODULE:NAME, PPO:FILE.zip, ...")
    parser.add_argument("--episodes", type=int, required=True, metavar="N")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the first episode; the i-th has S + i")
    parser.add_argument("--starts", metavar="WHICH", help="sampled, grid:D:N, unclipped_grid:D:N, spread:D, FILE.csv")
    add_problem(parser)
    add_normalize(parser)


def add_problem(parser: argparse.ArgumentParser) -> None:
    """Arguments of the environment, which `environment` reads."""
    parser.add_argument("--scenario", metavar="NAME")
    parser.add_argument("--variant", action="append", metavar="NAME", help="repeatable")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="repeatable")
    parser.add_argument("--reward", metavar="NAME")
    parser.add_argument("--observation", metavar="LEVEL")
    parser.add_argument("--max-steps", type=int, metavar="N")


def add_normalize(parser: argparse.ArgumentParser) -> None:
    """Scale of the actions and observations that a policy was trained with."""
    parser.add_argument(
        "--normalize", choices=_NORMALIZE, help="scale of actions and observations, as of `smpl.Env`; default: true"
    )


def add_ray(parser: argparse.ArgumentParser) -> None:
    """The cluster that runs the work."""
    parser.add_argument(
        "--ray", metavar="ADDRESS", help="run on a cluster of Ray: auto for the one that runs here, local, HOST:PORT"
    )


def environment(given: argparse.Namespace) -> dict[str, Any]:
    """Arguments of the environment."""
    settings = dict(_setting(text) for text in given.set)
    chosen = getattr(given, "normalize", None)
    normalize = {} if chosen is None else {"normalize": _NORMALIZE[chosen]}
    return {
        "scenario": given.scenario,
        "variants": tuple(given.variant) if given.variant else None,
        "settings": settings or None,
        "reward": given.reward,
        "observation": given.observation,
        "max_steps": given.max_steps,
        **normalize,
    }


def guarded(work: Any) -> int:
    """Runs the command; reports errors of the user in one line, with exit status 1."""
    try:
        return int(work())
    except (ValueError, TypeError, ImportError, RuntimeError, CompileError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("stopped; the same command goes on", file=sys.stderr)
        return 130


def _setting(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise ValueError(f"--set {text}: expected NAME=VALUE")
    return name, value


def _range(text: str) -> tuple[str, tuple[float, float]]:
    name, equals, ends = text.partition("=")
    low, dots, high = ends.partition("..")
    try:
        if not (equals and dots):
            raise ValueError
        return name, (float(low), float(high))
    except ValueError:
        raise ValueError(f"--randomize {text}: expected NAME=LOW..HIGH") from None


if __name__ == "__main__":
    raise SystemExit(main())
