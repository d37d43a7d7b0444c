"""Meshes of three kinds of object found in cislunar space, and of simple convex solids.

They are built from a few dimensions. The defaults of the spacecraft are those of existing objects.
The docstrings name the sources and the assumptions. All axes are body axes, lengths in meters.
`SURFACES` has a material for each facet group; the solids have one group and no material of their
own.
"""

from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from cislunar.errors import ConfigurationError
from cislunar.photometry.materials import FOIL, PAINT, PANEL, Material
from cislunar.photometry.meshes import Mesh, closed_mesh
from cislunar.runtime import array_of, count_of, number_of

SURFACES: dict[str, dict[str, Material]] = {
    "box_with_wings": {"bus": FOIL, "cells": PANEL, "wing": PAINT},
    "dish_on_bus": {"bus": FOIL, "dish": PAINT},
    "upper_stage": {"tank": PAINT, "nozzle": FOIL},
}
"""Materials of the facet groups of each model; chosen, not measured."""


def box_with_wings(
    size: ArrayLike = (2.7, 1.2, 1.1),
    wing: ArrayLike = (5.0, 1.0),
    span: float = 14.67,
    *,
    wing_turn: float = 0.0,
    thickness: float = 0.03,
    divisions: int = 2,
) -> Mesh:
    """A box with two solar wings along +-y, which rotate about that axis.

    The defaults are a Galileo FOC satellite: body 2.7 m x 1.2 m x 1.1 m and span 14.67 m
    (spaceflights.news, "Two Galileo satellites tested and ready"), wings of 1 m x 5 m (European
    Commission, "Galileo spreads its wings", newsroom item 46817). The yokes are omitted. The
    assignment of the body's sides to the axes and the thickness of a wing are assumed.

    Parameters
    ----------
    size : array_like, shape (3,)
        Box along x, y, z, m.
    wing : array_like, shape (2,)
        Wing along and across y, m.
    span : float
        Distance between the wing tips, m.
    wing_turn : float
        Angle of the cells' normal from +x towards -z, rad.
    thickness : float
        Thickness of a wing, m.
    divisions : int
        Pieces of a wing along y.

    Returns
    -------
    Mesh
        Groups ``bus``, ``cells`` (the sunny side of the wings) and ``wing``.

    Raises
    ------
    ConfigurationError
        If a length is not positive, the number of pieces or the angle is impossible, or the wings
        intersect the box.
    """
    depth, breadth, height = array_of("size", size, (3,)).tolist()
    length, width = array_of("wing", wing, (2,)).tolist()
    span, thickness = number_of("span", span), number_of("thickness", thickness)
    count_of("divisions", divisions)
    number_of("wing_turn", wing_turn)
    _check_positive("box_with_wings", [depth, breadth, height, length, width, span, thickness])
    middle = 0.5 * (span - length)
    if middle - 0.5 * length <= 0.5 * breadth:
        raise ConfigurationError(
            f"box_with_wings: wings of {length} m within a span of {span} m intersect a box "
            f"{breadth} m wide"
        )
    c, s = np.cos(wing_turn), np.sin(wing_turn)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    box, triangles = _box((depth, breadth, height), 1)
    parts = [(box, triangles, ("bus",) * len(triangles))]
    panel, triangles = _box((thickness, length, width), divisions)
    corners = panel[triangles]
    sunny = np.all(corners[..., 0] > 0.0, axis=1)
    groups = tuple(np.where(sunny, "cells", "wing").tolist())
    for side in (-middle, middle):
        parts.append((panel @ turn.T + [0.0, side, 0.0], triangles, groups))
    return _joined("box_with_wings", parts)


def dish_on_bus(
    size: ArrayLike = (1.4, 1.4, 0.85),
    diameter: float = 4.2,
    *,
    focal_ratio: float = 0.35,
    gap: float = 0.2,
    thickness: float = 0.05,
    segments: int = 12,
    rings: int = 2,
) -> Mesh:
    """A parabolic dish that opens along +z, above a box (groups ``dish`` and ``bus``); lengths in
    m.

    The defaults are the relay satellite Queqiao: dish of 4.2 m diameter ("Development and Prospect
    of Chinese Lunar Relay Communication Satellite", Space: Science & Technology 2021, 3471608,
    table 1), body 1.4 m x 1.4 m x 0.85 m (Wikipedia, "Queqiao relay satellite"). Its wings and feed
    are omitted; focal ratio, gap between box and dish, and thickness are assumed. `segments` and
    `rings` are the pieces of the dish in azimuth and in radius."""
    _check_positive(
        "dish_on_bus", [*size, diameter, focal_ratio, gap, thickness, segments - 2, rings]
    )
    box, triangles = _box(size, 1)
    parts = [(box, triangles, ("bus",) * len(triangles))]
    r = np.linspace(0.0, 0.5 * diameter, rings + 1)
    bowl = np.stack([r, r**2 / (4.0 * focal_ratio * diameter)], axis=1)
    bowl[:, 1] += 0.5 * np.asarray(size)[2] + gap
    profile = np.concatenate([bowl + np.array([0.0, thickness]), bowl[::-1]])
    parts.append(_revolved(profile, ["dish"] * (len(profile) - 1), segments))
    return _joined("dish_on_bus", parts)


