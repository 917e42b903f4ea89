"""`python -m smpl.published --out DIR`: published and own figures."""

from smpl.support.benchmarks import find_benchmarks

find_benchmarks(__name__ == "__main__")

from smpl_benchmarks.published import main  # noqa: E402

__all__ = ["main"]

if __name__ == "__main__":
    raise SystemExit(main())
