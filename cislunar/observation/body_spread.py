"""What is not known of a body: standard deviations of its departures from what is believed.

Nothing here needs the compiled library, so that settings are checked at once.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

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


@dataclass(frozen=True)
class BodySpread:
    """Standard deviations of how a body departs from what is believed of it; 0 for what is known.

    As the prior of an estimator they say what is estimated, as a truth how targets are drawn. All
    are independent and normal; `cislunar.photometry.departures` says what they are of.

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

    def __post_init__(self) -> None:
        for key, value in vars(self).items():
            if not (value >= 0.0 and np.isfinite(value)):
                raise ConfigurationError(f"{key} = {value} must be finite and not negative")

    def __bool__(self) -> bool:
        """Whether anything is not known."""
        return any(value > 0.0 for value in vars(self).values())

    def surface_kinds(self, n_facets: int) -> tuple[NDArray[np.int64], Array]:
        """Departures of a surface that are not known, shape (n,), and their deviations."""
        groups = [
            (np.arange(first, first + count), getattr(self, key))
            for key, (first, count) in surface_groups(n_facets).items()
            if getattr(self, key) > 0.0
        ]
        kinds = [numbers for numbers, _ in groups]
        sigma = [np.full(numbers.size, each) for numbers, each in groups]
        return np.concatenate([np.empty(0, np.int64), *kinds]), np.concatenate(
            [np.empty(0), *sigma]
        )

    def require_possible(self, material: ArrayLike) -> None:
        """Refuse to leave open what a surface does not have.

        Parameters
        ----------
        material : array_like, shape (5,)
            As of `cislunar.photometry.materials.Material.as_array`.

        Raises
        ------
        ConfigurationError
            If what is to vary has no part in the light, or is a share of nothing.
        """
        diffuse, specular, albedo, _, reflectance = np.asarray(material).tolist()
        shines = specular > 0.0 and reflectance > 0.0
        wanting = {
            "log_albedo": ("diffuse_weight and diffuse_albedo", diffuse > 0.0 and albedo > 0.0),
            "log_slope": ("specular_weight and normal_reflectance", shines),
            "logit_reflectance": ("specular_weight and normal_reflectance", shines),
            "logit_specular_share": ("diffuse_weight and specular_weight", diffuse * specular > 0),
        }
        for key, (needed, there) in wanting.items():
            if getattr(self, key) > 0.0 and not there:
                raise ConfigurationError(
                    f"{key} = {getattr(self, key)}: the light of such a surface does not depend on "
                    f"it; raise {needed}, or leave it at 0"
                )


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
