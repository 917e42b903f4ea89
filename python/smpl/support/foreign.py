"""Detection of another project that is also distributed and imported as `smpl`."""

from __future__ import annotations

from pathlib import Path

# Files of the other project that this package does not have.
_MARKS = ("_version.py", "functions.py", "plot2d.py")


def check(folder: Path | None = None) -> None:
    """Refuse to run where the files of another project are mixed with those of this package.

    Args:
        folder: the package's folder; that of this file by default.

    Raises:
        ImportError: the folder has files of the distribution `smpl`; the message has the commands
            that separate them.
    """
    folder = Path(__file__).parents[1] if folder is None else folder
    if any((folder / name).is_file() for name in _MARKS):
        raise ImportError(
            f"{folder} holds files of the distribution `smpl`, a different project that also imports as `smpl`: "
            "run `pip uninstall smpl smpl-process`, then install `smpl-process` again, in an environment without `smpl`"
        )
