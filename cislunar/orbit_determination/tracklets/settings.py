"""Settings of tracklets. Nothing here needs compiled kernels."""

from cislunar.runtime.settings_fields import Positive, Section, setting, whole


class TrackletSettings(Section):
    """Conditions on detections of one observer that may belong to one pass of an object."""

    # fmt: off

    largest_gap_min: Positive = setting(
        "longest time between consecutive detections of a tracklet", "min", default=15)
    largest_span_min: Positive = setting(
        "longest time between the first and the last detection; longer tracklets are divided",
        "min", default=120)
    largest_rate_arcsec_s: Positive = setting(
        "fastest motion on the sky", "arcsec/s", default=3.5)
    largest_magnitude_difference: Positive = setting(
        "largest difference of magnitude between consecutive detections", "mag", default=1.5)
    largest_acceleration_arcsec_s2: Positive = setting(
        "largest change of the rate in time, within which a third detection continues two others",
        "arcsec/s^2", default=3e-4)
    least_detections: whole(ge=2) = setting(
        "detections that a tracklet has at least; 3 suppresses false tracklets where false alarms "
        "are frequent", "1", default=2)

    # fmt: on
