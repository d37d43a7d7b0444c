"""Ephemeris forces against SciPy with SPICE in the right-hand side, geometry and closed forms."""

import numpy as np
import pytest
import spiceypy
from numba import njit
from scipy.integrate import solve_ivp

from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM, MU, TIME_UNIT_S
from cislunar.dynamics import forces as seam
from cislunar.dynamics.adaptive.runge_kutta import derivative as put_derivative
from cislunar.dynamics.bundle import propagate_bundle, step_bundle, step_cloud
from cislunar.dynamics.cr3bp import EARTH_MOON
from cislunar.dynamics.ephemeris import UNITS, forces_between, propagate_utc
from cislunar.dynamics.ephemeris_forces import ephemeris_forces
from cislunar.dynamics.frames import pulsating_frame, recenter, to_inertial
from cislunar.dynamics.moon_figure import MOON_C22, MOON_GRAVITY_RADIUS_KM, MOON_J2
from cislunar.dynamics.propagation import propagate, propagate_stm
from cislunar.dynamics.radiation import (
    ASTRONOMICAL_UNIT_KM,
    SOLAR_PRESSURE_N_M2,
    SUN_RADIUS_KM,
)
from cislunar.dynamics.tableau import STAGES8
from cislunar.ephemeris.bodies import (
    BODY_COLUMNS,
    GM_EARTH,
    GM_MOON,
    GM_SUN,
    BodyTable,
    moon_axes,
    read_table,
)
from cislunar.ephemeris.kernel import EARTH, EARTH_MOON_BARYCENTER, MOON, SUN, kernel_path, loaded
from cislunar.ephemeris.time_scales import tdb_seconds
from cislunar.errors import ConfigurationError, InputFileError

FIRST, AREA_TO_MASS, REFLECTIVITY = "2024-10-01T00:00:00", 0.01, 1.4
START = tdb_seconds(FIRST)
HALO = np.array([1.0842, 0.0, -0.2010, 0.0, -0.2128, 0.0])


@pytest.fixture(scope="module")
def forces():
    return forces_between(FIRST, "2024-10-08", area_to_mass=AREA_TO_MASS, reflectivity=REFLECTIVITY)


@pytest.fixture(scope="module")
def starts(forces):
    """A halo, a geostationary orbit in the season of eclipses, and a low lunar orbit; km, km/s."""
    r = MOON_RADIUS_KM + 100.0
    v = np.sqrt(GM_MOON / r)
    return {
        "halo": to_inertial(HALO, pulsating_frame(forces.table, START)),
        "geostationary": recenter(
            [42_164.0, 0, 0, 0, 3.0747, 0.01], forces.table, START, old="earth", new="barycenter"
        ),
        "lunar": recenter(
            [r, 0, 0, 0, 0.6 * v, 0.8 * v], forces.table, START, old="moon", new="barycenter"
        ),
    }


def pull(r, body, gm):
    d = r - body
    return -gm * d / np.linalg.norm(d) ** 3


def visible(from_body, from_sun, radius):
    """Visible fraction of the Sun, written anew with arc cosines."""
    a = np.arcsin(SUN_RADIUS_KM / np.linalg.norm(from_sun))
    b = np.arcsin(min(1.0, radius / np.linalg.norm(from_body)))
    cosine = from_body @ from_sun / np.linalg.norm(from_body) / np.linalg.norm(from_sun)
    c = np.arccos(np.clip(cosine, -1.0, 1.0))
    if c >= a + b:
        return 1.0
    if c <= abs(b - a):
        return 0.0 if b > a else 1.0 - (b / a) ** 2
    x = (c * c + a * a - b * b) / (2.0 * c)
    y = np.sqrt(a * a - x * x)
    area = a * a * np.arccos(x / a) + b * b * np.arccos((c - x) / b) - c * y
    return 1.0 - area / (np.pi * a * a)


