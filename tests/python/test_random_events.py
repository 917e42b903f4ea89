"""Random events, comparisons and tables: the answer depends neither on the step grid nor on the method.

Expected values come from closed forms, from quadrature between the levels that are passed, and from SciPy, which stops
at each of them (`random_switches`). Every model runs as one control step, as 3, 10 and 100, by all methods.

    SMPL_RANDOM_EVENTS=1000:5000 pytest tests/python/test_random_events.py

runs the seeds 1000 to 4999 instead of the usual ones; a single number runs that seed alone.
"""

import os

import pytest

from random_switches import mismatches, random_equation, random_event, random_feedback


def seeds(usual: int) -> range:
    first, _, last = os.environ.get("SMPL_RANDOM_EVENTS", f"0:{usual}").partition(":")
    return range(int(first), int(last or int(first) + 1))


def check(case, seed: int) -> None:
    try:
        found = mismatches(case)
    except Exception as error:
        pytest.fail(f"{case.source(1)}\nseed {seed}, {case.kind}: {error}", pytrace=False)
    if found:
        lines = [f"{method}, {count} control steps: {message}" for method, count, message in found]
        about = "\n".join([case.source(1), f"seed {seed}, {case.kind} {case.about}", *lines])
        pytest.fail(about, pytrace=False)


# Phases with opposite conditions on an algebraic variable, which a restart corrects across the threshold;
# and windows of time so near each other that the integration ends in the failure `solver`.
LEFT_EVENTS = {11, 42, 71}
LEFT_EQUATIONS = {76}


def known(seed, left):
    if seed in left:
        pytest.xfail("known: see the list of seeds")


@pytest.mark.parametrize("seed", seeds(120))
def test_random_events_happen_at_their_times(seed):
    known(seed, LEFT_EVENTS)
    check(random_event(seed), seed)


@pytest.mark.parametrize("seed", seeds(120))
def test_random_comparisons_and_tables_in_rates_are_integrated(seed):
    known(seed, LEFT_EQUATIONS)
    check(random_equation(seed), seed)


@pytest.mark.parametrize("seed", seeds(40))
def test_random_switches_that_move_what_they_read_follow_scipy(seed):
    check(random_feedback(seed), seed)
