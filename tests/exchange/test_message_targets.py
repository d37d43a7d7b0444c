"""Targets of a study from the states of a message."""

import numpy as np
import pytest
from halo_message import HALO, written
from message_files import file_of

from cislunar.campaign.data.own_targets import own_tracked_dataset
from cislunar.campaign.settings.scenarios import SECTIONS, shared_dataset
from cislunar.constants import EPOCH_JD, TIME_UNIT_S
from cislunar.dynamics.propagation import propagate
from cislunar.errors import InputFileError
from cislunar.exchange.inertial import CENTERS, epoch_at, inertial_states
from cislunar.exchange.oem import Segment, oem_text
from cislunar.targets.tables import load_target_states


@pytest.mark.parametrize("center", CENTERS)
def test_targets_are_read_from_a_message(epoch, segment, tmp_path, center):
    state = inertial_states(
        propagate(HALO, [0.0, 0.01, 0.02]), np.arange(3) * 0.01 * TIME_UNIT_S, epoch, center
    )
    tdb = epoch.tdb_s + np.arange(3) * 0.01 * TIME_UNIT_S
    other = Segment("HALO 2", "2030-002A", center, tdb, state)
    path = file_of(tmp_path, oem_text([segment, other], created="2030-01-01"), "two.oem")
    found = load_target_states(path, epoch)
    assert found.name == ["HALO 1", "HALO 2"]
    np.testing.assert_allclose(found.state, [HALO, HALO], rtol=0.0, atol=1e-13)
    np.testing.assert_array_equal(found.period, 0.0)
    made = own_tracked_dataset(path, (EPOCH_JD, "de421"))
    np.testing.assert_allclose(made["state"], found.state, rtol=0.0, atol=1e-13)


def test_targets_of_a_message_need_its_epoch(epoch, segment, tmp_path):
    path = file_of(tmp_path, written(segment))
    with pytest.raises(InputFileError, match="give the epoch"):
        load_target_states(path)
    late = epoch_at(EPOCH_JD + 2.0)
    with pytest.raises(
        InputFileError, match=r"arc\.oem: object HALO 1: 2024-10-03.* is not within"
    ):
        load_target_states(path, late)
    inside = segment.state * np.where(np.arange(6) < 3, 1e-3, 1.0)
    moved = segment._replace(state=inside[:1], tdb_s=segment.tdb_s[:1], covariance=np.empty(0))
    path = file_of(tmp_path, written(moved))
    with pytest.raises(InputFileError, match="object 'HALO 1': lies inside the Earth"):
        load_target_states(path, epoch)


def test_a_message_is_shared_by_scenarios_of_the_same_epoch():
    entry = {"targets": 3, "tracked": "their.oem"}
    later = entry | {"settings": {"epoch_jd": EPOCH_JD + 1.0}}
    tables = entry | {"tracked": "their.csv"}
    config = {key: {} for key in SECTIONS}
    config |= {"epoch_jd": EPOCH_JD, "ephemeris": {"kernel": "de421"}}
    config["task2"] = {"photometry": {"irradiance": "4pi"}}
    config["task2"]["tasking"] = {"diffuse_reflection_coefficient": 0.5}
    config["scenarios"] = {"D": entry, "E": entry, "F": later, "G": tables, "H": later | tables}
    shared = [shared_dataset(config, name, "orbits/tracked") for name in config["scenarios"]]
    assert [name[-4] for name in shared] == ["D", "D", "F", "G", "G"]