def potential(r):
    """J2 and C22 in the axes of the Moon, km^2/s^2, in latitude and longitude."""
    n = np.linalg.norm(r)
    sine = r[2] / n
    longitude = np.arctan2(r[1], r[0])
    ratio2 = (MOON_GRAVITY_RADIUS_KM / n) ** 2
    return (
        (GM_MOON / n)
        * ratio2
        * (
            -MOON_J2 * (3.0 * sine**2 - 1.0) / 2.0
            + 3.0 * MOON_C22 * (1.0 - sine**2) * np.cos(2.0 * longitude)
        )
    )


def figure(r):
    """Its gradient by Cartesian coordinates."""
    n, k = np.linalg.norm(r), GM_MOON * MOON_GRAVITY_RADIUS_KM**2
    x, y, z = r
    zonal = np.array([-2.0 * x, -2.0 * y, 4.0 * z]) / n**5 - 5.0 * (3 * z * z - n * n) * r / n**7
    tesseral = np.array([2.0 * x, -2.0 * y, 0.0]) / n**5 - 5.0 * (x * x - y * y) * r / n**7
    return k * (-0.5 * MOON_J2 * zonal + 3.0 * MOON_C22 * tesseral)


def reference(t, state):
    """Time derivative with SPICE called for every body, km and s."""
    r = state[:3]
    earth, moon, sun = (
        spiceypy.spkgps(body, t, "J2000", EARTH_MOON_BARYCENTER)[0] for body in (EARTH, MOON, SUN)
    )
    origin = GM_EARTH * pull(earth, sun, GM_SUN) + GM_MOON * pull(moon, sun, GM_SUN)
    axes = moon_axes(t)
    d = r - sun
    lit = visible(r - earth, d, EARTH_RADIUS_KM) * visible(r - moon, d, MOON_RADIUS_KM)
    pressure = 1e-3 * SOLAR_PRESSURE_N_M2 * AREA_TO_MASS * REFLECTIVITY * lit
    acceleration = (
        pull(r, earth, GM_EARTH)
        + pull(r, moon, GM_MOON)
        + pull(r, sun, GM_SUN)
        - origin / (GM_EARTH + GM_MOON)
        + axes.T @ figure(axes @ (r - moon))
        + pressure * ASTRONOMICAL_UNIT_KM**2 * d / np.linalg.norm(d) ** 3
    )
    return np.concatenate([state[3:], acceleration])


@pytest.mark.parametrize(
    ("name", "stop", "tolerance_m"),
    [
        ("halo", "2024-10-02T00:00:00", 5e-3),
        ("geostationary", "2024-10-02T00:00:00", 5e-3),
        ("lunar", "2024-10-01T02:00:00", 5e-2),
        ("halo", "2024-10-08T00:00:00", 1.0),
    ],
)
def test_against_scipy_with_spice(forces, starts, name, stop, tolerance_m):
    found = propagate_utc(starts[name], FIRST, stop, forces=forces)

    def derivative(t, y):
        return reference(START + t * TIME_UNIT_S, y * UNITS) / UNITS * TIME_UNIT_S

    span = 0.0, (tdb_seconds(stop) - START) / TIME_UNIT_S
    with loaded(kernel_path()):
        solution = solve_ivp(
            derivative, span, starts[name] / UNITS, "DOP853", rtol=1e-13, atol=1e-13
        )
    expected = solution.y[:, -1] * UNITS
    assert 1e3 * np.linalg.norm(found[:3] - expected[:3]) < tolerance_m


def derivative(forces, t, state):
    """Time derivative of a state, km and s, by the compiled kernel; t nondimensional."""
    out = np.empty(6)
    put_derivative(forces, t, np.asarray(state) / UNITS, out)
    return out * UNITS / TIME_UNIT_S


def test_acceleration_in_shadow_and_sunlight(forces, starts):
    """Near the Moon, in its penumbra and the Earth's, and far away."""
    rng = np.random.default_rng(2)
    table = forces.table
    lit = []
    with loaded(kernel_path()):
        for k in range(60):
            t = START + 3_600.0 * k
            body, radius = (("moon", MOON_RADIUS_KM), ("earth", EARTH_RADIUS_KM))[k % 2]
            sun = -recenter(np.zeros(6), table, t, old=body, new="sun")[:3]
            away = -sun / np.linalg.norm(sun)
            across = np.cross(away, rng.standard_normal(3))
            place = away * radius * rng.uniform(1, 20) + across / np.linalg.norm(across) * (
                radius * rng.uniform(0.9, 1.1)
            )
            state = recenter([*place, 0, 0, 0], table, t, old=body, new="barycenter")
            found = derivative(forces, (t - START) / TIME_UNIT_S, state)
            np.testing.assert_allclose(found[3:], reference(t, state)[3:], rtol=0, atol=2e-14)
            lit.append(visible(place, place - sun, radius))
    assert 5 < np.sum((np.array(lit) > 0.0) & (np.array(lit) < 1.0)) < 60


