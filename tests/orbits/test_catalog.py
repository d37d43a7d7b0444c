"""The catalog of families against published rows, its filters and its mirror images."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from cislunar.constants import EARTH_RADIUS_KM, MOON_RADIUS_KM, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics.cr3bp import CR3BP, jacobi_constant
from cislunar.dynamics.propagation import propagate
from cislunar.errors import ConfigurationError
from cislunar.orbits.catalog import (
    _BRANCHES,
    CATALOG,
    catalog_branch,
    end_in_words,
    family_named,
    periodic_orbits,
)
from cislunar.orbits.corrector import AXIS, X, correct, fix_coordinate
from cislunar.orbits.stability import stability_index

CATALOG_MU = 0.012150585609624041

SHORTER = {"DPO": ("period 7.8",), "Resonant_2:1": ("x 0.07", "turns 1")}

# Stability indices tabulated from a crossing next to the Moon: neighboring rows of the first
# scatter by a per cent, and integration of the second from there gives 72.60 to 72.83 by its
# tolerance (from the other crossing, 72.7448).
FROM_NEAR_CROSSING = {("LPO_W", "2"): 1e-2, ("Lyap_L2", "end"): 1e-3}

with (Path(__file__).parents[1] / "data/catalog_rows.csv").open() as file:
    ROWS = list(csv.DictReader(file))


def state_of(row):
    return np.array([float(row[key]) for key in ("x0", "y0", "z0", "vx0", "vy0", "vz0")])


def nearest(start, period, wanted):
    """Least distance in state of an orbit from a state, by propagation alone."""

    def states(times):
        return propagate(start, times, forces=CR3BP(CATALOG_MU), method="dop853")

    times = np.linspace(0.0, period, 2001)
    gaps = np.linalg.norm(states(times) - wanted, axis=1)
    around = times[max(np.argmin(gaps) - 1, 0)], times[min(np.argmin(gaps) + 1, 2000)]
    if around[0] == 0.0 and gaps[0] < 1e-9:
        return gaps[0]
    best = minimize_scalar(
        lambda time: np.linalg.norm(states([time])[0] - wanted),
        bounds=around,
        method="bounded",
        options={"xatol": 1e-13},
    )
    return min(best.fun, gaps.min())


@pytest.fixture(scope="module", autouse=True)
def shorter():
    """Parts that no row is on and that take seconds to follow, unstable or close to the Earth."""
    whole = {name: CATALOG[name] for name in SHORTER}
    for name, ends in SHORTER.items():
        CATALOG[name] = whole[name]._replace(ends=ends)
    yield
    CATALOG.update(whole)
    for name in whole:
        _BRANCHES.pop((name, CATALOG_MU), None)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['family']}-{row['id']}")
def test_published_rows_are_members(row):
    wanted, period, closeness = state_of(row), float(row["period"]), 2e-7
    if row["family"].startswith("Axial"):  # near an extremum of the Jacobi constant: by x
        last = catalog_branch(row["family"], CATALOG_MU)[-1].half.crossing
        half = correct(last, fix_coordinate(X, wanted[0]), CATALOG_MU, section=AXIS)
        found, periods = [half.state], [half.period]
    elif row["family"] == "Vertical_L3":  # all but the flat orbit that the family ends at
        last = catalog_branch(row["family"], CATALOG_MU)[-1].half
        found, periods, closeness = [last.state], [last.period], 3e-4
    else:
        members = periodic_orbits(
            row["family"], jacobi=float(row["jacobi"]), clear=False, mu=CATALOG_MU
        )
        found, periods = members.state, members.period
    if row["family"].startswith("Vertical"):
        wanted = np.stack([wanted, wanted * [1, 1, -1, 1, 1, -1]])
    gaps = [
        min(nearest(start, length, each) for each in np.atleast_2d(wanted))
        for start, length in zip(found, periods, strict=True)
    ]
    best = int(np.argmin(gaps))
    assert gaps[best] < closeness
    assert periods[best] == pytest.approx(period, abs=1e-6)
    index = stability_index(found[best], periods[best], CATALOG_MU)
    tolerance = FROM_NEAR_CROSSING.get((row["family"], row["id"]), 1e-4)
    assert index == pytest.approx(float(row["stability"]), rel=tolerance)


def test_filters_keep_what_lies_within():
    some = periodic_orbits("Halo_L2_N", period=(1.3, 2.5), stability=(1.0, 1.5), count=30)
    everything = periodic_orbits("Halo_L2_N", count=30)
    kept = (everything.period >= 1.3) & (everything.period <= 2.5)
    kept &= everything.stability_index <= 1.5
    assert 0 < some.period.size == np.count_nonzero(kept) < 30
    np.testing.assert_array_equal(some.state, everything.state[kept])
    assert np.all(everything.perilune_km > MOON_RADIUS_KM)
    assert np.all(everything.perigee_km > EARTH_RADIUS_KM)


def test_clear_part_ends_at_the_surface():
    """Halo families about L2 and L3 continue through Moon and Earth; the last orbits touch them."""
    near = periodic_orbits("Halo_L2_N", count=3)
    assert near.period.size == 3
    assert near.perilune_km[-1] == pytest.approx(MOON_RADIUS_KM, abs=2e-3)
    far = periodic_orbits("Halo_L3_S", count=3)
    assert far.perigee_km[-1] == pytest.approx(EARTH_RADIUS_KM, abs=2e-3)
    through = periodic_orbits("Halo_L3_S", count=3, clear=False)
    assert through.perigee_km[-1] < 2000.0
    assert through.state[-1, 0] > far.state[-1, 0]


def test_several_members_may_have_one_value():
    found = periodic_orbits("Halo_L1_N", jacobi=3.0)
    np.testing.assert_allclose(found.jacobi, 3.0, rtol=1e-12)
    stable = periodic_orbits("Halo_L2_S", stability=1.3)
    assert stable.period.size > 1
    np.testing.assert_allclose(stable.stability_index, 1.3, rtol=1e-6)


def test_halves_are_mirror_images():
    north, south = (periodic_orbits(f"Halo_L2_{half}", period=2.0) for half in "NS")
    np.testing.assert_array_equal(north.state * [1, 1, -1, 1, 1, -1], south.state)
    ahead, behind = (periodic_orbits(f"Short_L{point}", jacobi=2.5) for point in (4, 5))
    np.testing.assert_array_equal(ahead.state * [1, -1, 1, -1, 1, 1], behind.state)
    end = propagate(behind.state[0], [behind.period[0]], method="dop853")[0]
    np.testing.assert_allclose(end, behind.state[0], atol=1e-9)


def test_resonant_orbits_close_after_whole_turns_of_the_moon():
    found = periodic_orbits("Resonant_3:2", count=3)
    for state, period in zip(found.state, found.period, strict=True):
        # families end at a tenth, which rounding may exceed
        assert period == pytest.approx(4.0 * np.pi, rel=0.1 + 1e-12)
        end = propagate(state, [period], method="dop853")[0]
        np.testing.assert_allclose(end, state, atol=1e-7)
    np.testing.assert_allclose(jacobi_constant(found.state), found.jacobi)


@pytest.mark.parametrize(
    ("family", "given", "message"),
    [
        ("Halo_L4", {}, "unknown orbit family 'Halo_L4'"),
        ("Resonant_6:4b", {}, "family = 'Resonant_6:4b' must be in lowest terms"),
        ("DRO", {"jacobi": 3.0, "period": 2.0}, "give one value"),
        ("DRO", {"jacobi": (3.0, 2.0)}, "from 3.0 to 2.0 is no range"),
        ("DRO", {"count": 0}, "count = 0 must be a whole number of at least 1"),
        ("DRO", {"count": 2.5}, "count = 2.5 must be a whole number"),
        (3, {}, "family = 3: give the name"),
        ("DRO", {"period": "6.56"}, "period = '6.56' must be a finite number"),
        ("DRO", {"jacobi": np.nan}, "jacobi = nan must be a finite number"),
        ("DRO", {"jacobi": (3.0, 3.1, 3.2)}, "jacobi: a range has two ends"),
        ("DRO", {"jacobi": ("low", 3.1)}, "jacobi = 'low' must be"),
        ("DRO", {"period": 2.0, "period_days": 9.0}, "give period or period_days, not both"),
        ("DRO", {"jacobi": 3.0, "mu": "0.01"}, "mu = '0.01' must be"),
    ],
)
def test_ambiguous_or_impossible_requests_are_refused(family, given, message):
    with pytest.raises(ConfigurationError, match=message):
        periodic_orbits(family, **given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"period": 6.56},
            r"period = 6.56; .* 1.\d+ to 3.\d+, non.* a period in days is period_days",
        ),
        ({"period_days": 40.0}, r"period = 40 days; the family has about 5.9\d+ to 14.\d+ days$"),
        ({"jacobi": 5.0}, r"jacobi = 5; the family has about 3.0\d+ to 3.1\d+$"),
        ({"stability": 1e6}, r"stability = 1e\+06; the family has about 1.000 to "),
    ],
)
def test_a_value_that_no_member_has_is_refused_with_the_range(given, message):
    with pytest.raises(ConfigurationError, match=message):
        periodic_orbits("Halo_L2_S", **given)


def test_a_period_may_be_given_in_days():
    day = SECONDS_PER_DAY / TIME_UNIT_S
    found = periodic_orbits("Halo_L2_S", period_days=6.56)
    np.testing.assert_array_equal(
        found.state, periodic_orbits("Halo_L2_S", period=day * 6.56).state
    )
    some = periodic_orbits("Halo_L2_S", period_days=(6.0, 7.0), count=20)
    assert 0 < some.period.size < 20 and np.all((some.period > 6 * day) & (some.period < 7 * day))


def test_every_family_has_a_description():
    assert len({family.meaning for family in CATALOG.values()}) == len(CATALOG)
    assert end_in_words(family_named("Halo_L3_N")) == "at x = -0.1786714"
    assert end_in_words(family_named("Resonant_1:2b")) == (
        "where the Jacobi constant turns, at the surface of the Earth or the Moon, 10% off 2 "
        "sidereal months"
    )
