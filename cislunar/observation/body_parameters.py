"""Prior standard deviations of the body-parameter deviations. No function here needs compiled
kernels."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.attitude.inertia import INERTIA, TORQUE
from cislunar.errors import ConfigurationError
from cislunar.photometry.materials import (
    ALBEDO,
    AXIS_SCALE,
    FACET,
    LOMMEL_SEELIGER_SHARE,
    PHASE_CURVATURE,
    PHASE_SLOPE,
    PHONG_SHARE,
    REFLECTANCE,
    SCALE,
    SHARE,
    SLOPE,
    TABULATED,
)
from cislunar.runtime import Array
from cislunar.runtime.settings_fields import NotNegative, Section, setting

HOUR = 3600.0

REFLECTION_LAW = ("phong_share", "lommel_seeliger_share", "phase_slope", "phase_curvature")
"""Deviations from the Cook-Torrance law that an estimator may have; a true body has one law."""


# fmt: off


class BodyParameterPrior(Section):
    """Prior standard deviations of the body-parameter deviations; 0 for known parameters.

    As the prior of an estimator they state which parameters are estimated, as a truth how targets
    are sampled. All deviations are independent and normal;
    `cislunar.photometry.parameter_deviations` and `cislunar.attitude.parameter_deviations` define
    them.
    """

    log_albedo: NotNegative = setting(
        "prior standard deviation of the logarithm of the diffuse albedo; 0.25 is about 25 %",
        "1", default=0)
    log_slope: NotNegative = setting(
        "prior standard deviation of the logarithm of the microfacets' root-mean-square slope",
        "1", default=0)
    logit_reflectance: NotNegative = setting(
        "prior standard deviation of the logarithm of the odds F_0 / (1 - F_0)", "1", default=0)
    logit_specular_share: NotNegative = setting(
        "prior standard deviation of the logarithm of the odds s / d at constant s + d", "1",
        default=0)
    log_scale: NotNegative = setting(
        "prior standard deviation of the logarithm of all reflected light; 1 is 1.09 mag", "1",
        default=0)
    log_axis_scale: NotNegative = setting(
        "prior standard deviation of the logarithm of the scale of each body axis", "1", default=0)
    log_facets: NotNegative = setting(
        "prior standard deviation of the logarithm of the reflectivity of each facet", "1",
        default=0)
    log_inertia: NotNegative = setting(
        "prior standard deviation of the logarithms of the moments of inertia about the second and "
        "third body axis relative to the first", "1", default=0)
    angular_acceleration_deg_h2: NotNegative = setting(
        "prior standard deviation of the angular acceleration by a torque that is constant in the "
        "body frame, along each body axis", "deg/h^2", default=0)
    phong_share: NotNegative = setting(
        "prior standard deviation of the share of a Lambert-Phong lobe in the specular light; for "
        "estimators only, like the next three keys", "1", default=0)
    lommel_seeliger_share: NotNegative = setting(
        "prior standard deviation of the share of Lommel-Seeliger reflection in the diffuse light",
        "1", default=0)
    phase_slope: NotNegative = setting(
        "prior standard deviation of the coefficient of a magnitude that is linear in the phase "
        "angle", "mag/rad", default=0)
    phase_curvature: NotNegative = setting(
        "prior standard deviation of the coefficient of a magnitude that is quadratic in the phase "
        "angle", "mag/rad^2", default=0)

    # fmt: on

    omitted = REFLECTION_LAW

    def __bool__(self) -> bool:
        """Whether any parameter is uncertain."""
        return any(value > 0.0 for value in vars(self).values())

    def rotation_kinds(self) -> tuple[NDArray[np.int64], Array]:
        """Kinds of the uncertain deviations of the rotation, shape (n,), and their sigmas; those of
        the angular acceleration are in rad/s^2."""
        groups = (
            (np.arange(INERTIA, TORQUE), self.log_inertia),
            (np.arange(TORQUE, TORQUE + 3), np.deg2rad(self.angular_acceleration_deg_h2) / HOUR**2),
        )
        return _unknown(groups)

    def surface_kinds(self, n_facets: int) -> tuple[NDArray[np.int64], Array]:
        """Kinds of the uncertain deviations of a surface, shape (n,), and their sigmas."""
        groups = surface_groups(n_facets).items()
        return _unknown(
            (np.arange(first, first + count), getattr(self, key)) for key, (first, count) in groups
        )

    def named(self, n_facets: int) -> dict[str, float]:
        """Sigmas of the uncertain deviations of a body with `n_facets` by name, rotation first."""
        parts: dict[str, Iterable] = {
            "log_inertia": "yz",
            "angular_acceleration_deg_h2": "xyz",
            **{
                key: range(count) if count > 1 else ()
                for key, (_, count) in surface_groups(n_facets).items()
            },
            "log_axis_scale": "xyz",
        }
        return {
            name: getattr(self, key)
            for key, own in parts.items()
            if getattr(self, key) > 0.0
            for name in ([f"{key}_{part}" for part in own] or [key])
        }

    def require_possible(self, material: ArrayLike, law: int = 0) -> None:
        """Refuse uncertain parameters on which the light of a surface does not depend. `material`,
        (5,) or (material, 5), is as by `cislunar.photometry.materials.Material.as_array`; one
        material that depends on a parameter suffices. `law` is the number of the reflection law."""
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
            "phong_share": ("specular_weight and normal_reflectance", shines),
            "lommel_seeliger_share": (
                "diffuse_weight and diffuse_albedo",
                np.any(diffuse * albedo > 0.0),
            ),
        }
        for key, (needed, there) in wanting.items():
            if getattr(self, key) > 0.0 and law == TABULATED:
                raise ConfigurationError(
                    f"{key} = {getattr(self, key)}: the light of a tabulated reflection law does "
                    "not depend on it; leave it at 0, or give log_scale"
                )
            if getattr(self, key) > 0.0 and not there:
                raise ConfigurationError(
                    f"{key} = {getattr(self, key)}: the light of such a surface does not depend on "
                    f"it; raise {needed}, or leave it at 0"
                )


def _unknown(groups: Iterable[tuple[NDArray, float]]) -> tuple[NDArray[np.int64], Array]:
    """Kinds with a sigma above zero, and the sigma of each."""
    found = [(numbers, sigma) for numbers, sigma in groups if sigma > 0.0]
    kinds = [np.empty(0, np.int64), *(numbers for numbers, _ in found)]
    sigma = [np.empty(0), *(np.full(numbers.size, each) for numbers, each in found)]
    return np.concatenate(kinds), np.concatenate(sigma)


def require_freedom(prior: BodyParameterPrior, freedom: float | None) -> None:
    """Refuse degrees of freedom of Student's t distribution without a variance, or without
    deviations that follow it.

    Raises
    ------
    ConfigurationError
        If `freedom` is not above 2, or every standard deviation is 0.
    """
    if freedom is None:
        return
    if not freedom > 2.0:
        raise ConfigurationError(
            f"parameter_freedom = {freedom} must be above 2: Student's t distribution has no "
            "standard deviation below"
        )
    if not prior:
        raise ConfigurationError(
            f"parameter_freedom = {freedom}: every standard deviation of parameter_sigma is 0; "
            "give one above 0, or omit parameter_freedom"
        )


def surface_groups(n_facets: int) -> dict[str, tuple[int, int]]:
    """First kind and number of the deviations, by the name of their sigma."""
    return {
        "log_albedo": (ALBEDO, 1),
        "log_slope": (SLOPE, 1),
        "logit_reflectance": (REFLECTANCE, 1),
        "logit_specular_share": (SHARE, 1),
        "log_scale": (SCALE, 1),
        "log_axis_scale": (AXIS_SCALE, 3),
        "log_facets": (FACET, n_facets),
        "phong_share": (PHONG_SHARE, 1),
        "lommel_seeliger_share": (LOMMEL_SEELIGER_SHARE, 1),
        "phase_slope": (PHASE_SLOPE, 1),
        "phase_curvature": (PHASE_CURVATURE, 1),
    }
