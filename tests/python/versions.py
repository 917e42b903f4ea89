"""Run the tests of Gymnasium's conventions under several of its releases, each in its own virtual environment.

python tests/python/versions.py dist/smpl_process-*.whl [--folder DIR] [VERSION ...]
"""

import argparse
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

VERSIONS = ("1.0.0", "1.2.2", "1.4.0")
TESTS = ("test_gymnasium.py", "test_vector.py", "test_env.py")


def check(version, wheel, folder):
    """Exit status of the tests under one release."""
    place = folder / f"gymnasium-{version}"
    if not place.exists():
        venv.create(place, with_pip=True)
    python = place / "bin" / "python"
    packages = ["--force-reinstall", "--no-deps", str(wheel)]
    install = [python, "-m", "pip", "install", "--quiet"]
    subprocess.run([*install, f"gymnasium=={version}", "numpy", "pytest", "scipy"], check=True)
    subprocess.run([*install, *packages], check=True)
    here = Path(__file__).resolve().parent
    tests = [str(here / name) for name in TESTS]
    # Outside the checkout, so that the installed package is what is tested.
    return subprocess.run([python, "-m", "pytest", "-q", "--rootdir", here, *tests], cwd=folder).returncode


def main():
    """Check all releases; the exit status is that of the first that fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("wheel", type=Path)
    parser.add_argument("versions", nargs="*", default=VERSIONS)
    parser.add_argument("--folder", type=Path, help="where the virtual environments are kept")
    arguments = parser.parse_args()
    folder = arguments.folder or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    failed = [v for v in arguments.versions if check(v, arguments.wheel.resolve(), folder)]
    print("failed under gymnasium " + ", ".join(failed) if failed else "passed under all releases of gymnasium")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
