"""Bodies of boxes and models of spacecraft, and the reflection parameters of bodies."""

import numpy as np

from cislunar.photometry import spacecraft
from cislunar.photometry.materials import PHASE_CURVATURE, PHONG_SHARE, Material
from cislunar.photometry.meshes import closed_mesh

MATTE = Material(diffuse_weight=1.0, specular_weight=0.0, diffuse_albedo=1.0)
MODELS = {
    "box_with_wings": spacecraft.box_with_wings(wing_turn=0.4),
    "dish_on_bus": spacecraft.dish_on_bus(segments=8),
    "upper_stage": spacecraft.upper_stage(segments=6),
}


def box(size, center, group):
    """Vertices, triangles and groups of one box, faces in the order -x, +x, -y, +y, -z, +z."""
    vertices = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]
    return 0.5 * vertices * size + center, np.array(triangles), (group,) * 12


def boxes(*parts):
    vertices, triangles, groups = zip(*(box(*part) for part in parts), strict=True)
    shifted = [each + 8 * k for k, each in enumerate(triangles)]
    return closed_mesh("boxes", np.concatenate(vertices), np.concatenate(shifted), sum(groups, ()))


CUBE = boxes(((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), "bus"))
HEIGHT = 0.7
PLATES = boxes(
    ((1.0, 1.0, 1e-4), (0.0, 0.0, -5e-5), "low"),
    ((1.0, 1.0, 1e-4), (0.0, 0.0, HEIGHT + 5e-5), "high"),
)

LAWS = np.arange(PHONG_SHARE, PHASE_CURVATURE + 1)
