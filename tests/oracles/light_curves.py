"""Light-curve models of an icosahedron, the geometry of their data, and differences of the cost."""

import numpy as np

from cislunar.estimation.light_curves.light_curve import Anchor, LightCurveModel, cost
from cislunar.estimation.light_curves.row_blocks import RANGE, ROW_COLUMNS, SUN, TIME, VIEW
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.photometry.bodies import plain_body
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import icosahedron

FACETS = icosahedron()
RATE = np.deg2rad([-44.7, -6.7, -8.5]) / 3600.0
SIGMA = np.repeat([np.deg2rad(5.0), np.deg2rad(2.4) / 3600.0], 3)
INERTIAS = {"spherical": np.eye(3), "triaxial": np.diag([1.0, 1.3, 0.8])}
NOTHING_ESTIMATED = BodyParameterPrior()


def model_of(inertia="spherical", estimated_parameters=NOTHING_ESTIMATED, freedom=0.0):
    """Model with a noise of 0.1 mag and the given estimated body parameters."""
    matrix = INERTIAS[inertia]
    rotation, of_rotation = estimated_parameters.rotation_kinds()
    surface, of_surface = estimated_parameters.surface_kinds(FACETS.areas.size)
    return LightCurveModel(
        np.array([0.1, -0.2, 0.3, np.sqrt(0.86)]), RATE, np.r_[SIGMA, of_rotation, of_surface],
        rotation, surface, matrix, np.linalg.inv(matrix),
        inertia == "spherical" and rotation.size == 0,
        plain_body(FACETS, Material()), True, True, 0.01, freedom,
    )  # fmt: skip


def anchor_of(size=6):
    """The prior in units of its standard deviations."""
    return Anchor(np.zeros(size), np.eye(size), np.zeros(1))


def geometry(n, hours=(0.0, 6.0)):
    """Rows of detections of weight 1 without magnitudes."""
    data = np.ones((n, ROW_COLUMNS))
    data[:, TIME] = 3600.0 * np.linspace(hours[0] + 0.02, hours[1], n)
    angle = data[:, TIME] / 3.0e4
    zeros = np.zeros(n)
    data[:, SUN] = np.stack([np.cos(0.1 * angle), np.sin(0.1 * angle), zeros], -1)
    data[:, VIEW] = np.stack([np.cos(1.0 + angle), np.sin(1.0 + angle), zeros + 0.3], -1)
    data[:, VIEW] /= np.linalg.norm(data[:, VIEW], axis=1)[:, None]
    data[:, RANGE] = 8.0e7
    return data


def cost_differences(u, data, model, h=1e-6):
    """Gradient of the cost by central differences."""
    given = data, anchor_of(u.size), model, np.inf
    return [(cost(u + h * e, *given) - cost(u - h * e, *given)) / (2.0 * h) for e in np.eye(u.size)]
