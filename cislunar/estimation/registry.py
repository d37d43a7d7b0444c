"""The estimators by name."""

from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import EstimatorFactory
from cislunar.estimation.initial_sigma import ProcessNoise
from cislunar.estimation.kalman.mukf import mukf
from cislunar.estimation.light_curves.batch import batch
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.names import ESTIMATORS


def estimator_named(
    name: str,
    *,
    process_noise: ProcessNoise | None = None,
    splitting: bool = False,
    batch_settings: BatchSettings | str = "default",
) -> EstimatorFactory:
    """Factory of the estimator with this name.

    Parameters
    ----------
    name : {"mukf", "batch"}
        The paper's filter (multiplicative unscented Kalman filter) or the batch estimator.
    process_noise : ProcessNoise, optional
        None if omitted. The batch estimator has none on attitude and angular velocity.
    splitting : bool
        Whether an orbit estimate becomes a Gaussian mixture where it is nonlinear, see
        `cislunar.estimation.kalman.gaussian_mixture`.
    batch_settings : BatchSettings or str
        Settings of the batch estimator, or the name of a preset.
    """
    factories = {
        "mukf": lambda: mukf(process_noise=process_noise, splitting=splitting),
        "batch": lambda: batch(batch_settings, process_noise=process_noise, splitting=splitting),
    }
    if name not in factories:
        raise ConfigurationError(
            f"estimator {name!r} is unknown: use one of {', '.join(ESTIMATORS)}"
        )
    return factories[name]()
