"""Equiangular sampling of the regions within zero-velocity surfaces (Paul & Fan, section 3).

The paper samples "in an equiangular manner within each zero-velocity surface" without further
details. The choices made here are settings of `SamplingSettings`;
`cislunar.targets.zero_velocity` defines the regions.

Outer cap
    Below JC(L2) the region is unbounded, and below JC(L4) = 2.988 nothing in the plane is
    forbidden. Points therefore stay within `outer_radius_km` of the Earth-Moon barycenter. The
    paper gives no cap. The default, 700,000 km, is *chosen* so that the published families and
    counts of Scenario A give about the published J = 1.51e-4 (best members, C_d = 1; 500,000 km
    gives 1.9e-4, 770,000 km 1.3e-4). That agreement is no confirmation.
Centers
    A grid centered on a body samples only the component of that body (as far as it is part of the
    region), so that the lobes of the Moon and of the Earth are each resolved from within. A grid
    with another center samples the whole region. The default has both bodies; the part that is
    reachable from both is then sampled densely around each.
Directions
    A grid of longitude and latitude about the center with equal steps, in which the poles (along z)
    occur once. It is symmetric about the planes y = 0 and z = 0.
Radii
    Each ray is divided within the region (in one interval, or in several where it leaves and
    re-enters the region) into `radial_points` equal steps, with a point in the middle of each. The
    points thus follow the surface without lying on it; a lobe of 3,700 km around the Moon is
    resolved as well as a region of 500,000 km, and missions have about equal weight.
    `radial_step_km` sets the length of the steps instead (at least one per ray), so that large
    regions have more weight.
Bodies
    Points inside the Earth or the Moon are excluded.
Duplicates
    Each mission is sampled separately. Missions with equal Jacobi constant repeat its points, which
    have more weight in the clusters, as the paper describes. Within one mission, points that occur
    in the grids of two centers (to 1e-9 of a unit) are kept once.
"""

from collections.abc import Callable, Sequence
from typing import Annotated, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import AfterValidator, Field

from cislunar.constants import EARTH_RADIUS_KM, LENGTH_UNIT_KM, MOON_RADIUS_KM, MU
from cislunar.dynamics.cr3bp import libration_points, primary_distances
from cislunar.errors import ConfigurationError
from cislunar.runtime import Array, Section, array_of, counted, number, setting, several, whole
from cislunar.targets.zero_velocity import REGIONS, reachable

CENTERS = ("moon", "earth", "barycenter", "L1", "L2", "L3", "L4", "L5")

# Trial radii along each ray, 1 percent apart, that bracket the boundaries of the region.
_TRIAL_RATIO = 1.01
_BISECTIONS = 40


def _divides_half_turn(step_deg: float) -> float:
    if abs(180.0 / step_deg - round(180.0 / step_deg)) > 1e-9:
        raise ValueError("must divide 180")
    return step_deg


class SamplingSettings(Section):
    """Settings of the sampling of a region within a zero-velocity surface."""

    # fmt: off

    centers: Annotated[several(Literal[CENTERS]), Field(min_length=1)] = setting(
        "centers of the angular grids", default=["moon", "earth"])
    region: Literal[REGIONS] = setting(
        "sampled part of the region within a zero-velocity surface: the component of the `moon`, "
        "of the `earth`, of both `bodies`, or `all`", default="moon")
    angular_step_deg: Annotated[
        number(ge=0.1, le=90), AfterValidator(_divides_half_turn)
    ] = setting("step in longitude and latitude", "deg", "equiangular", default=15)
    radial_points: whole(ge=1, le=10_000) = setting("number of points along each ray", default=8)
    radial_step_km: number(ge=1) | None = setting(
        "radial step in place of `radial_points`; null: `radial_points` holds", "km",
        default=None)
    outer_radius_km: number(gt=384_400, le=10_000_000) = setting(
        "maximum distance of a sampled point from the barycenter", "km", default=700_000)

    # fmt: on