def upper_stage(
    length: float = 12.68,
    diameter: float = 3.05,
    nozzle_diameter: float = 1.17,
    *,
    nozzle_length: float = 1.5,
    dome: float = 1.0,
    segments: int = 12,
) -> Mesh:
    """A spent upper stage about z: domed cylinder with one nozzle, open towards -z (groups ``tank``
    and ``nozzle``); lengths in m.

    The defaults are the Centaur of an Atlas V with one engine, 12.68 m long including the nozzle
    and 3.05 m across (Wikipedia, "Centaur (rocket stage)"). The dimensions of the nozzle (diameter
    at the exit, length from the throat) and the height of the domes at both ends are assumed; the
    payload adapter is omitted. `segments` are the pieces in azimuth."""
    _check_positive("upper_stage", [diameter, nozzle_diameter, nozzle_length, dome, segments - 2])
    cylinder = length - nozzle_length - 2.0 * dome
    if not cylinder > 0.0:
        raise ConfigurationError(
            f"upper_stage: domes and nozzle are longer than the stage of {length} m"
        )
    tank, exit_, throat = 0.5 * diameter, 0.5 * nozzle_diameter, 0.15 * nozzle_diameter
    top = 0.5 * length
    shoulder, aft = top - dome, top - dome - cylinder
    bottom = -top
    profile = [
        (0.0, top),
        (tank * np.sqrt(0.5), shoulder + dome * np.sqrt(0.5)),
        (tank, shoulder),
        (tank, aft),
        (throat, aft - dome),
        (exit_, bottom),
        (0.95 * exit_, bottom),
        (0.8 * throat, aft - dome),
        (0.0, aft - dome),
    ]
    groups = ["tank"] * 4 + ["nozzle"] * 4
    return _joined("upper_stage", [_revolved(profile, groups, segments)])


def box(size: ArrayLike = (1.0, 1.0, 1.0)) -> Mesh:
    """A box with edges `size` along the body axes, m; a cube by default."""
    size = array_of("size", size, (3,))
    _check_positive("box", size)
    vertices, triangles = _box(size, 1)
    return closed_mesh("box", vertices, triangles, ("",) * len(triangles))


def prism(sides: int = 6, diameter: float = 1.0, height: float = 1.0) -> Mesh:
    """A right prism about z with a regular base of circumscribed circle `diameter`, m.

    The default is a hexagonal prism as high as it is wide; many sides approximate a cylinder."""
    _check_positive("prism", [count_of("sides", sides, 3), diameter, height])
    rim, top = 0.5 * diameter, 0.5 * height
    profile = [(0.0, top), (rim, top), (rim, -top), (0.0, -top)]
    return _joined("prism", [_revolved(profile, ("",) * 3, sides)])


def _check_positive(name, values):
    """Refuse a model with a dimension or a number of pieces that is not positive."""
    if not np.all(np.isfinite(values) & (np.asarray(values) > 0.0)):
        raise ConfigurationError(
            f"{name}: dimensions and numbers of pieces must be positive (3 segments at least)"
        )


def _box(size, pieces):
    """Vertices and outward triangles of a box about the origin, divided into pieces along y."""
    x, y, z = 0.5 * np.asarray(size, dtype=float)
    cuts = np.linspace(-y, y, pieces + 1)
    ring = [(-x, -z), (x, -z), (x, z), (-x, z)]
    vertices = np.array([(a, cut, b) for cut in cuts for a, b in ring])
    triangles = []
    for piece in range(pieces):
        for k in range(4):
            a, b = 4 * piece + k, 4 * piece + (k + 1) % 4
            triangles += [(a, a + 4, b), (b, a + 4, b + 4)]
    last = 4 * pieces
    triangles += [(0, 1, 2), (0, 2, 3), (last, last + 2, last + 1), (last, last + 3, last + 2)]
    return vertices, np.array(triangles)


def _revolved(profile, groups, segments):
    """Vertices, triangles and groups of a revolved profile (r, z) that starts and ends on the axis.
    The solid is to the right of the profile in its direction; `groups` has one entry per step of
    it."""
    angles = 2.0 * np.pi * np.arange(segments) / segments
    rings, vertices = [], []
    for r, z in profile:
        around = angles if r > 0.0 else angles[:1]
        rings.append(len(vertices) + np.arange(segments) % len(around))
        vertices += [(r * np.cos(a), r * np.sin(a), z) for a in around]
    triangles, kinds = [], []
    for (here, there), group in zip(pairwise(rings), groups, strict=True):
        for k in range(segments):
            m = (k + 1) % segments
            quad = [(here[k], there[k], there[m]), (here[k], there[m], here[m])]
            kept = [each for each in quad if len(set(each)) == 3]
            triangles += kept
            kinds += [group] * len(kept)
    return np.array(vertices), np.array(triangles), tuple(kinds)


def _joined(name, parts):
    """One checked mesh of several parts, each given by vertices, triangles and groups."""
    counts = np.cumsum([0, *(len(vertices) for vertices, _, _ in parts)])
    return closed_mesh(
        name,
        np.concatenate([vertices for vertices, _, _ in parts]),
        np.concatenate([each + n for (_, each, _), n in zip(parts, counts, strict=False)]),
        sum((groups for _, _, groups in parts), ()),
    )


MODELS = {
    "box-with-wings": (box_with_wings, SURFACES["box_with_wings"]),
    "dish-on-bus": (dish_on_bus, SURFACES["dish_on_bus"]),
    "upper-stage": (upper_stage, SURFACES["upper_stage"]),
    "cube": (box, None),
    "box": (partial(box, (1.0, 1.3, 1.6)), None),
    "hexagonal-prism": (prism, None),
    "cylinder": (partial(prism, 32), None),
}
"""Function and surface of each model, by its name in settings and tables; a surface None stands for
the material of the settings."""
