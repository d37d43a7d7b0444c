"""Settings of the choice between models of a body."""

from typing import ClassVar

from cislunar.estimation.light_curves.batch_settings import BatchSettings, SearchSettings
from cislunar.runtime.settings_fields import Count, Section, setting


class ModelSelectionSettings(Section):
    """How hard models are searched and fitted."""

    # fmt: off

    effort: Count = setting(
        "effort of the choice between models: factor on the number of modes and of starts",
        default=1)

    # fmt: on

    @property
    def bins(self) -> int:
        """Bins of the light curve, between which model errors are correlated."""
        return 200

    @property
    def kept_modes(self) -> int:
        """Modes of a model that are followed."""
        return 2 * self.effort

    @property
    def new_starts(self) -> int:
        """Modes of the tempered likelihood that are searched for."""
        return 6 * self.effort

    iterations: ClassVar[int] = 8
    warm_iterations: ClassVar[int] = 3
    model_errors_mag: ClassVar[tuple[float, ...]] = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0)
    lengths: ClassVar[tuple[float, ...]] = (0.35, 1.0)

    def search_settings(self) -> SearchSettings:
        """Searches of one model."""
        usual = BatchSettings().search_settings()
        return usual._replace(starts=self.effort * usual.starts)
