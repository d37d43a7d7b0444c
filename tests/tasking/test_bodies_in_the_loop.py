"""Non-convex and multi-material bodies in the closed loop, the fits and the bound."""

import numpy as np
import pytest
from measured import draw_truth, observed_by

from cislunar.estimation.light_curves.batch import BatchEstimator
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.light_curves.light_curve import cost, cost_and_derivatives
from cislunar.observation.body_factory import body_from_spec
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.body_spec import BodySpec
from cislunar.observation.sensor import Sensor
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import icosahedron
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.truth import TruthModel

SENSOR = Sensor(limiting_magnitude=24.0)
SHAPES = ["box-with-wings", "icosahedron", "upper-stage", "box-with-wings", "icosahedron"]


@pytest.fixture(scope="module")
def surfaces():
    bodies = [body_from_spec(BodySpec(shape, 2.0), Material()) for shape in SHAPES]
    return target_surfaces(bodies, Material(), len(bodies))


def test_known_bodies_are_tracked_and_wrong_shapes_are_not(surfaces):
    """Both estimators against the bound; an assumed icosahedron fails for other shapes."""
    problem = tracking_problem(5, 5, duration_hours=6.0, sensor=SENSOR)
    found = {}
    for name in ("mukf", "batch"):
        result = run_closed_loop(
            problem.scene, surfaces, *problem[2:4], [1, 2], problem.loop, estimator=name
        )
        error, bound = (
            np.linalg.norm(each[:, -1, :, :3], axis=-1) for each in (result.error, result.bound)
        )
        assert not result.failed.any()
        assert np.isfinite(bound).all()
        found[name] = np.median(error / bound)
    assert 0.3 < found["batch"] < 1.5
    assert found["batch"] < 1.2 * found["mukf"]
    truth = TruthModel(surfaces, SENSOR.noise, np.zeros(3))
    assumed = target_surfaces(icosahedron(2.0), Material(), 5)
    wrong = run_closed_loop(
        problem.scene, assumed, *problem[2:4], [1, 2], problem.loop, estimator="batch", truth=truth
    )
    error, sigma = (
        np.linalg.norm(each[:, -1, :, :3], axis=-1) for each in (wrong.error, wrong.sigma)
    )
    known = np.array([shape == "icosahedron" for shape in SHAPES])
    assert np.median((error / sigma)[:, ~known]) > 3.0 > np.median((error / sigma)[:, known])


def test_derivatives_of_a_light_curve_against_differences(surfaces):
    """Of the cost by rotation, materials, lengths and facets of a body that shadows itself."""
    scene, _, epoch, ids, loop = tracking_problem(5, 5, duration_hours=2.0)
    initial = initial_estimate(epoch, loop.initial.components())
    truth = draw_truth(initial, scene, SENSOR.noise, 3, ids)
    measured, _ = observed_by(np.arange(5), scene, surfaces, SENSOR, truth)
    prior = BodyParameterPrior(0.2, 0.2, 0.3, 0.2, 0.1, 0.1, 0.1)
    estimator = BatchEstimator(
        scene, surfaces, SENSOR, initial, np.random.default_rng(0),
        settings=BatchSettings(estimated_parameters=prior, starts=0, first_starts=0, pool=0),
    )  # fmt: skip
    estimator.advance(measured)
    data, model, anchor = estimator.light_curve(0)
    assert model.surface.composite and len(data) > 100
    size, h = model.sigma.size, 1e-6
    u = 0.3 * np.random.default_rng(1).standard_normal(size)
    gradient, information = np.empty(size), np.empty((size, size))
    cost_and_derivatives(u, data, anchor, model, gradient, information)
    ends = [
        [cost(u + side * h * e, data, anchor, model, np.inf) for side in (1, -1)]
        for e in np.eye(size)
    ]
    slopes = np.array([(up - down) / (2.0 * h) for up, down in ends])
    off = abs(gradient - slopes) > 1e-5 * (1.0 + abs(slopes))
    assert off.sum() <= 2  # the edge of a triangle of the table may lie between the two
    assert (abs(gradient) > 0.1).sum() > 20
