"""``import cislunar`` is fast, imports no package, and offers the names that notebooks need."""

import inspect
import subprocess
import sys
from importlib import import_module

import numpy as np
import pytest

import cislunar as cs
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.errors import ConfigurationError
from cislunar.visibility.counts import VisibilitySettings


def test_import_loads_no_other_package():
    script = (
        "import sys; before = {*sys.modules}; import cislunar; from cislunar import __version__;"
        "print(*sorted({*sys.modules} - before))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["cislunar"]


def test_names_are_few_and_listed():
    functions = [name for name in cs.__all__ if name.islower()]
    assert 10 <= len(functions) <= 15 and len(cs.__all__) - len(functions) <= 12
    assert {*cs.__all__, "__version__"} <= {*dir(cs)}
    everything = {}
    exec("from cislunar import *", everything)
    assert {*cs.__all__} <= {*everything}


@pytest.mark.parametrize("name", cs.__all__)
def test_each_name_is_the_function_of_its_package_and_has_readable_help(name):
    function = getattr(cs, name)
    assert getattr(import_module(function.__module__), name) is function
    assert inspect.getdoc(function)
    signature = str(inspect.signature(function))
    for unreadable in ("numpy.", "typing.", "cislunar.", "object at"):
        assert unreadable not in signature


def test_an_unknown_name_is_reported():
    with pytest.raises(AttributeError, match="'cislunar' has no attribute 'halo'"):
        _ = cs.halo


STATE = np.array([1.14, 0.0, -0.16, 0.0, -0.223, 0.0])
IN_KM = STATE * LENGTH_UNIT_KM
NEAR, FAR, SUN = STATE[None, :3], IN_KM[None, :3], np.array([[389.0, 0.0, 0.0]])


@pytest.mark.parametrize(
    "call",
    [
        lambda: cs.propagate(IN_KM, [0.0]),
        lambda: cs.propagate_periodic(IN_KM, 3.0, [0.0]),
        lambda: cs.sightings(NEAR, FAR, SUN),
        lambda: cs.sightings(FAR, NEAR, SUN),
        lambda: cs.count_visibility([IN_KM], [3.0], NEAR, [0.0], SUN, VisibilitySettings()),
        lambda: cs.count_visibility([STATE], [3.0], FAR, [0.0], SUN, VisibilitySettings()),
        lambda: cs.make_scene(FAR[None], SUN, 60.0),
        lambda: cs.run_closed_loop(*cs.tracking_problem(1, 1)[:2], [IN_KM], [0], [1]),
    ],
)
def test_states_in_km_are_refused(call):
    with pytest.raises(ConfigurationError, match=r"x = 438216 is taken in units of 384400 km"):
        call()


def test_a_first_notebook():
    halo = cs.periodic_orbits("Halo_L2_S", jacobi=3.05)
    path = cs.propagate_periodic(halo.state[0], halo.period[0], [0.0, halo.period[0]])
    assert path[1] == pytest.approx(path[0], abs=1e-12)
    problem = cs.tracking_problem(2, 2, duration_hours=1.0, interval_minutes=30.0)
    result = cs.run_closed_loop(*problem[:4], [1], problem.loop)
    assert np.all(result.failed == 0)
