"""Surface parameters and readings of the Cook-Torrance facet model (Paul & Fan, section 2.2).

The paper gives no values for the surface. The defaults here are this library's choice.
"""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from cislunar.errors import ConfigurationError, InputFileError

IRRADIANCE_LAWS = ("4pi", "1/r^2")
FRESNEL_FORMS = ("sqrt", "printed")
REFLECTION_LAWS = ("cook-torrance", "lambert-phong")

# Kinds of departure, see `cislunar.photometry.departures`; one for each axis, one for each facet.
ALBEDO, SLOPE, REFLECTANCE, SHARE, SCALE, STRETCH, FACET = 0, 1, 2, 3, 4, 5, 8
NOTHING = -1
"""A kind that changes nothing, to fill up a table."""


@dataclass(frozen=True)
class Material:
    """Surface of an object or of a group of its facets.

    Parameters
    ----------
    diffuse_weight : float
        d, weight of the Lambertian share, >= 0.
    specular_weight : float
        s, weight of the specular share, >= 0. The paper's specular term, like that of Cook &
        Torrance (1982), reflects four times the light of a microfacet BRDF normalized to its
        Fresnel reflectance: the defaults return up to 1.25 of the incident light, and s = 0.125
        makes them conserve energy.
    diffuse_albedo : float
        rho, in [0, 1].
    rms_slope : float
        delta_RMS, root mean square slope of the microfacets, > 0.
    normal_reflectance : float
        F0, reflectance under normal illumination, in [0, 1).

    Raises
    ------
    ConfigurationError
        If a parameter lies outside its range; the message names it.
    """

    diffuse_weight: float = 0.5
    specular_weight: float = 0.5
    diffuse_albedo: float = 0.5
    rms_slope: float = 0.3
    normal_reflectance: float = 0.5

    def __post_init__(self) -> None:
        ranges = {
            "diffuse_weight": (self.diffuse_weight >= 0.0, "at least 0"),
            "specular_weight": (self.specular_weight >= 0.0, "at least 0"),
            "diffuse_albedo": (0.0 <= self.diffuse_albedo <= 1.0, "in [0, 1]"),
            "rms_slope": (self.rms_slope > 0.0, "above 0 (use specular_weight 0 for no glint)"),
            "normal_reflectance": (0.0 <= self.normal_reflectance < 1.0, "in [0, 1)"),
        }
        for name, (valid, wanted) in ranges.items():
            value = getattr(self, name)
            if not (valid and np.isfinite(value)):
                raise ConfigurationError(f"material {name} = {value} must be finite and {wanted}")

    def as_array(self) -> NDArray[np.float64]:
        """Parameters in the order of the kernels, ``[d, s, rho, delta_rms, F0]``."""
        return np.array(astuple(self), dtype=float)


PANEL = Material(0.3, 0.1, 0.1, 0.1, 0.2)
FOIL = Material(0.4, 0.1, 0.5, 0.35, 0.8)
PAINT = Material(0.95, 0.01, 0.7, 0.4, 0.05)
"""Solar cells, crinkled metal foil and white paint: chosen to be told apart, not measured. Their
specular weights conserve energy."""


SURFACES = {"panel": PANEL, "foil": FOIL, "paint": PAINT}
"""Their names in settings and tables."""

USUAL = "material"
"""Name of the material that a body has where nothing else is said."""


def group_materials(source: str, text: str, usual: Material) -> dict[str, Material]:
    """Materials of facet groups, as settings and tables state them.

    Parameters
    ----------
    source : str
        Where it stands, for messages.
    text : str
        ``group=material; group=material``; a material is one of `SURFACES`, ``material`` for the
        usual one, or the five numbers of `Material` in their order. A group may be empty.
    usual : Material
        The one named ``material``.

    Returns
    -------
    dict of str to Material

    Raises
    ------
    InputFileError
        If the text cannot be read, names a group twice, or a material is unknown or impossible.
    """
    found: dict[str, Material] = {}
    for part in text.split(";"):
        group, equals, name = (each.strip() for each in part.partition("="))
        if not equals:
            raise InputFileError(f"{source}: materials {part.strip()!r} is not group=material")
        if group in found:
            raise InputFileError(f"{source}: materials name the group {group!r} twice")
        known = {**SURFACES, USUAL: usual}
        try:
            found[group] = known[name] if name in known else _of_numbers(name)
        except ConfigurationError as error:
            raise InputFileError(f"{source}: {error}") from None
        except ValueError:
            raise InputFileError(
                f"{source}: material {name!r} of group {group!r} is none of {', '.join(known)}, "
                "nor five numbers d s rho delta_RMS F_0"
            ) from None
    return found


