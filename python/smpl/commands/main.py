"""The `smpl` command, as a console script."""

from __future__ import annotations

import importlib
import signal
import sys
import threading

from smpl import _native
from smpl.support.foreign import check

# Commands of this package, with the modules that run them; the compiled command has the others.
COMMANDS = {
    "fit": "smpl.commands.fit",
    "export-policy": "smpl.deploy.export_command",
    "serve": "smpl.serve",
    "verify": "smpl.deploy.verify_command",
}


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Args:
        arguments: without the program's name; those of the process by default.
    """
    check()  # the `__init__` of another project may have replaced the one that does this
    command = ["smpl", *(sys.argv[1:] if arguments is None else arguments)]
    module = COMMANDS.get(command[1]) if len(command) > 1 else None
    if module is not None:
        done: int = importlib.import_module(module).main(command[2:])
        return done
    if threading.current_thread() is not threading.main_thread():
        return _native.main(command)
    # Ctrl-C ends the command at once, as it does without Python.
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        return _native.main(command)
    finally:
        signal.signal(signal.SIGINT, before)


if __name__ == "__main__":
    raise SystemExit(main())
