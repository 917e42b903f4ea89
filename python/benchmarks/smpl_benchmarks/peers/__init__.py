"""Benchmarks against peers, printed by one command: `python -m smpl.bench [SECTION]...`.

Every section compares at equal error or at a stated tolerance, prints the goal, what was measured
and their ratio, and says where the time goes. A peer that is not installed is skipped by its name.
"""
