"""`python -m smpl.benchmark historical present|offline|online DIR`: pinned environments.

`present` and `online` have this smpl too, by a link to its folder; `offline` needs none of it.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import smpl
import smpl_benchmarks

# Version of Python, what is installed first, and what after it without dependencies.
ENVIRONMENTS: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
    "present": ("3.11", (), ()),
    # Packages of that time are built by tools of that time.
    "offline": ("3.9", ("setuptools<66", "wheel<0.40"), ()),
    "online": ("3.10", ("setuptools<70", "wheel<0.40"), ("gymnasium==1.0.0",)),
}


def make(which: str, folder: Path, python: str | None = None) -> Path:
    """Make a virtual environment; returns its Python.

    Raises:
        ValueError: the Python that it needs is not there.
        subprocess.CalledProcessError: a package cannot be installed.
    """
    version, before, after = ENVIRONMENTS[which]
    found = shutil.which(python or f"python{version}")
    told = "" if found is None else _version(found)
    if found is None or told != version:
        has = f"{found} is {told}" if found else f"{python or f'python{version}'} is not there"
        raise ValueError(f"the environment {which!r} needs Python {version} ({has}): give --python PATH")
    subprocess.run([found, "-m", "venv", str(folder)], check=True)
    inside = folder / "bin" / "python"
    install = [str(inside), "-m", "pip", "install"]
    if before:
        subprocess.run([*install, *before], check=True)
    subprocess.run([*install, "-r", str(Path(__file__).with_name(f"{which}.txt"))], check=True)
    if after:
        subprocess.run([*install, "--no-deps", *after], check=True)
    if which != "offline":
        link(inside)
    return inside


def link(inside: Path) -> None:
    """Installs this smpl (with a stable ABI) and its benchmark in an environment."""
    code = "import sysconfig; print(sysconfig.get_path('purelib'))"
    packages = subprocess.run([str(inside), "-c", code], check=True, capture_output=True, text=True).stdout.strip()
    for package in (smpl, smpl_benchmarks):
        link = Path(packages) / package.__name__
        if link.is_symlink():
            link.unlink()
        link.symlink_to(Path(str(package.__file__)).resolve().parent)


def _version(python: str) -> str:
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    return subprocess.run([python, "-c", code], check=True, capture_output=True, text=True).stdout.strip()


def main(arguments: Sequence[str] | None = None) -> int:
    """Make what the command line says; the exit status is 1 where it cannot be done."""
    parser = argparse.ArgumentParser("python -m smpl.benchmark historical", description="Pinned environments.")
    parser.add_argument("which", choices=tuple(ENVIRONMENTS))
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--python", metavar="PATH", help="the Python to make it with")
    given = parser.parse_args(arguments)
    try:
        print(make(given.which, given.folder, given.python))
    except (ValueError, OSError, subprocess.CalledProcessError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
