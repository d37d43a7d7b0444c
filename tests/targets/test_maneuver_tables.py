"""Maneuvers of true targets: tables, faults in them, and random draws."""

import numpy as np
import pytest
from scipy.stats import kstest

from cislunar.constants import MU
from cislunar.dynamics.cr3bp import primary_positions
from cislunar.dynamics.maneuvers import VELOCITY_UNIT_M_S
from cislunar.ephemeris.time_scales import tdb_seconds
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.targets.maneuver_model import DrawnManeuvers
from cislunar.targets.maneuvers import draw_maneuvers, load_maneuvers

HEADER = "target,time_hours,dv_1_m_s,dv_2_m_s,dv_3_m_s,axes,duration_min\n"
START = tdb_seconds("2024-10-01T00:00:00")


def table(tmp_path, text, hours=24.0, start=None):
    path = tmp_path / "maneuvers.csv"
    path.write_text(text)
    return load_maneuvers(path, hours, start)


def generator(j, kind, seed=5):
    return np.random.default_rng([seed, j, kind])


def test_a_table_is_read_in_its_units(tmp_path):
    found = table(tmp_path, HEADER + "a,1.5,1,-2,3,rtn-moon,20\nb,0,0,0,.5,,\na,2,1,0,0,,0\n")
    assert found.name == ["a", "b", "a"]
    given = found.maneuvers
    assert given.start_s.tolist() == [5400.0, 0.0, 7200.0]
    assert given.duration_s.tolist() == [1200.0, 0.0, 0.0]
    assert given.axes.tolist() == [2, 0, 0]
    np.testing.assert_array_equal(given.velocity_m_s[0], [1.0, -2.0, 3.0])
    # targets that are not monitored are left out
    some = found.of_targets([["7", "b"], ["8", "c"]])
    assert some.maneuvers.target.tolist() == [0] and some.name == ["b"]
    impulses, of = given.impulses(100.0)
    assert np.bincount(of).tolist() == [120, 1, 1] and np.all(np.diff(impulses.time) >= 0.0)
    for k in range(3):
        total = VELOCITY_UNIT_M_S * impulses.velocity[of == k].sum(axis=0)
        np.testing.assert_allclose(total, given.velocity_m_s[k], rtol=1e-12)
        middle = given.start_s[k] + 0.5 * given.duration_s[k]
        assert 100.0 * impulses.time[of == k].mean() == pytest.approx(middle)


def test_dates_are_those_of_utc(tmp_path):
    text = "target,time_utc,dv_1_m_s,dv_2_m_s,dv_3_m_s\n0,2024-10-01T00:00:00,1,0,0\n"
    found = table(tmp_path, text + "1,2024-10-01T06:30:00.25Z,1,0,0\n", start=START)
    assert found.maneuvers.start_s.tolist() == [0.0, 23_400.25]


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("a,25,1,0,0,,", "not within the run of 24 h"),
        ("a,-1,1,0,0,,", "not within the run"),
        ("a,24,1,0,0,,", "not within the run"),
        ("a,23.9,1,0,0,,20", "not within the run"),
        ("a,nan,1,0,0,,", "must be a finite number"),
        ("a,1,1,nan,0,,", "dv_2_m_s"),
        ("a,1,1,,0,,", "dv_2_m_s"),
        ("a,1,1,0,0,,-3", "must not be negative"),
        ("a,1,1,0,0,,inf", "must be a finite number"),
        ("a,1,1,0,0,lvlh,", "is none of propagation, rtn-earth, rtn-moon"),
        ("a,1,0,0,0,,", "is zero"),
        (",1,1,0,0,,", "no target"),
        ("first,3.2,1,0,0,,", "overlaps the maneuver of .*row 2"),
        ("first,2.9,1,0,0,,20", "overlaps"),
    ],
)
def test_faults_name_file_and_row(tmp_path, row, words):
    with pytest.raises(InputFileError, match=f"maneuvers.csv, row .*{words}") as caught:
        table(tmp_path, f"{HEADER}first,3,1,0,0,,30\n{row}\n")
    assert "\n" not in str(caught.value)


def test_faults_of_the_header(tmp_path):
    for header, words in (
        ("target,dv_1_m_s,dv_2_m_s,dv_3_m_s", "time_utc and time_hours"),
        ("target,time_hours,dv_1_m_s,dv_2_m_s", "no column dv_3_m_s"),
        ("target,time_hours,dv_1_m_s,dv_2_m_s,dv_3_m_s,axis", "did you mean 'axes'"),
    ):
        fields = ",".join(["1"] * len(header.split(",")))
        with pytest.raises(InputFileError, match=words):
            table(tmp_path, f"{header}\n{fields}\n")
    with pytest.raises(InputFileError, match=r"row 2.*not a date"):
        table(tmp_path, HEADER.replace("hours", "utc") + "a,noon,1,0,0,,\n", start=START)


