"""Tables of Earth, Moon and Sun against SPICE, the Moon's axes, instants of UTC."""

import numpy as np
import pytest
import spiceypy
from test_ephemeris import excerpt

from cislunar.constants import EPOCH_JD
from cislunar.ephemeris import bodies
from cislunar.ephemeris.bodies import BODY_COLUMNS, moon_axes, read_table, tabulate_bodies
from cislunar.ephemeris.kernel import EARTH, EARTH_MOON_BARYCENTER, MOON, SUN, kernel_path, loaded
from cislunar.ephemeris.time_scales import tdb_seconds, utc_to_tdb
from cislunar.errors import ConfigurationError, InputFileError

DAY = 86_400.0
START = tdb_seconds("2024-10-01T00:00:00")


def test_table_against_spice():
    """Within a millimeter and a micrometer per second at any time of a month."""
    table = tabulate_bodies(START, START + 30.0 * DAY)
    times = np.floor(START + 30.0 * DAY * np.random.default_rng(0).random(1500))
    position, velocity, _ = read_table(table, times)
    with loaded(kernel_path()):
        for name, body in (("earth", EARTH), ("moon", MOON), ("sun", SUN)):
            exact = np.array(
                [spiceypy.spkgeo(body, t, "J2000", EARTH_MOON_BARYCENTER)[0] for t in times]
            )
            np.testing.assert_allclose(
                position[:, BODY_COLUMNS[name]], exact[:, :3], rtol=0, atol=1e-6
            )
            np.testing.assert_allclose(
                velocity[:, BODY_COLUMNS[name]], exact[:, 3:], rtol=0, atol=1e-9
            )


def test_accelerations_of_the_table():
    """The relative acceleration of Earth and Moon is that of point masses and the solar tide."""
    table = tabulate_bodies(START, START + DAY)
    times = START + DAY * np.linspace(0.01, 0.99, 50)
    position, _, acceleration = read_table(table, times)
    later, earlier = (read_table(table, times + s)[1] for s in (60.0, -60.0))
    np.testing.assert_allclose(acceleration, (later - earlier) / 120.0, rtol=0, atol=2e-12)
    r, a = (
        each[:, BODY_COLUMNS["moon"]] - each[:, BODY_COLUMNS["earth"]]
        for each in (position, acceleration)
    )
    moon, earth = (
        position[:, BODY_COLUMNS["sun"]] - position[:, BODY_COLUMNS[b]] for b in ("moon", "earth")
    )

    def by_cube(x):
        return x / np.linalg.norm(x, axis=1)[:, None] ** 3

    fall = -(bodies.GM_EARTH + bodies.GM_MOON) * by_cube(r)
    fall += bodies.GM_SUN * (by_cube(moon) - by_cube(earth))
    np.testing.assert_allclose(a, fall, rtol=0, atol=2e-6 * np.abs(fall).max())


def test_masses_are_those_of_the_kernel():
    """The barycenter of DE421 divides Earth and Moon by their masses."""
    table = tabulate_bodies(START, START)
    position = read_table(table, START)[0]
    ratio = np.linalg.norm(position[BODY_COLUMNS["moon"]]) / np.linalg.norm(
        position[BODY_COLUMNS["earth"]]
    )
    assert pytest.approx(ratio, rel=1e-9) == bodies.GM_EARTH / bodies.GM_MOON


def test_axes_of_the_moon_against_spice():
    """Against the evaluation of the same constants by SPICE."""
    numbers = {
        "BODY3_NUT_PREC_ANGLES": np.stack([bodies._ANGLE, 36_525.0 * bodies._RATE], 1).ravel(),
        "BODY301_POLE_RA": [269.9949, 0.0031, 0.0],
        "BODY301_POLE_DEC": [66.5392, 0.0130, 0.0],
        "BODY301_PM": [38.3213, 13.17635815, -1.4e-12],
        "BODY301_NUT_PREC_RA": bodies._ASCENSION,
        "BODY301_NUT_PREC_DEC": bodies._DECLINATION,
        "BODY301_NUT_PREC_PM": bodies._MERIDIAN,
    }
    for name, values in numbers.items():
        spiceypy.pdpool(name, np.asarray(values, dtype=float))
    try:
        for t in START + 1e6 * np.arange(-3.0, 4.0):
            np.testing.assert_allclose(
                moon_axes(t), spiceypy.tipbod("J2000", MOON, t), rtol=0, atol=1e-11
            )
    finally:
        spiceypy.clpool()


def test_the_near_side_of_the_moon_faces_the_earth():
    """Optical librations reach 7.9 deg in longitude and 6.9 deg in latitude."""
    table = tabulate_bodies(START, START + 360.0 * DAY)
    times = START + DAY * np.arange(0.0, 360.0, 0.5)
    position = read_table(table, times)[0]
    earth = position[:, BODY_COLUMNS["earth"]] - position[:, BODY_COLUMNS["moon"]]
    x, y, z = np.einsum("tij,tj->it", moon_axes(times), earth)
    longitude, latitude = np.degrees(np.arctan2(y, x)), np.degrees(np.arctan2(z, np.hypot(x, y)))
    assert 7.0 < np.abs(longitude).max() < 8.2
    assert 6.5 < np.abs(latitude).max() < 7.0


def test_instants():
    """Text is exact where a Julian date is rounded, and a leap second lasts one second."""
    assert tdb_seconds("2024-10-01T00:00:00") == tdb_seconds("2024-10-01") == START
    assert tdb_seconds(EPOCH_JD) == pytest.approx(START, abs=1e-4)
    assert tdb_seconds("2024-10-01T00:00:00.25Z") - START == pytest.approx(0.25, abs=2e-7)
    leap = tdb_seconds("2017-01-01T00:00:00") - tdb_seconds("2016-12-31T23:59:59")
    assert leap == pytest.approx(2.0, abs=2e-7)
    noon = tdb_seconds("2000-01-01T12:00:00")
    assert noon == pytest.approx(float(utc_to_tdb(2_451_545.0)), abs=1e-9)


@pytest.mark.parametrize("instant", ["yesterday", "2024-13-01", "", "NaT", "1969-07-20T20:17:40"])
def test_impossible_instants_are_refused(instant):
    with pytest.raises(ConfigurationError, match=r"is not a date|1972"):
        tdb_seconds(instant)


def test_bad_input_is_refused(tmp_path):
    with pytest.raises(
        InputFileError, match=r"de421\.bsp: covers .* not the requested dates, 2100"
    ):
        tabulate_bodies(*map(tdb_seconds, ("2100-01-01", "2100-01-02")))
    lacking = excerpt(tmp_path / "lacking.bsp", START, START + 10.0 * DAY, (3, 301, 399))
    with pytest.raises(InputFileError, match=r"lacking\.bsp: has no data for the Sun"):
        tabulate_bodies(START, START + DAY, lacking)
    with pytest.raises(ConfigurationError, match="finite"):
        tabulate_bodies(START, np.nan)
    table = tabulate_bodies(START, START + DAY)
    with pytest.raises(ConfigurationError, match=r"covers 2024-10-01.*requested.*2024-10-03"):
        read_table(table, START + 2.0 * DAY)
    assert spiceypy.ktotal("ALL") == 0
