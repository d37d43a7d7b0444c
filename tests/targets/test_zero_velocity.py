"""Sampling within zero-velocity surfaces, against flood filling and closed forms."""

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import label
from scipy.optimize import brentq

from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM, MU
from cislunar.dynamics.cr3bp import libration_points, zero_velocity_function
from cislunar.errors import ConfigurationError
from cislunar.targets.missions import load_missions
from cislunar.targets.sampling import (
    SamplingSettings,
    equiangular_directions,
    sample_region,
    sample_zero_velocity,
)
from cislunar.targets.zero_velocity import reachable

MOON = np.array([1.0 - MU, 0.0, 0.0])
EARTH = np.array([-MU, 0.0, 0.0])
# Below L4, between L4 and L3, L3 and L2, L2 and L1 (twice), and above all of them.
JACOBI = (2.91, 3.0, 3.0466, 3.1, 3.18, 3.35, 3.71, 5.49)


def same_set(a, b):
    a, b = (np.unique(np.round(p, 10) + 0.0, axis=0) for p in (a, b))
    return a.shape == b.shape and np.allclose(a, b, atol=1e-9)


def lobe_radius(jacobi, body, towards):
    """Distance from a body to its surface of zero velocity along the axis."""
    mu_body = MU if body is MOON else 1.0 - MU

    def speed2(r):
        return float(zero_velocity_function([body[0] + towards * r, 0.0, 0.0], jacobi))

    gate = abs(libration_points()[0, 0] - body[0])
    return brentq(speed2, 1e-3 * mu_body, gate)


def test_radii_of_the_lobes():
    """Lunar and terrestrial lobes towards L1, km: published orders 24,000 to 3 700 and 270,000."""
    for jacobi, moon, earth in [
        (3.35, 24190, 273500),
        (3.71, 12370, 229600),
        (5.49, 3680, 142700),
    ]:
        assert lobe_radius(jacobi, MOON, -1) * LENGTH_UNIT_KM == pytest.approx(moon, rel=2e-3)
        assert lobe_radius(jacobi, EARTH, 1) * LENGTH_UNIT_KM == pytest.approx(earth, rel=2e-3)


@pytest.mark.parametrize("jacobi", JACOBI)
def test_membership_agrees_with_flood_filling(jacobi):
    """Connected components of a grid of voxels, half of space (the other half is its mirror)."""
    step = 0.02
    x = np.arange(-2.2, 2.2, step) + 0.003
    y = np.arange(0.0, 2.4, step)
    z = np.arange(0.0, 1.2, step)
    grid = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
    allowed = zero_velocity_function(grid, jacobi) >= 0.0
    component, _ = label(allowed)
    for region, bodies in (("moon", [MOON]), ("earth", [EARTH]), ("bodies", [MOON, EARTH])):
        wanted = np.zeros(allowed.shape, dtype=bool)
        for body in bodies:
            seed = (int(np.argmin(np.abs(x - body[0]))), 0, 0)
            assert allowed[seed], "the grid is too coarse for the lobe"
            wanted |= component == component[seed]
        np.testing.assert_array_equal(reachable(grid, jacobi, region), wanted, err_msg=region)


def test_all_regions_is_the_sign_of_the_zero_velocity_function():
    rng = np.random.default_rng(1)
    points = rng.uniform(-2.0, 2.0, (2000, 3))
    wanted = zero_velocity_function(points, 3.1) >= 0.0
    np.testing.assert_array_equal(reachable(points, 3.1, "all"), wanted)


@pytest.mark.parametrize("step", [10.0, 15.0, 45.0, 90.0])
def test_directions_are_equiangular(step):
    direction = equiangular_directions(step)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1.0, atol=1e-15)
    rings, around = round(180 / step) - 1, round(360 / step)
    assert len(direction) == rings * around + 2
    ring = direction[1:-1].reshape(rings, around, 3)
    latitude = np.degrees(np.arcsin(ring[:, :, 2]))
    np.testing.assert_allclose(latitude, latitude[:, :1] + np.zeros(around), atol=1e-12)
    np.testing.assert_allclose(np.diff(latitude[:, 0], prepend=-90, append=90), step, atol=1e-10)
    turn = np.einsum("raj,raj->ra", ring[..., :2], np.roll(ring, -1, axis=1)[..., :2])
    turn /= np.sum(ring[..., :2] ** 2, axis=-1)
    np.testing.assert_allclose(np.degrees(np.arccos(turn)), step, atol=1e-6)


