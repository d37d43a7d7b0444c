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

    bins: ClassVar[int] = 200
    """Bins of a light curve, between which the model error is correlated."""

    iterations: ClassVar[int] = 8
    warm_iterations: ClassVar[int] = 3
    model_errors_mag: ClassVar[tuple[float, ...]] = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0)
    lengths: ClassVar[tuple[float, ...]] = (0.35, 1.0)

    @property
    def kept_modes(self) -> int:
        """Number of modes of a model from which fits of other models start."""
        return 2 * self.effort

    @property
    def new_starts(self) -> int:
        """Number of searched modes, and of random starts, of the tempered likelihood."""
        return 6 * self.effort
