"""Surface parameters and readings of the Cook-Torrance facet model (Paul & Fan, section 2.2).

The paper gives no values for the surface; the defaults are a choice of this library.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cislunar.errors import ConfigurationError, InputFileError
from cislunar.runtime.settings_fields import NotNegative, Positive, Section, number, setting
from cislunar.runtime.settings_words import pattern

IRRADIANCE_LAWS = ("4pi", "1/r^2")
REFLECTION_LAWS = (
    "cook-torrance",
    "lambert-phong",
    "lommel-seeliger-phong",
    "lommel-seeliger-ggx",
)
TABULATED = len(REFLECTION_LAWS)
"""Number of a tabulated law in the kernels; that of another law is its place in `REFLECTION_LAWS`.
"""

REFLECTION = pattern(
    f"^({'|'.join(REFLECTION_LAWS)})$|[.]([cC][sS][vV]|[nN][cC])$",
    f"one of {', '.join(REFLECTION_LAWS)}, or a table ending in .csv or .nc")  # fmt: skip
Reflection = Annotated[str, Field(pattern=REFLECTION)]
"""Name of a reflection law, or the file of a table of its values."""

# Kinds of body-parameter deviation, see `cislunar.photometry.parameter_deviations`; AXIS_SCALE has
# one for each axis, FACET one for each facet. Those from PHONG_SHARE to PHASE_CURVATURE change the
# reflection law, see `cislunar.photometry.law_mixture`.
ALBEDO, SLOPE, REFLECTANCE, SHARE, SCALE = 0, 1, 2, 3, 4
PHONG_SHARE, LOMMEL_SEELIGER_SHARE, PHASE_SLOPE, PHASE_CURVATURE = 5, 6, 7, 8
AXIS_SCALE, FACET = 9, 12
NOTHING = -1
"""A kind without effect, which fills up tables."""


class Material(Section):
    """Surface of an object or of a group of its facets.

    The paper's specular term, like that of Cook & Torrance (1982), reflects four times the light of
    a microfacet BRDF normalized to its Fresnel reflectance: the defaults return up to 1.25 of the
    incident light, and `specular_weight` = 0.125 makes them conserve energy."""

    # fmt: off

    diffuse_weight: NotNegative = setting(
        "d, weight of the diffuse (Lambertian) share", "1", "not given", default=0.5)
    specular_weight: NotNegative = setting(
        "s, weight of the specular share", "1", "not given", default=0.5)
    diffuse_albedo: number(ge=0, le=1) = setting(
        "rho, diffuse albedo", "1", "not given", default=0.5)
    rms_slope: Positive = setting(
        "delta_RMS, root-mean-square slope of the microfacets; for no glint set `specular_weight` "
        "to 0", "1", "not given", default=0.3)
    normal_reflectance: number(ge=0, lt=1) = setting(
        "F_0, reflectance at normal incidence", "1", "not given", default=0.5)

    # fmt: on

    def as_array(self) -> NDArray[np.float64]:
        """Parameters in the order of the kernels, ``[d, s, rho, delta_rms, F0]``."""
        return np.array([value for _, value in self], dtype=float)


def material_of(row: Iterable[float]) -> Material:
    """The material of the parameters of `Material.as_array`, which are not checked: the albedo of a
    drawn material may exceed 1."""
    return Material.model_construct(
        **dict(zip(Material.model_fields, map(float, row), strict=True))
    )


PANEL = Material(0.3, 0.1, 0.1, 0.1, 0.2)
FOIL = Material(0.4, 0.1, 0.5, 0.35, 0.8)
PAINT = Material(0.95, 0.01, 0.7, 0.4, 0.05)
"""Solar cells, crinkled metal foil and white paint. The values are chosen to be distinguishable,
not measured; their specular weights conserve energy."""


SURFACES = {"panel": PANEL, "foil": FOIL, "paint": PAINT}
"""Materials by their names in settings and tables."""

USUAL = "material"
"""Name, in settings and tables, of the material of the body itself."""


def group_materials(source: str, text: str, usual: Material) -> dict[str, Material]:
    """Materials of facet groups from their text in settings and tables.

    Parameters
    ----------
    source : str
        Origin of the text, for messages.
    text : str
        ``group=material; group=material``. A material is one of `SURFACES`, ``material`` for
        `usual`, or the five numbers of `Material` in their order. A group may be empty.
    usual : Material
        The material that ``material`` denotes.

    Returns
    -------
    dict of str to Material
        Material of each group, in the order of the text.

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
            raise InputFileError(f"{source}: material {error}") from None
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
        Name of the body, for messages.
    groups : sequence of str, length F
        Group of each facet.
    materials : mapping of str to Material
        Material of each group.

    Returns
    -------
    rows : ndarray of int, shape (F,)
        Row of each facet.
    table : ndarray, shape (M, 5)
        Distinct materials, each as `Material.as_array`.

    Raises
    ------
    ConfigurationError
        If a facet's group has no material, or a material is given for a group without facets.
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


class PhotometryReading(Section):
    """Reading of two ambiguous equations of the paper.

    The irradiance 1/r^2, which None denotes, agrees with the paper's own sphere model and with the
    definition of the BRDF."""

    # fmt: off

    irradiance: Literal[IRRADIANCE_LAWS] | None = setting(
        "spreading of the light of a facet: `4pi`, 1/(4 pi r^2) as printed in the paper, or the "
        "physical `1/r^2`, 2.75 mag brighter. null: as `scenarios.NAME.photometry` states",
        paper="4pi", default=None)
    fresnel: Literal["sqrt", "printed"] = setting(
        "Fresnel term: `sqrt` as in Cook & Torrance, or `printed` as in the paper, without the "
        "root", paper="printed", default="sqrt")

    # fmt: on


class PhotometryModel(PhotometryReading):
    """Law of irradiance, Fresnel term and reflection law of targets."""

    reflection: Reflection = setting(
        "law by which targets reflect: the paper's `cook-torrance`; `lambert-phong`, "
        "`lommel-seeliger-phong` or `lommel-seeliger-ggx` to study the effect of a wrong law; or a "
        "table of a law (`.csv`, `.nc`; docs/bodies.md)",
        paper=REFLECTION_LAWS[0],
        default=REFLECTION_LAWS[0],
    )

    @property
    def irradiance_4pi(self) -> bool:
        """Whether the kernels use the 1/(4 pi r^2) law."""
        return self.irradiance == "4pi"

    @property
    def fresnel_sqrt(self) -> bool:
        """Whether the kernels take the square root."""
        return self.fresnel == "sqrt"

    @property
    def law(self) -> int:
        """Number of the reflection law in the kernels."""
        known = self.reflection in REFLECTION_LAWS
        return REFLECTION_LAWS.index(self.reflection) if known else TABULATED


PRINTED = PhotometryModel(irradiance="4pi")
"""The irradiance law as printed in the paper, which its own scenarios use."""
