"""Initial orbits of published two-body cases with angles only."""

import numpy as np
import pytest
from astropy.coordinates import EarthLocation
from astropy.time import Time
from astropy.utils import iers
from detected_object import turned

from cislunar.constants import LENGTH_UNIT_KM
from cislunar.dynamics import CR3BP
from cislunar.orbit_determination import ORBIT, AdmissibleRegion, initial_orbits, make_angles


def two_body_orbit(seconds, site_km, ra_deg, dec_deg, mu_km3_s2):
    """The only orbit about the Earth through directions from a site. A CR3BP without the Moon is
    the two-body problem in a frame that rotates."""
    unit_s = np.sqrt(LENGTH_UNIT_KM**3 / mu_km3_s2)
    times, ra, dec = np.array(seconds) / unit_s, np.deg2rad(ra_deg), np.deg2rad(dec_deg)
    unit = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=1)
    angles = make_angles(
        times, np.zeros(times.size, int), turned(np.array(site_km) / LENGTH_UNIT_KM, -times),
        turned(unit, -times), 1e-8,
    )  # fmt: skip
    region = AdmissibleRegion(
        least_range_km=100, largest_distance_km=60_000, largest_jacobi=400, least_jacobi=2
    )
    found = initial_orbits(angles, forces=CR3BP(0.0), region=region, epoch=0.0)
    assert found.verdict == ORBIT and len(found.fits.state) == 1
    position, velocity = found.fits.state[0, :3], found.fits.state[0, 3:]
    velocity = velocity + np.array([-position[1], position[0], 0.0])
    return position * LENGTH_UNIT_KM, velocity * LENGTH_UNIT_KM / unit_s


def test_the_published_angles_only_cases_of_two_bodies():
    """Vallado, Fundamentals of Astrodynamics and Applications, 4th ed., example 7-2, and Curtis,
    Orbital Mechanics for Engineering Students, example 5.11 with iterative improvement: three
    directions from one site."""
    site = [[4054.881, 2748.195, 4074.237], [3956.224, 2888.232, 4074.364],
            [3905.073, 2956.935, 4074.430]]  # fmt: skip
    position, velocity = two_body_orbit(
        [-480.0, 0.0, 240.0], site, [0.939913, 45.025748, 67.886655],
        [18.667717, 35.664741, 36.996583], 398_600.4418,
    )  # fmt: skip
    # the site is published to a meter, which the geometry enlarges a hundredfold
    np.testing.assert_allclose(position, [6356.486034, 5290.5322578, 6511.396979], atol=0.15)
    np.testing.assert_allclose(velocity, [-4.172948, 4.776550, 1.720271], atol=1.5e-4)
    # latitude 40 deg, altitude 1 km, on an ellipsoid of 6378 km with the flattening 1/298.26
    latitude, sidereal = np.deg2rad(40.0), np.deg2rad([44.5065, 45.0, 45.4992])
    squared = (2.0 - 1.0 / 298.26) / 298.26
    normal = 6378.0 / np.sqrt(1.0 - squared * np.sin(latitude) ** 2)
    radius = (normal + 1.0) * np.cos(latitude)
    height = (normal * (1.0 - squared) + 1.0) * np.sin(latitude)
    site = np.stack(
        [radius * np.cos(sidereal), radius * np.sin(sidereal), np.full(3, height)], axis=1
    )
    position, velocity = two_body_orbit(
        [-118.104, 0.0, 119.473], site, [43.5365, 54.4196, 64.3178],
        [-8.78334, -12.0739, -15.1054], 398_600.0,
    )  # fmt: skip
    np.testing.assert_allclose(position, [5662.04, 6537.95, 3269.05], atol=0.02)
    np.testing.assert_allclose(velocity, [-3.88542, 5.12141, -2.24340], atol=2e-5)


