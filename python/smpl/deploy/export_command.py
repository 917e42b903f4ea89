"""`smpl export-policy POLICY --env ENV --to c|onnx|fmu -o FILE`: a policy for another system."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from smpl.collect import add_normalize, add_problem, environment, guarded, once
from smpl.deploy.export import TARGETS, export_policy


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status: 1 if the policy cannot be exported."""
    parser = argparse.ArgumentParser("smpl export-policy", description="Write a controller or policy as a program.")
    once(parser)
    parser.add_argument(
        "policy", metavar="POLICY", help="lqr, pid, nominal, constant:26.85,0.1, MODULE:NAME, PPO:FILE.zip, FILE.pt"
    )
    parser.add_argument("--env", required=True, metavar="ENV", help="id, name or path of the model")
    parser.add_argument("--to", required=True, choices=tuple(TARGETS), help="language or format")
    parser.add_argument("-o", "--out", required=True, metavar="FILE", help="file, ending in .c, .onnx or .fmu")
    parser.add_argument("--physical", dest="normalize", action="store_const", const="false", help=argparse.SUPPRESS)
    add_problem(parser)
    add_normalize(parser)
    given = parser.parse_args(arguments)

    def export() -> int:
        print(export_policy(given.policy, given.env, given.to, given.out, **environment(given)))
        return 0

    return guarded(export)


if __name__ == "__main__":
    raise SystemExit(main())
