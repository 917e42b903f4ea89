"""`python -m smpl.bench [SECTION]...`: comparison of speed, see `smpl_benchmarks.peers`."""

from smpl.support.benchmarks import find_benchmarks

find_benchmarks(__name__ == "__main__")

from smpl_benchmarks.peers.__main__ import main  # noqa: E402

__all__ = ["main"]

if __name__ == "__main__":
    main()