@pytest.mark.parametrize(
    ("radius_km", "inclination_deg", "node_deg", "half_arc_s", "accepted"),
    [(7197.9347, 98.71, 100.41, 90.0, 1e-2), (29_600.136, 56.0, 55.41, 305.0, 1e-3),
     (29_600.136, 56.0, 55.41, 760.0, 1e-2), (42_164.0, 0.0, 107.33, 520.0, 1e-3),
     (42_164.0, 0.0, 107.33, 1300.0, 1e-2)],
)  # fmt: skip
def test_orbits_of_a_published_comparison_are_those_of_exact_directions(
    radius_km, inclination_deg, node_deg, half_arc_s, accepted
):
    """Circular orbits and arcs without noise of Dolado & Yanez, On the performance analysis of
    Initial Orbit Determination algorithms, as in the class IodGaussTest of Orekit 13, which accepts
    relative errors `accepted` for the method of Gauss; seen from a site at a latitude of 43 deg."""
    mu = 398_600.4418
    seconds = np.array([-half_arc_s, 0.0, half_arc_s])
    tilt, node = np.deg2rad([inclination_deg, node_deg])
    p = np.array([np.cos(node), np.sin(node), 0.0])
    q = np.array([-np.sin(node) * np.cos(tilt), np.cos(node) * np.cos(tilt), np.sin(tilt)])
    along = np.sqrt(mu / radius_km**3) * seconds[:, None]
    place = radius_km * (np.cos(along) * p + np.sin(along) * q)
    turn = node + 7.292115e-5 * seconds
    site = 6378.0 * np.stack([0.73 * np.cos(turn), 0.73 * np.sin(turn), 0.68 + 0.0 * turn], axis=1)
    x, y, z = (place - site).T
    ra, dec = np.rad2deg(np.arctan2(y, x)), np.rad2deg(np.arctan2(z, np.hypot(x, y)))
    position, velocity = two_body_orbit(seconds, site, ra, dec, mu)
    speed = np.sqrt(mu / radius_km)
    errors = np.array([np.linalg.norm(position - radius_km * p) / radius_km,
                       np.linalg.norm(velocity - speed * q) / speed])  # fmt: skip
    assert errors.max() < 1e-3 * accepted


def test_observations_of_a_geosynchronous_satellite_give_the_orbit_of_orekit():
    """Observations of 2023-06-09 in the test testIssue1166RaDec of IodGooding of Orekit 13: three
    directions within eleven minutes. Orekit's methods of Gooding, Laplace and Gauss give semi-major
    axes from 42389.7 km to 42394.5 km."""
    times = Time([f"2023-06-09T17:{text}" for text in ("04:59.10", "10:50.66", "16:21.09")])
    with iers.conf.set_temp("auto_download", False):
        station = EarthLocation.from_geodetic(76.971667, 43.05722, 2735.0)
        site = station.get_gcrs_posvel(times)[0].xyz.to_value("km").T
    ra = 15.0 * (16.0 + np.array([351.20, 703.73, 1035.1]) / 3600.0)
    dec = -6.0 - np.array([1904.22, 1912.36, 1920.03]) / 3600.0
    mu = 398_600.4415
    seconds = (times - times[1]).to_value("s")
    position, velocity = two_body_orbit(seconds, site, ra, dec, mu)
    momentum = np.cross(position, velocity)
    distance = np.linalg.norm(position)
    eccentricity = np.linalg.norm(np.cross(velocity, momentum) / mu - position / distance)
    assert 1.0 / (2.0 / distance - velocity @ velocity / mu) == pytest.approx(42_394.2, abs=10.0)
    assert eccentricity == pytest.approx(0.00441, abs=2e-4)
    inclination = np.arccos(momentum[2] / np.linalg.norm(momentum))
    node = np.arctan2(momentum[0], -momentum[1])
    assert np.rad2deg(inclination) == pytest.approx(0.09186, abs=1e-3)
    assert np.rad2deg(node) == pytest.approx(90.929, abs=0.3)
