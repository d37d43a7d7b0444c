"""What is not known of a body: standard deviations of its departures from what is believed.

Nothing here needs the compiled library, so that settings are checked at once.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude.inertia import INERTIA, TORQUE
from cislunar.errors import ConfigurationError
from cislunar.photometry.materials import (
    ALBEDO,
    FACET,
    REFLECTANCE,
    SCALE,
    SHARE,
    SLOPE,
    STRETCH,
)

Array = NDArray[np.float64]

HOUR = 3600.0


@dataclass(frozen=True)
class BodySpread:
    """Standard deviations of how a body departs from what is believed of it; 0 for what is known.

    As the prior of an estimator they say what is estimated, as a truth how targets are drawn. All
    are independent and normal; `cislunar.photometry.departures` and
    `cislunar.attitude.departures` say what they are of.

    Attributes
    ----------
    log_albedo, log_slope : float
        Of the logarithms of diffuse albedo and root mean square slope: 0.25 is about 25 %.
    logit_reflectance, logit_specular_share : float
        Of the logarithms of the odds F0 / (1 - F0) and s / d.
    log_scale : float
        Of the logarithm of all light thrown back; 1 is 1.09 mag.
    log_stretch : float
        Of the logarithm of the length along each body axis.
    log_facets : float
        Of the logarithm of the light thrown back by each facet.
    log_inertia : float
        Of the logarithms of the moments along the second and third body axis over that along the
        first.
    angular_acceleration_deg_h2 : float
        Of what a torque constant in the body frame gives, along each of its axes.

    Raises
    ------
    ConfigurationError
        If one is negative or not finite.
    """

    log_albedo: float = 0.0
    log_slope: float = 0.0
    logit_reflectance: float = 0.0
    logit_specular_share: float = 0.0
    log_scale: float = 0.0
    log_stretch: float = 0.0
    log_facets: float = 0.0
    log_inertia: float = 0.0
    angular_acceleration_deg_h2: float = 0.0

    def __post_init__(self) -> None:
        for key, value in vars(self).items():
            if not (value >= 0.0 and np.isfinite(value)):
                raise ConfigurationError(f"{key} = {value} must be finite and not negative")

    def __bool__(self) -> bool:
        """Whether anything is not known."""
        return any(value > 0.0 for value in vars(self).values())

    def rotation_kinds(self) -> tuple[NDArray[np.int64], Array]:
        """Departures of the rotation that are not known, shape (n,), and their deviations.

        Those of the angular acceleration in rad/s^2.
        """
        groups = (
            (np.arange(INERTIA, TORQUE), self.log_inertia),
            (np.arange(TORQUE, TORQUE + 3), np.deg2rad(self.angular_acceleration_deg_h2) / HOUR**2),
        )
        return _unknown(groups)

    def surface_kinds(self, n_facets: int) -> tuple[NDArray[np.int64], Array]:
        """Departures of a surface that are not known, shape (n,), and their deviations."""
        groups = surface_groups(n_facets).items()
        return _unknown(
            (np.arange(first, first + count), getattr(self, key)) for key, (first, count) in groups
        )

    def named(self, n_facets: int) -> dict[str, float]:
        """What is not known of a body of so many facets: deviations by name, rotation first."""
        parts: dict[str, Iterable] = {
            "log_inertia": "yz",
            "angular_acceleration_deg_h2": "xyz",
            **{
                key: range(count) if count > 1 else ()
                for key, (_, count) in surface_groups(n_facets).items()
            },
            "log_stretch": "xyz",
        }
        return {
            name: getattr(self, key)
            for key, own in parts.items()
            if getattr(self, key) > 0.0
            for name in ([f"{key}_{part}" for part in own] or [key])
        }

    def require_possible(self, material: ArrayLike) -> None:
        """Refuse to leave open what a surface does not have.

        Parameters
        ----------
        material : array_like, shape (5,) or (material, 5)
            As of `cislunar.photometry.materials.Material.as_array`; one of several will do.

        Raises
        ------
        ConfigurationError
            If what is to vary has no part in the light, or is a share of nothing.
        """
        diffuse, specular, albedo, _, reflectance = np.atleast_2d(material).T
        shines = np.any(specular * reflectance > 0.0)
        wanting = {
            "log_albedo": ("diffuse_weight and diffuse_albedo", np.any(diffuse * albedo > 0.0)),
            "log_slope": ("specular_weight and normal_reflectance", shines),
            "logit_reflectance": ("specular_weight and normal_reflectance", shines),
            "logit_specular_share": (
                "diffuse_weight and specular_weight",
                np.any(diffuse * specular > 0.0),
            ),
        }
        for key, (needed, there) in wanting.items():
            if getattr(self, key) > 0.0 and not there:
                raise ConfigurationError(
                    f"{key} = {getattr(self, key)}: the light of such a surface does not depend on "
                    f"it; raise {needed}, or leave it at 0"
                )


def _unknown(groups: Iterable[tuple[NDArray, float]]) -> tuple[NDArray[np.int64], Array]:
    """Kinds with a deviation above zero, and that of each."""
    found = [(numbers, sigma) for numbers, sigma in groups if sigma > 0.0]
    kinds = [np.empty(0, np.int64), *(numbers for numbers, _ in found)]
    sigma = [np.empty(0), *(np.full(numbers.size, each) for numbers, each in found)]
    return np.concatenate(kinds), np.concatenate(sigma)


def surface_groups(n_facets: int) -> dict[str, tuple[int, int]]:
    """First kind of departure and their number, by the deviation that says how far."""
    return {
        "log_albedo": (ALBEDO, 1),
        "log_slope": (SLOPE, 1),
        "logit_reflectance": (REFLECTANCE, 1),
        "logit_specular_share": (SHARE, 1),
        "log_scale": (SCALE, 1),
        "log_stretch": (STRETCH, 3),
        "log_facets": (FACET, n_facets),
    }
