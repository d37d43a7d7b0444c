"""Impossible settings of the association are one line that names the key."""

import pytest

from cislunar.association import ASSOCIATORS, AssociationModel
from cislunar.errors import ConfigurationError
from cislunar.observation.sensor import Atmosphere, GroundSensor, Sensor
from cislunar.tasking.settings import LoopSettings


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"method": "nearest"}, f"method.*{ASSOCIATORS[1]}"),
        ({"detections": "all"}, "detections.*all-in-field"),
        ({"false_alarms_deg2": -0.1}, "false_alarms_deg2"),
        ({"false_alarm_slope": 0}, "false_alarm_slope"),
        ({"detection_loss": 1}, "detection_loss"),
        ({"unknown_deg2": 0}, "unknown_deg2"),
        ({"gate_probability": 1}, "gate_probability"),
        ({"magnitude_sigma": float("nan")}, "magnitude_sigma"),
        ({"window_steps": 0}, "window_steps"),
        ({"hypotheses": 1}, "hypotheses"),
        ({"committed_steps": 13}, "committed_steps = 13 must not exceed window_steps = 12"),
        ({"window_steps": 4}, "committed_steps = 8 must not exceed window_steps = 4"),
        ({"confirmations": 6}, "confirmations = 6 must not exceed confirmation_exposures = 5"),
        ({"false_alarm_deg2": 1}, "false_alarm_deg2 = 1 is no such setting"),
    ],
)
def test_impossible_settings_are_one_line(change, message):
    with pytest.raises(ConfigurationError, match=message) as caught:
        AssociationModel(**change)
    assert "\n" not in str(caught.value)


def test_the_defaults_are_those_of_the_paper():
    model = AssociationModel()
    assert model.detections == "tasked-target" and not model.in_field
    model.require_possible(True, True, 5)


def test_dimmed_targets_are_refused_with_detections_in_the_field():
    """The correction of a magnitude for shadow or air would tell whose detection it is."""
    everything = AssociationModel(detections="all-in-field")
    with pytest.raises(ConfigurationError, match="leave out eclipse and stations"):
        LoopSettings(association=everything, eclipse=True)
    with pytest.raises(ConfigurationError, match="leave out eclipse and stations"):
        LoopSettings(
            association=everything, sensor=(Sensor(), GroundSensor(atmosphere=Atmosphere()))
        )
