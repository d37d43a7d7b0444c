"""Factory of estimators that treat the errors of the observers."""

from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import EstimatorFactory, abilities_of
from cislunar.estimation.initial_sigma import ProcessNoise
from cislunar.estimation.navigation.errors import TREATMENTS, ObserverErrorSigma
from cislunar.estimation.navigation.navigated_estimator import NavigatedEstimator
from cislunar.runtime.arguments import require_choice, require_kind


def navigated(
    factory: EstimatorFactory,
    treatment: str,
    sigma: ObserverErrorSigma,
    *,
    process_noise: ProcessNoise | None = None,
) -> EstimatorFactory:
    """Factory of estimators that treat the errors of the observers; see `NavigatedEstimator`.

    Parameters
    ----------
    factory : EstimatorFactory
        Factory of estimators that assume observers without errors.
    treatment : {"none", "considered", "calibrated"}
        "none" returns `factory`.
    sigma : ObserverErrorSigma
        Prior standard deviations of the observers' errors.
    process_noise : ProcessNoise, optional
        Process noise of the estimators of `factory`; none if omitted.

    Returns
    -------
    EstimatorFactory

    Raises
    ------
    ConfigurationError
        If the treatment is unknown, or all standard deviations are zero.
    """
    require_choice("treatment", treatment, TREATMENTS)
    if treatment == "none":
        return factory
    require_kind("sigma", sigma, ObserverErrorSigma, "give an ObserverErrorSigma")
    if not sigma.present:
        raise ConfigurationError(
            f"treatment = {treatment!r} needs a prior: give position_m, pointing_arcsec or clock_s"
        )

    def make(scene, surfaces, sensor, initial, rng, forces):
        inner = factory(scene, surfaces, sensor, initial, rng, forces)
        n_targets = initial.translation.shape[0]
        return NavigatedEstimator(inner, scene, forces, sigma, treatment, process_noise, n_targets)

    make.abilities = abilities_of(factory)
    return make
