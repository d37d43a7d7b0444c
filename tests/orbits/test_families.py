"""The observer library: counts, extents, known bifurcations and physical checks."""

import numpy as np
import pytest

from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM, MU
from cislunar.dynamics.cr3bp import jacobi_constant, primary_distances
from cislunar.dynamics.propagation import propagate, propagate_periodic
from cislunar.errors import ConfigurationError
from cislunar.orbits import branches
from cislunar.orbits.catalog import periodic_orbits
from cislunar.orbits.extent import CATALOG_EXTENT, Extent, KeepOut
from cislunar.orbits.families import (
    DEFAULT_MEMBERS,
    FAMILIES,
    family_branch,
    observer_library,
)

# Ends of the epoch crossing (x, z), range of the period, extrema of the Jacobi constant and of the
# stability index, at mu = 0.01215 with the default keep-out: measured with an independent
# integrator and corrector.
EXPECTED = {
    "Lyap_L1": ((0.8359, 0.0), (0.208, 0.0), (2.692, 7.450), (2.469, 3.188), (53.7, 1337.0)),
    "Lyap_L2": ((1.1567, 0.0), (1.3841, 0.0), (3.373, 7.470), (2.904, 3.172), (49.6, 727.0)),
    "Lyap_L3": ((-1.0061, 0.0), (-1.9782, 0.0), (6.218, 6.286), (1.383, 3.012), (1.0, 1.677)),
    "Halo_L1_N": ((0.8234, 0.001), (0.9333, 0.246), (1.804, 2.787), (2.981, 3.174), (1.0, 1180.0)),
    "Halo_L2_N": ((1.1809, 0.001), (1.0121, 0.174), (1.3776, 3.4155), (3.015, 3.152), (1.0, 606.0)),
    "Halo_L3_N": (
        (-1.6967, 0.005),
        (-0.3661, 1.911),
        (6.122, 6.239),
        (1.086, 2.424),
        (1.073, 1.383),
    ),
    "Butterfly_N": (
        (1.0138, 0.174),
        (0.8258, 0.406),
        (2.749, 11.558),
        (2.745, 3.090),
        (1.003, 212.0),
    ),
    "Dragonfly_N": (
        (1.0066, -0.064),
        (0.9214, -0.220),
        (5.510, 7.291),
        (2.924, 3.023),
        (209.0, 316.0),
    ),
}


def of_family(library, family):
    rows = library.family == family
    return type(library)(*(column[rows] for column in library))


def test_three_hundred_and_two_orbits_in_thirteen_families(library):
    assert len(library.period) == 302 == sum(DEFAULT_MEMBERS.values())
    assert tuple(dict.fromkeys(library.family.tolist())) == FAMILIES
    for family, count in DEFAULT_MEMBERS.items():
        assert np.count_nonzero(library.family == family) == count


def test_every_orbit_starts_perpendicular_to_the_plane_and_closes(library):
    assert np.all(library.state[:, [1, 3, 5]] == 0.0)
    for state, period in zip(library.state, library.period, strict=True):
        halves = propagate_periodic(state, period, [0.4999999999 * period], method="dop853")[0]
        assert abs(halves[1]) < 1e-8
        end = propagate(state, [period], method="dop853")[0]
        # Roundoff alone, grown by the instability of the orbit over a period (Xi up to 1337).
        assert np.linalg.norm((end - state)[:3]) * LENGTH_UNIT_KM < 0.005


def test_no_orbit_enters_the_keep_out_spheres(library):
    slack = 1e-6
    assert library.perilune_km.min() >= MOON_RADIUS_KM + 100.0 - slack
    assert library.perigee_km.min() >= EARTH_RADIUS_KM + 200.0 - slack
    for i in range(0, 302, 23):
        nearest = []
        for k in range(2):
            times, width = np.zeros(1), library.period[i]
            for _ in range(2):
                times = times + np.linspace(-0.5, 0.5, 20_001) * width
                states = propagate(library.state[i], times, method="dop853")
                distances = primary_distances(states)[k]
                times, width = times[[distances.argmin()]], width / 5_000
            nearest.append(distances.min() * LENGTH_UNIT_KM)
        assert library.perigee_km[i] == pytest.approx(nearest[0], rel=1e-6)
        assert library.perilune_km[i] == pytest.approx(nearest[1], rel=1e-6)


