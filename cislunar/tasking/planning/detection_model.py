"""Brightness that tasking assumes of the targets before their first observation."""

from typing import Literal

from cislunar.runtime.settings_fields import NotNegative, Positive, Section, setting

# fmt: off


class DetectionModel(Section):
    """Brightness of targets; see `cislunar.tasking.planning.detection`."""

    brightness: Literal["facets", "sphere"] = setting(
        "expected magnitude of a target, up to an offset of its own: that of its `facets` in the "
        "attitude that the estimator expects (with one catalog per observer, which share no "
        "attitude, that of the sphere), or that of the `sphere`", default="facets")
    prior_mag: Positive = setting(
        "standard deviation of the offset before the first observation (1 suits the `sphere`)",
        "mag", default=0.3)
    flicker_mag: Positive = setting(
        "standard deviation of the magnitude about its expected value with the offset (0.5 suits "
        "the `sphere`)", "mag", default=0.3)
    never_detected_bonus: NotNegative = setting(
        "value of a certain detection of a target that was never detected, in addition to its "
        "information", "nat", default=5.0)
