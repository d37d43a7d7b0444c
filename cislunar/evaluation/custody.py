"""Custody: how well a target has to be known at the end of a run. Nothing here needs compiled
kernels."""

import numpy as np
from numpy.typing import NDArray

from cislunar.attitude.grp import GRP_A, GRP_F
from cislunar.constants import LENGTH_UNIT_KM
from cislunar.runtime import Array
from cislunar.runtime.settings_fields import Positive, Section, setting


class Custody(Section):
    """Largest errors at the end of a run with which a target is in custody."""

    position_km: Positive = setting(
        "largest position error at the end of a run with which a target is in custody",
        "km",
        "not in the paper",
        default=10,
    )
    attitude_deg: Positive = setting(
        "largest attitude error at the end of a run with which a target is in custody",
        "deg",
        "not in the paper",
        default=5,
    )

    def satisfied(self, error: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether the positions and the attitudes of errors of states (..., 12) are within the
        limits, (...) each; NaN, of a failed estimate, is not."""
        away_km = LENGTH_UNIT_KM * np.sqrt((error[..., 6:9] ** 2).sum(axis=-1))
        return away_km <= self.position_km, attitude_angle_deg(error) <= self.attitude_deg


def attitude_angle_deg(error: Array) -> Array:
    """Rotation angle of attitude errors given as GRP vectors.

    Parameters
    ----------
    error : ndarray, shape (..., >= 3)
        Attitude errors in the first three components, with a = 0.5 and f = 3.

    Returns
    -------
    ndarray, shape (...)
        Degrees in [0, 180].
    """
    a, f = GRP_A, GRP_F
    squared = np.sum(error[..., :3] ** 2, axis=-1)
    scalar = (-a * squared + f * np.sqrt(f * f + (1.0 - a * a) * squared)) / (f * f + squared)
    # |rho| = (a + q4) |p| / f; the arctangent keeps its precision at small angles.
    return np.rad2deg(2.0 * np.arctan2((a + scalar) / f * np.sqrt(squared), scalar))


def rotation_vectors_deg(error: Array) -> Array:
    """Rotation vectors of attitude errors given as GRP vectors.

    Parameters
    ----------
    error : ndarray, shape (..., 3)
        Attitude errors, with a = 0.5 and f = 3.

    Returns
    -------
    ndarray, shape (..., 3)
        Degrees.
    """
    length = np.linalg.norm(error, axis=-1)
    angle = attitude_angle_deg(error) / np.where(length > 0.0, length, 1.0)
    return error * angle[..., None]
