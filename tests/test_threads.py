"""Targets shared among threads."""

import numba
import numpy as np
import pytest

from cislunar.estimation import ESTIMATORS
from cislunar.runtime.threads import allow_threads, share_out
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem

pytestmark = pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="needs two cores")


@pytest.fixture
def threads():
    before = numba.get_num_threads()
    yield allow_threads
    allow_threads(1)
    numba.set_num_threads(before)


@pytest.mark.parametrize("number", [1, 2])
@pytest.mark.parametrize("count", [0, 1, 7, 8, 100])
def test_every_target_is_worked_on_once(threads, number, count):
    threads(number)
    seen = []
    share_out(lambda start, stop: seen.extend(range(start, stop)), count, least=3)
    assert sorted(seen) == list(range(count))


def test_what_goes_wrong_in_a_thread_is_raised(threads):
    threads(2)
    with pytest.raises(ZeroDivisionError):
        share_out(lambda start, stop: 1 // (start - 8), 40)


@pytest.mark.parametrize("name", ESTIMATORS)
def test_results_do_not_depend_on_the_threads(threads, name):
    scene, surfaces, epoch, ids, loop = tracking_problem(4, 20, duration_hours=2.0)
    found = []
    for number in (1, 2):
        threads(number)
        found.append(run_closed_loop(scene, surfaces, epoch, ids, [3], loop, estimator=name))
    one, two = found
    for each in ("assignment", "outcome", "error", "sigma", "bound"):
        np.testing.assert_array_equal(getattr(one, each), getattr(two, each))
    assert np.isfinite(one.bound).any()
