"""The estimators by name: one role, chosen by a string."""

from cislunar.errors import ConfigurationError
from cislunar.estimation.estimator import EstimatorFactory
from cislunar.estimation.kalman.mukf import mukf
from cislunar.estimation.light_curves.batch import batch
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.spread import ProcessNoise

ESTIMATORS = ("mukf", "batch")
"""The paper's filter, and the batch estimator of the attitude beside a filter of the orbit."""


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
        Which one.
    process_noise : ProcessNoise, optional
        None if omitted. The batch estimator has none on attitude and angular velocity.
    splitting : bool
        Whether an orbit's Gaussian is split where it has bent, see
        `cislunar.estimation.kalman.parts`.
    batch_settings : BatchSettings or str
        Of the batch estimator: settings, or the name of a preset.

    Returns
    -------
    EstimatorFactory

    Raises
    ------
    ConfigurationError
        If there is no such estimator.
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
