"""Settings of the choice between models of a body."""

from typing import ClassVar

from cislunar.runtime.settings_fields import Section, setting, whole


class ModelSelectionSettings(Section):
    """How hard models of a body are searched and fitted."""

    # fmt: off

    effort: whole(ge=0) = setting(
        "effort of the choice between models of a body by the evidence of its light curve at "
        "tasking epochs, a factor on the numbers of modes and starts (docs/attitude.md); 0: the "
        "body is as `batch.estimated_parameters` states", default=0)

    # fmt: on

    bins: ClassVar[int] = 200
    """Bins of a light curve, between which model errors are correlated."""

    iterations: ClassVar[int] = 8
    warm_iterations: ClassVar[int] = 3
    model_errors_mag: ClassVar[tuple[float, ...]] = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0)
    lengths: ClassVar[tuple[float, ...]] = (0.35, 1.0)

    @property
    def kept_modes(self) -> int:
        """Modes of a model that are followed."""
        return 2 * self.effort

    @property
    def new_starts(self) -> int:
        """Searched modes and random starts of the tempered likelihood."""
        return 6 * self.effort