def _of_numbers(text: str) -> Material:
    d, s, rho, slope, reflectance = map(float, text.split())
    return Material(d, s, rho, slope, reflectance)


def material_rows(
    source: str, groups: Sequence[str], materials: Mapping[str, Material]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Material table of a body, and the row of each of its facets.

    Parameters
    ----------
    source : str
        The body, for messages.
    groups : sequence of str, length F
        Group of each facet.
    materials : mapping of str to Material
        Material of each group.

    Returns
    -------
    rows : ndarray of int, shape (F,)
        Row of each facet.
    table : ndarray, shape (M, 5)
        Row by row as `Material.as_array`; equal materials share a row.

    Raises
    ------
    ConfigurationError
        If a facet's group has no material, or a material is given for a group that no facet
        belongs to.
    """
    for facet, group in enumerate(groups, 1):
        if group not in materials:
            where = f"of group {group!r}" if group else "of no group"
            raise ConfigurationError(
                f"{source}: facet {facet}, {where}, has no material; there are materials for "
                f"{', '.join(materials) or 'no group'}"
            )
    unknown = [group for group in materials if group not in groups]
    if unknown:
        raise ConfigurationError(
            f"{source}: no facet belongs to group {unknown[0]!r}, which is given a material; its "
            f"groups are {', '.join(dict.fromkeys(groups))}"
        )
    distinct = list(dict.fromkeys(materials.values()))
    rows = np.array([distinct.index(materials[group]) for group in groups], dtype=np.int64)
    return rows, np.array([material.as_array() for material in distinct])


@dataclass(frozen=True)
class PhotometryModel:
    """How two ambiguous equations of the paper are read, and the law of reflection itself.

    Parameters
    ----------
    irradiance : {"1/r^2", "4pi"}
        Spreading of the reflected flux: 1/r^2, which agrees with the paper's own sphere model and
        with the BRDF's definition, or 1/(4 pi r^2) as printed, 2.748 mag fainter.
    fresnel : {"sqrt", "printed"}
        p = sqrt(q^2 - 1 + b^2), as in Cook & Torrance (1982), or without the root as printed.
    reflection : {"cook-torrance", "lambert-phong"}
        The paper's law, or another one (`cislunar.photometry.body_blocks`), to see what a wrong one
        does.

    Raises
    ------
    ConfigurationError
        If a value is none of those.
    """

    irradiance: str = "1/r^2"
    fresnel: str = "sqrt"
    reflection: str = "cook-torrance"

    def __post_init__(self) -> None:
        choices = {
            "irradiance": IRRADIANCE_LAWS,
            "fresnel": FRESNEL_FORMS,
            "reflection": REFLECTION_LAWS,
        }
        for name, allowed in choices.items():
            value = getattr(self, name)
            if value not in allowed:
                raise ConfigurationError(
                    f"photometry {name} = {value!r} must be one of {', '.join(allowed)}"
                )

    @property
    def irradiance_4pi(self) -> bool:
        """Flag of the kernels: True for the 1/(4 pi r^2) law."""
        return self.irradiance == "4pi"

    @property
    def fresnel_sqrt(self) -> bool:
        """Flag of the kernels: True for the square root."""
        return self.fresnel == "sqrt"

    @property
    def phong(self) -> bool:
        """Flag of the kernels: True for Lambert's and Phong's law."""
        return self.reflection == "lambert-phong"


PRINTED = PhotometryModel(irradiance="4pi")
"""The law of irradiance that the paper prints, and its own scenarios keep."""
