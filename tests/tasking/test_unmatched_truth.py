"""Truths that differ from the assumed model in law, shape, prior and torque."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from small_cells import settings_of_cell

from cislunar.attitude.torque_model import TorqueModel
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.library import truth_model
from cislunar.campaign.settings.reading import typed
from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import InitialEstimate
from cislunar.estimation.light_curves.batch import batch
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.observation.body_factory import body_from_spec
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.observation.body_spec import BodySpec, bodies_of_targets
from cislunar.observation.sensor import Sensor
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.materials import REFLECTION_LAWS, TABULATED, Material, PhotometryModel
from cislunar.photometry.shapes import icosahedron
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.initial_conditions import initial_estimate
from cislunar.tasking.truth import TrueMotion, TruthModel

SENSOR = Sensor(limiting_magnitude=24.0)
EXAMPLE = str(Path(__file__).parents[2] / "config/examples/brdf.csv")
EVERY = BodyParameterPrior(0.25, 0.25, 0.5, 0.2, 0.1, 0.1, 0.2, 0.05, 0.01)
IN_BODY = ("log_albedo", "log_slope", "logit_reflectance")


@pytest.fixture(scope="module")
def problem():
    return tracking_problem(5, 5, duration_hours=2.0, sensor=SENSOR)


class Watched:
    """The batch estimator, which keeps its surfaces and the measurements that it receives."""

    def __init__(self, settings):
        self._made, self.surfaces, self.values = batch(settings), None, []
        self.abilities = self._made.abilities

    def __call__(self, scene, surfaces, *given):
        self.surfaces = surfaces
        made = self._made(scene, surfaces, *given)
        advance = made.advance

        def watched(measurements, **options):
            self.values.append(measurements.value)
            return advance(measurements, **options)

        made.advance = watched
        return made


def run(problem, truth):
    """The run of one realization, and what the estimator saw."""
    watched = Watched(BatchSettings(estimated_parameters=BodyParameterPrior(log_albedo=0.25,
        angular_acceleration_deg_h2=0.01)))  # fmt: skip
    scene, surfaces, epoch, ids, loop = problem
    result = run_closed_loop(scene, surfaces, epoch, ids, [1], loop, truth=truth, estimator=watched)
    return result, watched


@pytest.fixture(scope="module")
def usual(problem):
    return run(problem, TruthModel(problem[1], SENSOR.noise, np.zeros(3)))


def truth_of(problem, name):
    plain = TruthModel(problem[1], SENSOR.noise, np.zeros(3))
    if name in (*REFLECTION_LAWS, EXAMPLE):
        model = PhotometryModel(reflection=name)
        return plain._replace(surfaces=target_surfaces(icosahedron(), Material(), 5, model))
    if name in ("cylinder", "hexagonal-prism", "box", "cube", "box-with-wings"):
        body = body_from_spec(BodySpec(name, 1.0), Material())
        return plain._replace(surfaces=target_surfaces(body, Material(), 5))
    if name == "heavy tails":
        return plain._replace(parameter_sigma=EVERY, parameter_freedom=3.0)
    return plain._replace(torque=TorqueModel(center_of_pressure_sigma_m=0.01, random_deg_h2=0.1))


TRUTHS = [*REFLECTION_LAWS[1:], EXAMPLE, "cylinder", "box-with-wings", "heavy tails", "torque"]


@pytest.mark.parametrize("name", TRUTHS)
def test_estimator_and_scheduler_do_not_know_the_truth(problem, usual, name):
    """The estimator gets the assumed surfaces, and the first assignment does not change; the
    measured magnitudes do, and the angles of the same observations do not."""
    result, watched = run(problem, truth_of(problem, name))
    assert watched.surfaces is problem[1]
    assert not watched.surfaces.law.any()
    np.testing.assert_array_equal(result.assignment[0, 0], usual[0].assignment[0, 0])
    first, second = usual[1].values[0], watched.values[0]
    both = np.isfinite(first + second).all(axis=-1)
    assert both.sum() > 30
    assert abs(first - second)[both][:, 0].max() > 0.02
    np.testing.assert_array_equal(first[both][:, 1:], second[both][:, 1:])
    assert np.isfinite(result.bound).all()
    unknown = np.isnan(result.parameter_error)
    assert unknown[..., :3].all() == (name == "torque")  # a torque that is not constant
    assert unknown[..., 3].all() == (name in (EXAMPLE, "box-with-wings"))  # no single albedo


def test_deviations_of_the_t_distribution(problem):
    """They have the standard deviations of the normal ones, which they share as random numbers,
    and the distribution that SciPy has."""
    truth = TruthModel(problem[1], SENSOR.noise, np.zeros(3), parameter_sigma=EVERY)
    heavy = truth._replace(parameter_freedom=4.0)
    found = {}
    for name, model in (("normal", truth), ("t", heavy)):
        drawn = [model.sampled(seed, range(5)) for seed in range(400)]
        assert all(each.parameter_freedom is None for each in drawn)
        found[name] = np.log([each.surfaces.material[:, 3] / 0.3 for each in drawn]).ravel() / 0.25
        pushed = np.array([each.angular_acceleration for each in drawn])
        assert np.rad2deg(pushed.std()) * 3600.0**2 == pytest.approx(0.01, rel=0.1)
    scaled = stats.t(4.0, scale=np.sqrt(0.5))
    assert scaled.std() == pytest.approx(1.0)
    assert stats.kstest(found["t"], scaled.cdf).pvalue > 0.01
    assert stats.kstest(found["t"], stats.norm.cdf).pvalue < 1e-3
    np.testing.assert_array_equal(np.sign(found["t"]), np.sign(found["normal"]))


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("freedom", [None, 3.0])
def test_the_prior_of_the_estimator_stays(problem, factor, freedom):
    """Half and double the spread of the truth, normal or not, under the same prior."""
    sigma = BodyParameterPrior(**{key: factor * value for key, value in EVERY})
    truth = TruthModel(problem[1], SENSOR.noise, np.zeros(3))
    truth = truth._replace(parameter_sigma=sigma, parameter_freedom=freedom)
    usual = truth._replace(parameter_sigma=EVERY).sampled(2, range(5)).surfaces.material
    found = truth.sampled(2, range(5)).surfaces.material
    ratio = np.log(found[:, 3] / 0.3) / np.log(usual[:, 3] / 0.3)
    np.testing.assert_allclose(ratio, factor, rtol=1e-9)


@pytest.mark.parametrize(
    ("sigma", "freedom", "message"),
    [
        (EVERY, 2.0, "parameter_freedom = 2.0 must be above 2"),
        (BodyParameterPrior(), 4.0, "every standard deviation of parameter_sigma is 0"),
    ],
)
def test_a_distribution_without_spread_is_refused(problem, sigma, freedom, message):
    truth = TruthModel(problem[1], SENSOR.noise, np.zeros(3))
    with pytest.raises(ConfigurationError, match=message):
        truth._replace(parameter_sigma=sigma, parameter_freedom=freedom).sampled(1, range(5))


@pytest.mark.parametrize("key", IN_BODY)
def test_a_table_does_not_depend_on_the_material(problem, key):
    truth = truth_of(problem, EXAMPLE)._replace(parameter_sigma=BodyParameterPrior(**{key: 0.2}))
    with pytest.raises(ConfigurationError, match=f"{key} = 0.2: the light of a tabulated"):
        truth.sampled(1, range(5))


def test_varying_torque_by_intervals_is_that_of_the_whole(problem):
    """To the last bit; and without torque the motion is that of torque-free bodies."""
    scene, surfaces, epoch, ids, loop = problem
    initial: InitialEstimate = initial_estimate(epoch, loop.initial.components())
    given = initial, scene, SENSOR.noise, 3, ids

    def motion(**torque):
        return TrueMotion(*given, torque=TorqueModel(**torque), surfaces=surfaces)

    torque = {"center_of_pressure_sigma_m": 0.01, "random_deg_h2": 0.1}
    whole, parts, start = motion(**torque).advance(120), motion(**torque), 0
    for end in (1, 61, 120):
        part = parts.advance(end - start)
        for name, values in whole._asdict().items():
            np.testing.assert_array_equal(getattr(part, name), values[:, start : end + 1], name)
        start = end
    free = TrueMotion(*given).advance(120)
    np.testing.assert_array_equal(whole.translation, free.translation)
    np.testing.assert_array_equal(whole.noise, free.noise)
    # an integrated attitude is normalized at the start
    np.testing.assert_allclose(whole.quaternion[:, 0], free.quaternion[:, 0], rtol=0, atol=1e-15)
    gained = np.rad2deg(abs(whole.angular_velocity - free.angular_velocity)[:, -1]) * 3600.0
    assert np.all(gained.max(axis=-1) > 0.01)  # deg/h in two hours
    weak = motion(random_deg_h2=1e-12).advance(120)
    np.testing.assert_allclose(weak.quaternion, free.quaternion, atol=1e-10)
    # The two torques have random numbers of their own, and nearly add up: that of sunlight depends
    # on the attitude, which the random one changes by a degree.
    rates = [
        motion(**{key: value}).advance(120).angular_velocity - free.angular_velocity
        for key, value in torque.items()
    ]
    together = whole.angular_velocity - free.angular_velocity
    assert abs(sum(rates) - together).max() < 0.01 * abs(together).max()
    assert all(abs(each).max() > 0.02 * abs(together).max() for each in rates)


def test_a_truth_of_the_settings():
    """As a variant of a study states it."""
    stated = {
        "body": {"axis_scale": [1.1, 1.0, 0.95], "inertia": [1, 1, 1.1]},
        "reflection": "lommel-seeliger-ggx",
        "parameter_sigma": {"log_albedo": 0.5},
        "parameter_freedom": 3,
        "torque": {"random_deg_h2": 0.01},
    }
    cell = typed(settings_of_cell({}, truth=stated), CellSettings)
    usual = BodySpec("icosahedron", table=str(Path(EXAMPLE).with_name("bodies.csv")))
    bodies = bodies_of_targets(usual.model_copy(update=stated["body"]), [["0"], ["1"], ["17"]])
    assert [each.shape for each in bodies] == ["icosahedron", "box-with-wings", "upper-stage"]
    assert all(each.axis_scale == [1.1, 1.0, 0.95] for each in bodies)
    assert [each.inertia for each in bodies] == [[1, 1, 1.1], [1, 1, 1.1], [1, 12, 12]]
    found = truth_model(cell, [["0"]])
    assert found.surfaces.law.tolist() == [REFLECTION_LAWS.index("lommel-seeliger-ggx")]
    assert found.surfaces.law[0] != TABULATED
    assert found.parameter_freedom == 3
    assert found.torque == TorqueModel(random_deg_h2=0.01)
    assert found.parameter_sigma == BodyParameterPrior(log_albedo=0.5)
