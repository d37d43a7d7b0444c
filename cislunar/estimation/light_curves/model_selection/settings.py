"""Settings of the choice between models of a body."""

from typing import ClassVar

from cislunar.runtime.settings_fields import Section, setting, whole


class ModelSelectionSettings(Section):
    """Settings of the choice between models of a body."""

    # fmt: off

    effort: whole(ge=0) = setting(
        "choice between models of a body, at tasking epochs, by the evidence of its light curve "
        "(docs/attitude.md): factor on the numbers of modes and starts; 0: no choice, the "
        "uncertain parameters are those of `batch.estimated_parameters`", default=0)

    # fmt: on

    bins: ClassVar[int] = 120
    """Bins of a light curve, between which the model error is correlated."""

    iterations: ClassVar[int] = 8
    warm_iterations: ClassVar[int] = 3
    model_errors_mag: ClassVar[tuple[float, float]] = (0.02, 1.3)
    """Limits of the standard deviation of the model error, over whose logarithm its prior is
    uniform."""
    first_error_mag: ClassVar[float] = 0.25
    check_error_mag: ClassVar[float] = 0.12
    """Values with which its estimation begins, in all models and in the check of narrow ones."""
    no_error_share: ClassVar[float] = 1.0 / 13.0
    """Prior probability that a model has no error."""
    lengths: ClassVar[tuple[float, ...]] = (0.35, 1.0)

    @property
    def kept_modes(self) -> int:
        """Number of modes of a model from which fits of other models start."""
        return 2 * self.effort

    @property
    def new_starts(self) -> int:
        """Number of searched modes, and of random starts, of the tempered likelihood."""
        return 6 * self.effort
