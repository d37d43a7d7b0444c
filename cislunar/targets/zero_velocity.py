"""Regions within zero-velocity surfaces: where a Jacobi constant permits a mission to go.

A particle of Jacobi constant JC can be where 2U >= JC.

Region
    The surface divides space into components, and a mission can reach only its own. Since all
    missions go to the Moon, the default is the component that contains the Moon
    (``region="moon"``): above JC(L1) = 3.188 the lobe around the Moon alone, below it also the
    Earth's side, and below JC(L2) = 3.172 also the exterior. ``"earth"`` selects the component of
    the Earth, ``"bodies"`` both, ``"all"`` the whole region 2U >= JC.
Membership
    Membership is exact, from the signs of the gradient of U, without flood filling. With
    p = (1 - mu)/d^3 + mu/r^3, dU/dy = y (1 - p) and dU/dz = -z p. Where p < 1, U grows outwards
    along y to infinity, and the point belongs to the exterior. Where p >= 1, U grows towards y = 0
    and from there towards z = 0. The point is then connected with (x, 0, 0) on the axis, which
    belongs to the Earth, the Moon or the exterior according to its position relative to L3, L1 and
    L2. Components merge when JC falls below that of L1 (Earth and Moon) and L2 (these and the
    exterior).
"""

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import MU
from cislunar.dynamics.cr3bp import (
    libration_points,
    primary_distances,
    pseudo_potential,
    zero_velocity_function,
)
from cislunar.runtime.arguments import require_choice

REGIONS = ("moon", "earth", "bodies", "all")

# Labels of `component`.
_OUTSIDE, EARTH, MOON = 0, 1, 2


def component(position: ArrayLike) -> NDArray[np.int8]:
    """Component of the accessible region (`EARTH`, `MOON` or `_OUTSIDE`) to which points (..., 3)
    are connected while the gateways are closed; meaningful only where 2U >= JC. See "Membership"
    in the docstring of the module."""
    p = np.asarray(position, dtype=float)
    d, r = primary_distances(p)
    pull = (1.0 - MU) / d**3 + MU / r**3
    l1, l2, l3 = _collinear_points()
    x = p[..., 0]
    label = np.where(x < l1, EARTH, MOON)
    return np.where((pull < 1.0) | (x > l2) | (x < l3), _OUTSIDE, label).astype(np.int8)


def reachable(position: ArrayLike, jacobi: ArrayLike, region: str = "moon") -> NDArray[np.bool_]:
    """Whether points (..., 3), nondimensional, rotating frame, belong to the region of a Jacobi
    constant: ``"moon"`` or ``"earth"``, the component of 2U >= JC that contains that body;
    ``"bodies"``, those that contain either; ``"all"``, the whole of 2U >= JC."""
    require_choice("region", region, REGIONS)
    jc = np.asarray(jacobi, dtype=float)
    allowed = zero_velocity_function(position, jc) >= 0.0
    if region == "all":
        return allowed
    l1, l2, _ = _collinear_points()
    gate1, gate2 = 2.0 * pseudo_potential([[l1, 0.0, 0.0], [l2, 0.0, 0.0]])
    merged = jc <= gate1
    # The exterior is entered through L2; when L3 opens, all components have merged.
    with_outside = jc <= gate2
    with_moon = (region != "earth") | merged
    with_earth = (region != "moon") | merged
    label = component(position)
    return allowed & (
        ((label == MOON) & with_moon)
        | ((label == EARTH) & with_earth)
        | ((label == _OUTSIDE) & with_outside)
    )


@cache
def _collinear_points() -> tuple[float, float, float]:
    """Abscissas of L1, L2 and L3, cached because bisections need them repeatedly."""
    l1, l2, l3 = libration_points()[:3, 0].tolist()
    return l1, l2, l3
