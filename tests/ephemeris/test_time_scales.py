"""Dates in UTC, TAI, TT and TDB: read, written, refused."""

import numpy as np
import pytest

from cislunar.constants import EPOCH_JD
from cislunar.ephemeris.time_scales import (
    clock_seconds,
    clock_text,
    clock_to_tdb,
    julian_date,
    tdb_after,
    tdb_since,
    tdb_to_clock,
    utc_to_tdb,
)
from cislunar.errors import ConfigurationError


@pytest.mark.parametrize(
    "date", ["2024-10-01", "2024-10-01T00:00", "2024-10-01T00:00:00.000Z", "2024-275T00:00:00"]
)
def test_a_date_may_be_written_in_several_ways(date):
    assert julian_date(date) == EPOCH_JD


@pytest.mark.parametrize(
    "date",
    [
        *("tomorrow", "2024-13-01", "2024-02-30", "2023-366", "2024-000", "2024-10-01T24:00:00"),
        *("2024-10-01T00:00:60", "2024-10-01T00:00:00+02:00", "2024-10-1", "", "9999-12-31T99:00"),
    ],
)
def test_an_invalid_date_is_refused(date):
    with pytest.raises(ConfigurationError, match="is not a date: write it like"):
        clock_seconds(date)


@pytest.mark.parametrize("system", ["UTC", "TAI", "TT", "TDB"])
@pytest.mark.parametrize("date", ["1999-06-30T23:59:59", "2016-12-31T23:59:59", "2024-10-01"])
def test_clocks_are_read_and_written(system, date):
    tdb = clock_to_tdb(clock_seconds(date), system)
    assert tdb_to_clock(tdb, system) == pytest.approx(clock_seconds(date), abs=2e-7)
    if system == "UTC":
        assert tdb == pytest.approx(utc_to_tdb(julian_date(date)), abs=1e-4)


def test_a_julian_date_stands_for_the_calendar_date_it_was_made_from():
    random = np.random.default_rng(3)
    for seconds in random.integers(clock_seconds("1973-01-01"), clock_seconds("2050-01-01"), 200):
        date = clock_text(float(seconds) + 0.0625)
        exact = clock_to_tdb(clock_seconds(date), "UTC")
        assert utc_to_tdb(julian_date(date)) == exact
        assert clock_text(tdb_to_clock(exact, "UTC")) == date


@pytest.mark.parametrize("fraction", ["999999", "999990", "000001"])
def test_a_leap_second_begins_at_midnight_exactly(fraction):
    days = "2016-12-31T23:59:59", "2017-01-01T00:00:00"
    date = f"{days[fraction < '5']}.{fraction}"
    tdb = clock_to_tdb(clock_seconds(date), "UTC")
    assert clock_text(tdb_to_clock(tdb, "UTC")) == date
    late = tdb - clock_to_tdb(clock_seconds("2016-12-31T23:59:59"), "UTC")
    assert late == pytest.approx(float(f"0.{fraction}") + 2.0 * (fraction < "5"), abs=3e-7)


def test_equal_steps_are_equal_steps_of_dates_in_utc():
    epoch = clock_to_tdb(clock_seconds("2025-01-03T06:30:00"), "UTC")
    elapsed = np.arange(0.0, 60.0 * 86_400.0, 21_600.0)
    dates = [clock_text(each) for each in tdb_to_clock(tdb_after(epoch, elapsed), "UTC")]
    assert {date[10:] for date in dates} == {
        f"T{hour}:30:00.000000" for hour in ("00", "06", "12", "18")
    }
    np.testing.assert_allclose(tdb_since(epoch, tdb_after(epoch, elapsed)), elapsed, atol=3e-7)
    drift = tdb_after(epoch, elapsed) - epoch - elapsed
    assert 2e-5 < np.abs(np.diff(drift)).max() * 4 < 3e-5  # per day


def test_a_clock_does_not_change_a_date():
    assert clock_text(clock_seconds("2024-10-01T06:07:08.25")) == "2024-10-01T06:07:08.250000"