def test_unknown_targets_two_names_and_escape(tmp_path):
    found = table(tmp_path, HEADER + "Gateway,1,1,0,0,,30\n3,1.2,1,0,0,,\nx,2,1400,0,0,,\n")
    with pytest.raises(InputFileError, match=r"row 2.*no such target of S; did you mean 'gateway'"):
        found.require_known({"gateway", "3", "x"}, "S")
    with pytest.raises(InputFileError, match=r"row 3.*overlaps.*row 2"):
        found.of_targets([["3", "Gateway"]])
    found.require_known({"Gateway", "3", "x"}, "S")
    # the escape speed at 384 400 km from the Earth and far from the Moon is 1.45 km/s
    step_s, n = 3600.0, 4
    primaries = np.tile(primary_positions(MU), (n, 1, 1))
    near = np.tile([0.0, 1.0, 0.0], (3, n, 1))
    found.require_bound(step_s, near, primaries)
    with pytest.raises(InputFileError, match=r"row 4.*1,400 m/s exceeds the escape speed of 1,0"):
        found.require_bound(step_s, 2.0 * near, primaries)


def test_draws_have_the_stated_distributions():
    kind = DrawnManeuvers(smallest_m_s=0.1, largest_m_s=100.0)
    found = draw_maneuvers([kind], 3000, 24.0, generator)
    assert np.array_equal(found.target, np.arange(3000))
    size = np.linalg.norm(found.velocity_m_s, axis=1)
    for values in (
        np.log(size / 0.1) / np.log(1000.0),
        found.start_s / 86_400.0,
        0.5 + 0.5 * found.velocity_m_s[:, 2] / size,
        0.5 + np.arctan2(found.velocity_m_s[:, 1], found.velocity_m_s[:, 0]) / (2.0 * np.pi),
    ):
        assert kstest(values, "uniform").pvalue > 0.01


def test_periodic_draws_and_shares():
    keeping = DrawnManeuvers(
        share=0.5, smallest_m_s=0.1, largest_m_s=0.1, interval_hours=24, first_hour=6
    )
    large = DrawnManeuvers(smallest_m_s=10.0, largest_m_s=500.0, duration_minutes=30)
    found = draw_maneuvers([keeping, large], 200, 168.0, generator)
    few = found.duration_s == 0.0
    own = np.unique(found.target[few])
    assert 70 < own.size < 130
    for j in own:
        start = found.start_s[few & (found.target == j)]
        assert start.size in (6, 7) and 6.0 <= start[0] / 3600.0 < 30.0
        np.testing.assert_allclose(np.diff(start), 86_400.0)
    sizes = np.linalg.norm(found.velocity_m_s[few], axis=1)
    np.testing.assert_allclose(sizes, 0.1, rtol=1e-12)
    # a larger share and a longer run keep what there is, and another kind changes nothing
    more = draw_maneuvers([keeping.model_copy(update={"share": 0.8})], 200, 336.0, generator)
    for j in own:
        first, second = (each.velocity_m_s[each.target == j] for each in (found, more))
        count = np.sum(few & (found.target == j))
        np.testing.assert_array_equal(second[:count], first[:count])
        assert np.sum(more.target == j) > count


def test_impossible_draws():
    given = {"smallest_m_s": 1.0, "largest_m_s": 2.0}
    for change, words in (
        ({"largest_m_s": 0.5}, "less than smallest"),
        ({"first_hour": 5, "last_hour": 4}, "before first_hour"),
        ({"interval_hours": 1, "duration_minutes": 61}, "overlap"),
        ({"share": 1.1}, "share"),
        ({"largest_m_s": 1500}, "largest_m_s"),
        ({"smallest_m_s": float("nan")}, "smallest_m_s"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            DrawnManeuvers(**(given | change))
    late = DrawnManeuvers(**given, last_hour=23.9, duration_minutes=30)
    with pytest.raises(ConfigurationError, match="not within the run of 24 h"):
        draw_maneuvers([late], 1, 24.0, generator)
    for wrong, name in (((1, float("nan")), "duration_hours"), ((-1, 24.0), "n_targets")):
        with pytest.raises(ConfigurationError, match=name):
            draw_maneuvers([DrawnManeuvers(**given)], *wrong, generator)