class _SampledPoints(NamedTuple):
    """Points sampled for a list of missions: `position` (point, 3), nondimensional, rotating frame,
    with the index and the Jacobi constant of the mission (point,)."""

    position: Array
    mission: NDArray[np.int64]
    jacobi: Array


def equiangular_directions(step_deg: float) -> Array:
    """Unit vectors (direction, 3) on a grid of equal steps in longitude and latitude that divide
    180 degrees: south pole, rings from south to north, north pole."""
    half = round(180.0 / step_deg)
    # Sines over half a turn, mirrored at a right angle: the grid is symmetric to the
    # last digit, so that the order of its points does not depend on rounding.
    steps = np.arange(half + 1)
    sine = np.sin(np.radians(step_deg) * np.minimum(steps, half - steps))
    cosine = np.sign(half - 2 * steps) * np.sin(np.radians(step_deg) * np.abs(0.5 * half - steps))
    cos_lat, sin_lat = sine[1:-1], -cosine[1:-1]
    cos_lon = np.concatenate([cosine[:-1], -cosine[:-1]])
    sin_lon = np.concatenate([sine[:-1], -sine[:-1]])
    rings = [np.outer(cos_lat, cos_lon), np.outer(cos_lat, sin_lon)]
    rings.append(np.repeat(sin_lat[:, None], 2 * half, axis=1))
    pole = np.array([[0.0, 0.0, 1.0]])
    return np.concatenate([-pole, np.stack(rings, axis=-1).reshape(-1, 3), pole])


def sample_region(jacobi: float, settings: SamplingSettings | None = None) -> Array:
    """Points (point, 3) within the zero-velocity surface of one Jacobi constant, nondimensional,
    rotating frame; center by center, direction by direction, outwards."""
    s = settings or SamplingSettings()
    directions = equiangular_directions(s.angular_step_deg)
    parts = []
    for name in s.centers:
        center, inner = _center(name)

        def inside(position: Array, name: str = name) -> NDArray[np.bool_]:
            return _inside(position, jacobi, name, s)

        farthest = s.outer_radius_km / LENGTH_UNIT_KM + float(np.linalg.norm(center))
        intervals = _intervals(center, directions, max(inner, 1e-3), farthest, inside)
        ray, radius = _divide(*intervals, s)
        points = center + directions[ray] * radius[:, None]
        # A body between two trial radii may have been missed.
        parts.append(points[inside(points)])
    points = np.concatenate(parts)
    if len(parts) > 1:
        _, first = np.unique(np.round(points, 9), axis=0, return_index=True)
        points = points[np.sort(first)]
    return points