def test_jacobi_constants_are_those_of_the_states(library):
    assert np.array_equal(library.jacobi, jacobi_constant(library.state))


@pytest.mark.parametrize("family", EXPECTED)
def test_extent_of_a_family(library, family):
    """The last member of a family depends on how its end was found: 2 % there, else digits."""
    rows = of_family(library, family)
    first, last, periods, jacobis, indices = EXPECTED[family]
    assert rows.state[0, [0, 2]] == pytest.approx(first, abs=6e-4)
    assert rows.state[-1, [0, 2]] == pytest.approx(last, abs=0.011)
    assert (rows.period.min(), rows.period.max()) == pytest.approx(periods, rel=5e-3)
    assert (rows.jacobi.min(), rows.jacobi.max()) == pytest.approx(jacobis, abs=4e-3)
    assert rows.stability_index.min() == pytest.approx(indices[0], rel=5e-3)
    assert rows.stability_index.max() == pytest.approx(indices[1], rel=0.03)


def test_southern_families_mirror_the_northern(library):
    for family in FAMILIES:
        if family.endswith("_N"):
            north = of_family(library, family)
            south = of_family(library, family.replace("_N", "_S"))
            assert np.array_equal(north.state * [1, 1, -1, 1, 1, -1], south.state)
            for k in range(2, len(north)):
                assert np.array_equal(north[k], south[k])


@pytest.mark.parametrize("family", ["Halo_L1", "Halo_L2", "Butterfly"])
def test_northern_families_have_their_apolune_above_the_plane(library, family):
    rows = of_family(library, f"{family}_N")
    assert np.all(rows.state[:, 2] > 0.0)
    assert np.all(of_family(library, "Dragonfly_N").state[:, 2] < 0.0)


@pytest.mark.parametrize(
    ("family", "kilometers"), [("Lyap_L3", 16250), ("Dragonfly_N", 1490), ("Halo_L3_N", 23250)]
)
def test_members_are_equally_spaced_in_x(library, family, kilometers):
    gaps = np.abs(np.diff(of_family(library, family).state[:, 0])) * LENGTH_UNIT_KM
    assert np.ptp(gaps) < 1e-6 * gaps.mean()
    assert gaps.mean() == pytest.approx(kilometers, rel=0.02)


@pytest.mark.parametrize("family", ["Halo_L1_N", "Butterfly_N"])
def test_members_of_folding_families_are_equally_spaced_in_arc(library, family):
    """Chords of equal arcs are equal but for the bend of the branch, sharpest at the fold."""
    crossing = of_family(library, family).state[:, [0, 2]]
    chords = np.linalg.norm(np.diff(crossing, axis=0), axis=1)
    assert np.median(chords) == pytest.approx(chords.max(), rel=0.02)
    assert chords.min() > 0.7 * chords.max()


def test_share_of_stable_orbits(library):
    assert np.count_nonzero(library.stability_index < 2.0) == 100
    assert np.count_nonzero(library.stability_index < 1.01) == 12
    assert np.count_nonzero(library.stability_index > 100.0) == 109
    assert np.all(library.stability_index >= 1.0)


@pytest.mark.parametrize(
    ("point", "x", "period", "jacobi"),
    [
        (1, 0.82339394, 2.74299932, 3.17434696),
        (2, None, 3.41552534, 3.15211498),
        (3, -1.69674765, 6.23914961, 2.42353046),
    ],
)
def test_halo_bifurcations(point, x, period, jacobi):
    half = branches.halo_bifurcation(point).half
    if x is None:
        assert half.end[0] == pytest.approx(1.12038473, abs=1e-7)
    else:
        assert half.crossing[0] == pytest.approx(x, abs=1e-7)
    assert half.period == pytest.approx(period, abs=1e-7)
    assert jacobi_constant(half.state) == pytest.approx(jacobi, abs=1e-7)