@pytest.mark.parametrize("jacobi", JACOBI)
def test_points_are_allowed_and_clear_of_the_bodies(jacobi):
    settings = SamplingSettings()
    points = sample_region(jacobi, settings)
    assert zero_velocity_function(points, jacobi).min() >= 0.0
    to_moon = np.linalg.norm(points - MOON, axis=1) * LENGTH_UNIT_KM
    to_earth = np.linalg.norm(points - EARTH, axis=1) * LENGTH_UNIT_KM
    assert to_moon.min() > MOON_RADIUS_KM
    assert to_earth.min() > EARTH_RADIUS_KM
    assert np.linalg.norm(points, axis=1).max() * LENGTH_UNIT_KM <= settings.outer_radius_km


def test_landers_stay_in_the_lobe_of_the_moon():
    points = sample_region(5.49)
    reach = np.linalg.norm(points - MOON, axis=1).max() * LENGTH_UNIT_KM
    assert reach < 1.001 * lobe_radius(5.49, MOON, -1) * LENGTH_UNIT_KM
    assert reach > 0.9 * lobe_radius(5.49, MOON, -1) * LENGTH_UNIT_KM


def test_both_lobes_are_sampled_on_request():
    points = sample_region(5.49, SamplingSettings(region="bodies"))
    to_moon = np.linalg.norm(points - MOON, axis=1) * LENGTH_UNIT_KM
    lunar = to_moon < 3700.0
    assert same_set(points[lunar], sample_region(5.49))
    to_earth = np.linalg.norm(points[~lunar] - EARTH, axis=1) * LENGTH_UNIT_KM
    assert 0.9 * 142_700 < to_earth.max() < 142_800
    assert (~lunar).sum() > 1000


def rays_of(points, per_ray):
    """Radii (ray, point) and directions (ray, 3) of points seen from the Moon."""
    rays = (points - MOON).reshape(-1, per_ray, 3)
    radius = np.linalg.norm(rays, axis=2)
    return radius, rays[:, 0] / radius[:, :1]


@pytest.mark.parametrize("jacobi", [3.35, 5.49])
def test_rays_are_divided_evenly_from_the_ground_to_the_surface(jacobi):
    settings = SamplingSettings(centers=("moon",), angular_step_deg=30.0, radial_points=4)
    radius, unit = rays_of(sample_region(jacobi, settings), 4)
    np.testing.assert_allclose(unit, equiangular_directions(30.0), atol=1e-10)
    step = np.diff(radius, axis=1)
    np.testing.assert_allclose(step, step[:, :1] + np.zeros(3), rtol=1e-9)
    ground = radius[:, 0] - 0.5 * step[:, 0]
    np.testing.assert_allclose(ground * LENGTH_UNIT_KM, MOON_RADIUS_KM, rtol=1e-8)
    end = MOON + unit * (radius[:, -1] + 0.5 * step[:, 0])[:, None]
    np.testing.assert_allclose(zero_velocity_function(end, jacobi), 0.0, atol=1e-9)


def test_ray_that_leaves_the_region_and_enters_again():
    """Through both gateways at JC = 3.1: from the Moon across the forbidden ring, along y = 0."""
    settings = SamplingSettings(centers=("moon",), angular_step_deg=90.0, radial_points=400)
    points = sample_region(3.1, settings)
    seen = points - MOON
    westward = (seen[:, 0] < -1e-3) & (np.abs(seen[:, 1:]).max(axis=1) < 1e-9)
    radius = np.linalg.norm(seen[westward], axis=1)
    x = points[westward, 0]
    fine = np.linspace(-700_000.0, 0.985 * LENGTH_UNIT_KM, 400_001) / LENGTH_UNIT_KM
    line = np.stack([fine, 0 * fine, 0 * fine], axis=-1)
    to_moon, to_earth = (np.abs(fine - body[0]) * LENGTH_UNIT_KM for body in (MOON, EARTH))
    allowed = zero_velocity_function(line, 3.1) >= 0.0
    allowed &= (to_moon >= MOON_RADIUS_KM) & (to_earth >= EARTH_RADIUS_KM)
    allowed &= np.abs(fine) <= 700_000.0 / LENGTH_UNIT_KM
    edges = np.flatnonzero(np.diff(np.pad(allowed, 1).astype(int)))
    assert len(edges) == 6, "Moon to Earth, Earth to ring, beyond the ring"
    length = allowed.sum() * (fine[1] - fine[0])
    assert len(x) == 400
    short = np.sort(np.diff(np.sort(radius)))[:-2]
    np.testing.assert_allclose(short, length / 400, rtol=1e-3)