def test_figure_is_the_gradient_of_its_potential():
    for r in np.random.default_rng(3).uniform(-4_000.0, 4_000.0, (10, 3)):
        slopes = [(potential(r + e) - potential(r - e)) / 2.0 for e in np.eye(3)]
        np.testing.assert_allclose(figure(r), slopes, rtol=0, atol=1e-6 * np.linalg.norm(slopes))
    assert pytest.approx(2.032e-4, rel=1e-3) == MOON_J2
    assert pytest.approx(2.238e-5, rel=1e-3) == MOON_C22


def test_variational_equations(forces, starts):
    """Against differences of the right-hand side in penumbra and near the Moon, and of a day."""
    table = forces.table
    sun = -recenter(np.zeros(6), table, START, old="moon", new="sun")[:3]
    away = -sun / np.linalg.norm(sun)
    across = np.cross(away, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    penumbra = [*(3_000.0 * away + (MOON_RADIUS_KM + 0.5) * across), 0.1, 0.2, 0.3]
    for place in (penumbra, [0.0, 1_500.0, 1_200.0, 1.0, 0.0, 0.0]):
        state = recenter(place, table, START, old="moon", new="barycenter") / UNITS
        out = np.empty(42)
        put_derivative(forces, 0.0, np.concatenate([state, np.eye(6).ravel()]), out)
        differences, step = np.empty((6, 6)), 2e-8
        for k in range(6):
            ahead, behind = np.empty(6), np.empty(6)
            put_derivative(forces, 0.0, state + step * np.eye(6)[k], ahead)
            put_derivative(forces, 0.0, state - step * np.eye(6)[k], behind)
            differences[:, k] = (ahead - behind) / (2.0 * step)
        found = out[6:].reshape(6, 6).copy()
        np.testing.assert_allclose(found, differences, rtol=1e-6, atol=1e-6 * np.abs(found).max())
        unlit = forces._replace(radiation=forces.radiation._replace(strength=0.0))
        put_derivative(unlit, 0.0, np.concatenate([state, np.eye(6).ravel()]), out)
        changed = np.abs(out[6:].reshape(6, 6) - found).max()
        assert (changed > 1e-3) == (place is penumbra)
    start, day = starts["halo"] / UNITS, 86_400.0 / TIME_UNIT_S
    end, stm = propagate_stm(start, day, forces=forces)
    np.testing.assert_allclose(
        end, propagate(start, [day], forces=forces, method="dop853")[0], rtol=0, atol=1e-12
    )
    for k in range(6):
        step = 1e-6 * np.eye(6)[k]
        ends = [
            propagate(start + s * step, [day], forces=forces, method="dop853")[0] for s in (1, -1)
        ]
        np.testing.assert_allclose(stm[:, k], (ends[0] - ends[1]) / 2e-6, rtol=0, atol=1e-7)


def test_targets_of_a_bundle_differ_in_radiation_pressure(forces, starts):
    """Each agrees with a single propagation of its area and coefficient, in sunlight and shadow."""
    areas, coefficients = np.array([0.0, 0.01, 0.05]), np.array([1.0, 1.4, 1.9])
    each = ephemeris_forces(forces.table, START, area_to_mass=areas, reflectivity=coefficients)
    bundle = np.repeat(starts["lunar"][None] / UNITS, 3, axis=0)
    step, count = 60.0 / TIME_UNIT_S, 120
    tracks = propagate_bundle(bundle, step, count, forces=each)
    for track, area, coefficient in zip(tracks, areas, coefficients, strict=True):
        alone = ephemeris_forces(forces.table, START, area_to_mass=area, reflectivity=coefficient)
        end = propagate(bundle[0], [count * step], forces=alone, method="dop853")[0]
        # Steps of a minute do not end at the edge of the shadow: an error of a decimeter.
        np.testing.assert_allclose(track[-1, :3], end[:3], rtol=0, atol=3e-10)
    apart = LENGTH_UNIT_KM * np.linalg.norm(tracks[2, -1, :3] - tracks[0, -1, :3])
    assert 1e-3 < apart < 1e-1

    @njit
    def strength(model, i):
        return seam.of_state(model, i).radiation.strength

    assert [strength(each, i) for i in range(3)] == list(each.radiation.strength)
    assert strength(forces, 2) == forces.radiation.strength


def _day_of_a_cloud(forces, points, whole, step):
    slopes, work = np.empty((STAGES8, *points.shape)), np.empty(points.shape)
    for k in range(1440):
        step_cloud(forces, k * step, points, step, slopes, work)
        step_bundle(forces, k * step, whole, step, slopes, work)


@pytest.mark.parametrize(("name", "calm"), [("halo", True), ("high lunar", True), ("lunar", False)])
def test_clouds_take_fewer_stages_away_from_the_moon_alone(forces, starts, name, calm):
    """As in the CR3BP: exact to a tenth of the tolerance a day, or the same steps.

    The high lunar orbit faces the Sun: steps do not end at edges of a shadow.
    """
    sun = read_table(forces.table, START)[0][BODY_COLUMNS["sun"]]
    aside = np.cross(sun, [0.0, 0.0, 1.0])
    along = np.cross(sun, aside)
    r, v = (each / np.linalg.norm(each) for each in (aside, along))
    high = np.concatenate([7_500.0 * r, np.sqrt(GM_MOON / 7_500.0) * v])
    high = recenter(high, forces.table, START, old="moon", new="barycenter")
    state = {**starts, "high lunar": high}[name] / UNITS
    points = state[:, None] + 1e-5 * np.random.default_rng(1).standard_normal((6, 3))
    whole = points.copy()
    _day_of_a_cloud(forces, points, whole, 60.0 / TIME_UNIT_S)
    apart = np.max(np.abs(points - whole))
    assert (0.0 < apart < 1e-11) if calm else apart == 0.0


def test_kepler_motion_about_an_earth_at_rest(forces):
    """Without Moon, Sun and radiation a circle closes after its period, and energy is constant."""
    still = np.zeros((1_000, 4, 9))
    still[:, 0, 3], still[:, 0, 6] = 3.8e5, 1.5e8
    alone = ephemeris_forces(BodyTable(0.0, 600.0, still), 0.0, area_to_mass=0.0)._replace(
        gm_moon=0.0, gm_sun=0.0
    )
    alone = alone._replace(
        figure=alone.figure._replace(coefficients=0.0 * alone.figure.coefficients)
    )
    radius = 42_164.0 / LENGTH_UNIT_KM
    speed = np.sqrt(alone.gm_earth / radius)
    start = np.array([radius, 0.0, 0.0, 0.0, 0.8 * speed, 0.6 * speed])
    times = 2.0 * np.pi * radius / speed * np.array([0.25, 0.5, 1.0, 3.0])
    track = propagate(start, times, forces=alone, method="dop853")
    np.testing.assert_allclose(track[0, :3], radius * np.array([0.0, 0.8, 0.6]), rtol=0, atol=1e-12)
    np.testing.assert_allclose(track[2:], [start, start], rtol=0, atol=1e-10)


def test_sunlight_pushes_away_from_the_sun():
    """0.01 m^2/kg with C_R = 1 is pushed by 4.54e-8 m/s^2 at an astronomical unit."""
    still = np.zeros((2, 4, 9))
    still[:, 0, 3], still[:, 0, 6] = 3.8e5, -ASTRONOMICAL_UNIT_KM
    model = ephemeris_forces(
        BodyTable(0.0, 600.0, still), 0.0, area_to_mass=0.01, reflectivity=1.0
    )._replace(gm_earth=1e-30, gm_moon=1e-30, gm_sun=0.0)
    model = model._replace(
        figure=model.figure._replace(coefficients=0.0 * model.figure.coefficients)
    )
    lit = derivative(model, 0.0, [0.0, 1e5, 0.0, 0.0, 0.0, 0.0])
    assert 1e3 * lit[3] == pytest.approx(4.5398e-8, rel=1e-4)
    dark = derivative(model, 0.0, [1e4, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert dark[3] == pytest.approx(0.0, abs=1e-25)


def test_round_trip_and_several_instants(forces, starts):
    state = recenter(starts["halo"], forces.table, START, old="barycenter", new="moon")
    stops = ["2024-10-01T12:00:00", "2024-10-03T00:00:00"]
    there = propagate_utc(state, FIRST, stops, forces=forces, center="moon")
    back = propagate_utc(there[1], stops[1], FIRST, forces=forces, center="moon")
    np.testing.assert_allclose(back[:3], state[:3], rtol=0, atol=1e-6)
    halfway = propagate_utc(there[1], stops[1], stops[0], forces=forces, center="moon")
    np.testing.assert_allclose(halfway[:3], there[0, :3], rtol=0, atol=1e-6)
    assert there.shape == (2, 6)


def test_bad_input_is_refused(forces, starts, tmp_path):
    state = starts["halo"]
    with pytest.raises(InputFileError, match=r"de421\.bsp: covers .* not the requested dates"):
        propagate_utc(state, "2060-01-01", "2060-01-02")
    with pytest.raises(InputFileError, match=r"none\.bsp: no such file"):
        forces_between(FIRST, "2024-10-02", kernel=tmp_path / "none.bsp")
    with pytest.raises(ConfigurationError, match=r"inside the Moon: 1000\.000 km .* 1737\.4 km"):
        propagate_utc([1_000.0, 0, 0, 0, 1, 0], FIRST, "2024-10-02", forces=forces, center="moon")
    for wrong in ([np.nan, 1.0, 0, 0, 1, 0], [9e4, 1.0, 0]):
        with pytest.raises(ConfigurationError, match=r"6 finite numbers, got \[.*1\.0, 0"):
            propagate_utc(wrong, FIRST, "2024-10-02", forces=forces)
    with pytest.raises(
        ConfigurationError, match=r"covers 2024-10-01.*not the requested dates.*2024-11-01"
    ):
        propagate_utc(state, FIRST, "2024-11-01", forces=forces)
    with pytest.raises(ConfigurationError, match=r"table of bodies covers .* not 0\.0000 to 30"):
        propagate(state / UNITS, [30.0 * 86_400.0 / TIME_UNIT_S], forces=forces)
    with pytest.raises(ConfigurationError, match="table of bodies covers"):
        propagate_bundle(state[None] / UNITS, 1.0, 10, forces=forces)
    with pytest.raises(ConfigurationError, match="CR3BP is not an ephemeris force model"):
        propagate_utc(state, FIRST, "2024-10-02", forces=EARTH_MOON)
    with pytest.raises(ConfigurationError, match="area_to_mass = -1"):
        forces_between(FIRST, "2024-10-02", area_to_mass=-1.0)
    for wrong, quantity in (
        ([4e8, 0, 0, 0, 1e3, 0], "distance"),
        ([7e6, 0, 0, 0, 7.5e3, 0], "speed"),
    ):
        with pytest.raises(ConfigurationError, match=f"state: its {quantity} .* divide meters"):
            propagate_utc(wrong, FIRST, "2024-10-02", forces=forces)
    with pytest.raises(ConfigurationError, match="must be a date"):
        propagate_utc(state, FIRST, [], forces=forces)
    with pytest.raises(ConfigurationError, match="None is not a date"):
        propagate_utc(state, None, FIRST, forces=forces)
    with pytest.raises(ConfigurationError, match="center = 'mars' must be one of"):
        propagate_utc(state, FIRST, "2024-10-02", forces=forces, center="mars")
    assert pytest.approx(forces.gm_moon / (forces.gm_earth + forces.gm_moon), abs=1e-6) == MU