def test_dragonflies_and_butterflies_start_at_twice_a_halo_period(library):
    """At a period doubling the halo has an eigenvalue -1 and the new family twice its period."""
    for family, halo_period in (("Dragonfly_N", 2.755197107), ("Butterfly_N", 1.374325741)):
        seed = branches.dragonfly_seed() if family.startswith("D") else branches.butterfly_seed()
        assert seed.half.period == pytest.approx(2.0 * halo_period, abs=2e-4)
        start = of_family(library, family)
        halo = periodic_orbits("Halo_L2_N", period=halo_period, clear=False)
        gap = np.abs(start.jacobi[0] - halo.jacobi).min()
        assert gap < 5e-5 if family.startswith("D") else gap < 0.033


def test_catalog_extent_goes_through_the_moon():
    through = observer_library({"Halo_L1_N": 5, "Halo_L3_S": 3}, CATALOG_EXTENT)
    assert through.perilune_km[4] < MOON_RADIUS_KM
    assert through.state[4, 0] == pytest.approx(-0.41456, abs=1e-10)
    assert through.period[4] == pytest.approx(3.1233, abs=1e-3)
    assert through.perigee_km[7] < EARTH_RADIUS_KM
    crossing = through.state[:5, [0, 2]]
    assert np.linalg.norm(np.diff(crossing, axis=0), axis=1).min() * LENGTH_UNIT_KM > 30_000


def test_wider_keep_out_shortens_the_families():
    branch = family_branch("Halo_L2_N", extent=Extent(KeepOut(10_000.0)))
    (orbit,) = (branch[-1].half,)
    times = np.linspace(0.0, orbit.period, 5000)
    _, r = primary_distances(propagate(orbit.state, times, method="dop853"))
    assert r.min() * LENGTH_UNIT_KM == pytest.approx(MOON_RADIUS_KM + 10_000.0, rel=1e-5)


def test_selection_by_jacobi_constant_and_period():
    found = periodic_orbits("Halo_L2_S", jacobi=3.05)
    assert np.abs(found.jacobi - 3.05).max() < 1e-11
    assert len(found.period) == 2
    assert np.all(found.state[:, 2] < 0.0)
    found = periodic_orbits("Halo_L1_N", period=2.0)
    assert np.abs(found.period - 2.0).max() < 1e-11


def test_selection_sees_both_sides_of_a_fold_between_members():
    """Just above its least value a Jacobi constant is taken twice, closer than the members."""
    branch = family_branch("Halo_L2_N")
    least = min(jacobi_constant(member.half.state) for member in branch)
    for above in (1e-7, 1e-9):
        found = periodic_orbits("Halo_L2_N", jacobi=least + above)
        assert len(found.period) == 2
        assert found.period[0] > found.period[1]
    with pytest.raises(ConfigurationError, match="no member"):
        periodic_orbits("Halo_L2_N", jacobi=least - 1e-4)


def test_selection_at_another_mass_ratio():
    mu = 0.012150585609624041
    # JPL catalog, L2 halo (southern): JC = 3.0151783574501501 is a row of T = 2.3781049.
    found = periodic_orbits("Halo_L2_S", period=2.3781049244613137, mu=mu)
    assert found.state[0] == pytest.approx(
        [1.0825981276635068, 0.0, -0.20232967338201202, 0.0, -0.20065420917555754, 0.0], abs=1e-8
    )


def test_progress_counts_every_orbit():
    calls = []
    observer_library({"Lyap_L2": 3, "Halo_L2_N": 1}, progress=lambda *call: calls.append(call))
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_library_is_reproducible():
    first = observer_library({"Halo_L2_N": 4})
    second = observer_library({"Halo_L2_N": 4})
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: observer_library({"Halo_L4_N": 3}), "Halo_L4_N.*did you mean 'Halo_L3_N'"),
        (lambda: family_branch("Vertical_L1"), "Vertical_L1.*Dragonfly_S"),
        (lambda: observer_library({"Lyap_L1": 0}), "Lyap_L1.*at least 1"),
        (lambda: observer_library({"Lyap_L1": 2.5}), "Lyap_L1.*whole number"),
        (lambda: observer_library({}), "at least one orbit family"),
        (
            lambda: family_branch("Dragonfly_N", extent=Extent(KeepOut(60_000.0))),
            "lower the keep-out",
        ),
    ],
)
def test_impossible_settings_are_named(call, message):
    with pytest.raises(ConfigurationError, match=message):
        call()


def test_default_mass_ratio_is_the_papers():
    assert MU == 0.01215
