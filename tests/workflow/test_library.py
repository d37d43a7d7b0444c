"""``import cislunar``: at once and without its rooms, yet with what notebooks begin with."""

import inspect
import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest

import cislunar as cs


def test_import_waits_for_no_other_package():
    script = (
        "import sys; before = {*sys.modules}; import cislunar; from cislunar import __version__;"
        "print(*sorted({*sys.modules} - before))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["cislunar"]


def test_names_are_few_and_listed():
    assert 10 <= len(cs.__all__) <= 15
    assert {*cs.__all__, "__version__"} <= {*dir(cs)}
    everything = {}
    exec("from cislunar import *", everything)
    assert {*cs.__all__} <= {*everything}


@pytest.mark.parametrize("name", cs.__all__)
def test_each_name_is_the_function_of_its_room_and_help_can_be_read(name):
    function = getattr(cs, name)
    assert getattr(import_module(function.__module__), name) is function
    assert inspect.getdoc(function)
    signature = str(inspect.signature(function))
    for unreadable in ("numpy.", "typing.", "cislunar.", "object at"):
        assert unreadable not in signature


def test_a_name_that_is_not_there_is_said_so():
    with pytest.raises(AttributeError, match="'cislunar' has no attribute 'halo'"):
        _ = cs.halo


def test_a_first_notebook():
    halo = cs.periodic_orbits("Halo_L2_S", jacobi=3.05)
    path = cs.propagate_periodic(halo.state[0], halo.period[0], [0.0, halo.period[0]])
    assert path[1] == pytest.approx(path[0], abs=1e-12)
    problem = cs.tracking_problem(2, 2, duration_hours=1.0, interval_minutes=30.0)
    result = cs.run_closed_loop(*problem[:4], [1], problem.loop)
    assert np.all(result.failed == 0)