def test_fixed_radial_steps():
    settings = SamplingSettings(centers=("moon",), angular_step_deg=90.0, radial_step_km=500.0)
    radius = rays_of(sample_region(5.49, settings), 4)[0] * LENGTH_UNIT_KM
    np.testing.assert_allclose(np.diff(radius, axis=1), 485.0, atol=2.0)
    coarse = SamplingSettings(centers=("moon",), angular_step_deg=90.0, radial_step_km=1e5)
    assert len(sample_region(5.49, coarse)) == 6


def test_about_150_000_points_for_the_mission_table():
    table = Path(__file__).parents[2] / "config" / "missions.csv"
    sampled = sample_zero_velocity(load_missions(table)["jacobi"])
    assert 1.2e5 < len(sampled.position) < 1.8e5
    assert np.array_equal(np.unique(sampled.mission), np.arange(64))


@pytest.mark.parametrize("jacobi", [2.91, 3.0466, 5.49])
def test_points_are_symmetric_about_the_plane_of_the_primaries_and_the_xz_plane(jacobi):
    points = sample_region(jacobi)
    assert same_set(points, points * [1.0, -1.0, 1.0])
    assert same_set(points, points * [1.0, 1.0, -1.0])


def test_points_are_distinct_within_a_mission():
    for jacobi in (2.91, 3.1, 5.49):
        points = sample_region(jacobi)
        assert len(np.unique(np.round(points, 8), axis=0)) == len(points)


def test_points_two_centers_share_are_kept_once():
    """A ray along the axis from each body, with steps that coincide."""
    settings = SamplingSettings(centers=("earth",))
    once = sample_region(3.0, settings)
    twice = sample_region(3.0, settings.model_copy(update={"centers": ("earth", "earth")}))
    np.testing.assert_array_equal(once, twice)


def test_missions_that_share_a_jacobi_constant_repeat_its_points():
    sampled = sample_zero_velocity([5.49, 3.1, 5.49])
    first, second, third = (sampled.position[sampled.mission == i] for i in range(3))
    np.testing.assert_array_equal(first, third)
    assert len(second) != len(first)
    np.testing.assert_array_equal(sampled.jacobi, np.array([5.49, 3.1, 5.49])[sampled.mission])
    assert np.all(np.diff(sampled.mission) >= 0)
    again = sample_zero_velocity([5.49, 3.1, 5.49])
    np.testing.assert_array_equal(sampled.position, again.position)


def test_a_mission_without_points_is_refused():
    with pytest.raises(ConfigurationError, match=r"Lander \(JC = 5.49\)"):
        sample_zero_velocity(
            [3.1, 5.49], SamplingSettings(centers=("earth",)), names=["Orbiter", "Lander"]
        )
    with pytest.raises(ConfigurationError, match="jacobi has shape"):
        sample_zero_velocity([])


@pytest.mark.parametrize(
    "settings",
    [
        {"centers": ()},
        {"centers": ("mars",)},
        {"region": "mars"},
        {"angular_step_deg": 0.0},
        {"angular_step_deg": 7.0},
        {"angular_step_deg": 180.0},
        {"angular_step_deg": float("nan")},
        {"radial_points": 0},
        {"radial_step_km": 0.0},
        {"outer_radius_km": 300_000.0},
    ],
)
def test_impossible_settings_name_their_key(settings):
    with pytest.raises(ConfigurationError, match=next(iter(settings))):
        SamplingSettings(**settings)
