"""Factory of estimators whose targets are tested for maneuvers."""

from cislunar.estimation.estimator import EstimatorFactory, abilities_of
from cislunar.estimation.initial_sigma import ProcessNoise, noise_of_step
from cislunar.estimation.maneuvers.detection_settings import ManeuverDetection
from cislunar.estimation.maneuvers.likelihood_ratio import ManeuverTest
from cislunar.estimation.maneuvers.monitored_estimator import MonitoredEstimator
from cislunar.estimation.maneuvers.recovering_estimator import RecoveringEstimator
from cislunar.estimation.maneuvers.search import ReachableSearch
from cislunar.estimation.maneuvers.thresholds import false_alarm_threshold
from cislunar.observation.sensor import sensor_limits


def monitored(
    factory: EstimatorFactory,
    settings: ManeuverDetection,
    *,
    process_noise: ProcessNoise | None = None,
) -> EstimatorFactory:
    """Factory of estimators whose targets are tested for maneuvers.

    Parameters
    ----------
    factory : EstimatorFactory
    settings : ManeuverDetection
    process_noise : ProcessNoise, optional
        That of the estimators of `factory`.

    Returns
    -------
    EstimatorFactory
        `factory` itself, if `settings` has no rate of false alarms.

    Raises
    ------
    ConfigurationError
        If the rate of false alarms is not less than both 1 and the number of independent tests.
    """
    rate = settings.false_alarms_per_target_day
    if rate is None:
        return factory
    threshold = false_alarm_threshold(rate, settings.independent_tests_per_day)

    def make(scene, surfaces, sensor, initial, rng, forces):
        test = ManeuverTest(
            scene,
            forces,
            initial.translation.shape[0],
            process_noise=process_noise,
            window_hours=settings.window_hours,
            spacing_minutes=settings.spacing_minutes,
        )
        inner = factory(scene, surfaces, sensor, initial, rng, forces)
        if not settings.recover:
            return MonitoredEstimator(inner, test, threshold)
        model = scene, forces, noise_of_step(process_noise, scene.step_s)
        search = None
        if settings.search_share > 0.0:
            half_field = sensor_limits(sensor, scene.observer_position.shape[0]).half_field
            search = ReachableSearch(
                scene,
                forces,
                half_field,
                initial.translation.shape[0],
                settings.search_share,
                settings.maneuvers_per_target_day,
            )
        return RecoveringEstimator(inner, test, threshold, model, settings, search)

    make.abilities = abilities_of(factory)._replace(
        tests_maneuvers=True,
        maneuvers_per_day=settings.maneuvers_per_target_day if settings.recover else 0.0,
        searches_field=settings.search_share > 0.0,
    )
    return make
