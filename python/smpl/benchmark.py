"""`python -m smpl.benchmark --suite control --budget smoke`: see `smpl_benchmarks.benchmark`."""

from smpl.support.benchmarks import find_benchmarks

find_benchmarks(__name__ == "__main__")

from smpl_benchmarks.benchmark import SUBJECTS, Run, benchmark, main, runs  # noqa: E402

__all__ = ["SUBJECTS", "Run", "benchmark", "main", "runs"]

if __name__ == "__main__":
    raise SystemExit(main())
