"""`smpl verify RESULT`: replays the episodes of a result and compares the scores."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from smpl.collect import guarded, once
from smpl.deploy.replay import verify


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status: 0 if all scores agree, else 1."""
    parser = argparse.ArgumentParser(
        "smpl verify", description="Replay the episodes of a result and compare returns, lengths and failures."
    )
    once(parser)
    parser.add_argument("result", metavar="RESULT", help="result.json, or the folder that smpl.evaluate --out wrote")
    parser.add_argument("--policy", metavar="FILE", help="run this policy instead, such as an exported one")
    parser.add_argument("--controller", metavar="NAME", help="only the controller of this name")
    parser.add_argument("--episodes", type=int, metavar="N", help="only the first N episodes")
    parser.add_argument(
        "--tolerance", type=float, metavar="T", help="relative, of returns; default: 1e-6, with --policy 1e-4"
    )
    parser.add_argument("--workers", type=int, metavar="W", help="threads or processes; default: all processors")
    given = parser.parse_args(arguments)

    def run() -> int:
        given.__dict__.pop("_seen", None)
        replays = verify(**vars(given))
        for one in replays:
            for note in one.notes:
                print(f"warning: {note}", file=sys.stderr)
            agrees = f"{one.episodes} episodes agree, largest difference of a return {one.worst:.2g}"
            print(f"{one.name}: {one.difference or agrees}")
        return int(any(one.difference for one in replays))

    return guarded(run)


if __name__ == "__main__":
    raise SystemExit(main())
