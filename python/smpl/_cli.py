"""The `smpl` command, as a console script."""

from __future__ import annotations

import sys

from smpl import _native


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Args:
        arguments: without the program's name; those of the process by default.
    """
    return _native.main(["smpl", *(sys.argv[1:] if arguments is None else arguments)])


if __name__ == "__main__":
    raise SystemExit(main())