def sample_zero_velocity(
    jacobi: ArrayLike,
    settings: SamplingSettings | None = None,
    *,
    names: Sequence[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> _SampledPoints:
    """Points within the zero-velocity surface of each mission, one mission after the other.

    Parameters
    ----------
    jacobi : array_like, shape (mission,)
        Jacobi constant of each mission; equal values are sampled for each mission.
    settings : SamplingSettings, optional
        By default `SamplingSettings()`.
    names : sequence of str, optional
        Names of the missions, for messages.
    progress : callable, optional
        Called with (missions done, missions).

    Returns
    -------
    NamedTuple
        ``position``, shape (point, 3), nondimensional, rotating frame, and ``mission`` and
        ``jacobi``, shape (point,), the index and the Jacobi constant of the mission of each point.

    Raises
    ------
    ConfigurationError
        If there is no mission, a constant is not finite, or a mission has no point with these
        settings.
    """
    constants = array_of("jacobi", np.atleast_1d(array_of("jacobi", jacobi)), ("mission",))
    cache: dict[float, Array] = {}
    for index, jc in counted([*enumerate(constants.tolist())], progress):
        if jc not in cache:
            cache[jc] = sample_region(jc, settings)
        if not len(cache[jc]):
            who = names[index] if names is not None else f"mission {index}"
            raise ConfigurationError(
                f"targets: no point is sampled within the zero-velocity surface of {who} "
                f"(JC = {jc}); add a center inside it, or refine angular_step_deg and the radii"
            )
    parts = [cache[jc] for jc in constants.tolist()]
    counts = [len(part) for part in parts]
    return _SampledPoints(
        position=np.concatenate(parts),
        mission=np.repeat(np.arange(len(parts)), counts),
        jacobi=np.repeat(constants, counts),
    )


def _center(name: str) -> tuple[Array, float]:
    """Position of a center and the radius of the body there, nondimensional."""
    if name == "moon":
        return np.array([1.0 - MU, 0.0, 0.0]), MOON_RADIUS_KM / LENGTH_UNIT_KM
    if name == "earth":
        return np.array([-MU, 0.0, 0.0]), EARTH_RADIUS_KM / LENGTH_UNIT_KM
    if name == "barycenter":
        return np.zeros(3), 0.0
    return libration_points()[int(name[1]) - 1], 0.0


def _intervals(
    center: Array,
    directions: Array,
    start: float,
    farthest: float,
    inside: Callable[[Array], NDArray[np.bool_]],
) -> tuple[NDArray[np.intp], Array, Array]:
    """Intervals of rays within the region: ray, first and last radius of each. They are ordered by
    ray and radius; the ends are bisected to the last digit, from within."""
    count = int(np.ceil(np.log(farthest / start) / np.log(_TRIAL_RATIO))) + 1
    trial = np.geomspace(start * (1.0 + 1e-12), farthest, count)
    mask = inside(center + directions[:, None, :] * trial[None, :, None])
    edge = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)

    def refine(ray: NDArray[np.intp], within: Array, without: Array) -> Array:
        for _ in range(_BISECTIONS):
            middle = 0.5 * (within + without)
            belongs = inside(center + directions[ray] * middle[:, None])
            within = np.where(belongs, middle, within)
            without = np.where(belongs, without, middle)
        return within

    ray, enters = np.nonzero(edge == 1)
    _, leaves = np.nonzero(edge == -1)
    first = refine(ray, trial[enters], trial[np.maximum(enters - 1, 0)])
    last = refine(ray, trial[leaves - 1], trial[np.minimum(leaves, count - 1)])
    return ray, first, last


def _divide(
    ray: NDArray[np.intp], first: Array, last: Array, settings: SamplingSettings
) -> tuple[NDArray[np.intp], Array]:
    """Midpoints of equal steps along the intervals of each ray: ray and radius of each point."""
    rays, radii = [], []
    for index in np.unique(ray):
        own = ray == index
        length = last[own] - first[own]
        ends = np.cumsum(length)
        count = settings.radial_points
        if settings.radial_step_km is not None:
            count = max(1, round(ends[-1] * LENGTH_UNIT_KM / settings.radial_step_km))
        traveled = (np.arange(count) + 0.5) * ends[-1] / count
        interval = np.searchsorted(ends, traveled)
        radii.append(first[own][interval] + traveled - (ends - length)[interval])
        rays.append(np.full(count, index))
    if not rays:
        return np.empty(0, dtype=np.intp), np.empty(0)
    return np.concatenate(rays), np.concatenate(radii)


def _inside(
    position: Array, jacobi: float, center: str, settings: SamplingSettings
) -> NDArray[np.bool_]:
    """Whether points may belong to a center's grid: in its region and the cap, not in a body."""
    d, r = primary_distances(position)
    clear = (d >= EARTH_RADIUS_KM / LENGTH_UNIT_KM) & (r >= MOON_RADIUS_KM / LENGTH_UNIT_KM)
    capped = np.linalg.norm(position, axis=-1) <= settings.outer_radius_km / LENGTH_UNIT_KM
    inside = clear & capped & reachable(position, jacobi, settings.region)
    if center in ("moon", "earth"):
        inside &= reachable(position, jacobi, center)
    return inside
