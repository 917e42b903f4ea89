"""Benchmark of controllers and learning, rates against other packages, and published rows.

It is run from a checkout by `python -m smpl.benchmark`, `smpl.bench` and `smpl.published`, and is
not part of the library.
"""
