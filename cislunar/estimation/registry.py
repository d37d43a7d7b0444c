"""The estimators by name."""

from cislunar.estimation.estimator import EstimatorFactory
from cislunar.estimation.initial_sigma import ProcessNoise
from cislunar.estimation.kalman.mukf import mukf
from cislunar.estimation.light_curves.batch import batch
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.names import ESTIMATORS
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.runtime.arguments import require_choice


def estimator_named(
    name: str,
    *,
    process_noise: ProcessNoise | None = None,
    splitting: bool = False,
    batch_settings: BatchSettings | str = "default",
    use_magnitude: bool = True,
    extra_magnitude_noise: float = 0.0,
    noise_memory: float | None = None,
    estimated_parameters: BodyParameterPrior | None = None,
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
    use_magnitude, extra_magnitude_noise, noise_memory, estimated_parameters
        Of the paper's filter, see `cislunar.estimation.kalman.mukf.MultiplicativeUKF`. The batch
        estimator has its own settings of noise and parameters.

    Returns
    -------
    EstimatorFactory

    Raises
    ------
    ConfigurationError
        If the name of the estimator or of the preset is unknown.
    """
    require_choice("estimator", name, ESTIMATORS)
    if name == "batch":
        return batch(batch_settings, process_noise=process_noise, splitting=splitting)
    return mukf(
        process_noise=process_noise,
        splitting=splitting,
        use_magnitude=use_magnitude,
        extra_magnitude_noise=extra_magnitude_noise,
        noise_memory=noise_memory,
        estimated_parameters=estimated_parameters,
    )
