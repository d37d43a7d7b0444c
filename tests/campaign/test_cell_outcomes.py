"""Outcomes of the observations of a cell, and observers without a target."""

import numpy as np
from small_cell_datasets import small_cell

from cislunar.campaign.tracking.summary import seed_statistics
from cislunar.tasking.detection_outcomes import OBSERVATION_OUTCOMES


def test_surplus_observers_stay_idle(sources):
    crowded = small_cell(sources, targets=1)
    assert ((crowded["assignment"].values >= 0).sum(axis=-1) <= 1).all()
    assert set(np.unique(crowded["assignment"])) <= {-1, 0}


def test_a_cell_tells_the_outcomes_of_its_observations(sources, caplog):
    caplog.set_level("INFO", logger="cislunar")
    cell = small_cell(sources, sensor={"limiting_magnitude": 16})
    shares = {
        name: of for name, of in seed_statistics(cell).items() if name in OBSERVATION_OUTCOMES
    }
    np.testing.assert_allclose(sum(shares.values()), 1.0)
    names = cell["outcome"].attrs["flag_meanings"].split()
    observations = cell["outcome"].values[1][cell["outcome"].values[1] != names.index("not_tasked")]
    assert shares["faint_share"][1] == np.mean(observations == names.index("faint")) > 0.3
    assert "of the observations faint; raise task2.sensor.limiting_magnitude = 16" in caplog.text
    assert "task2.photometry.irradiance = 4pi" in caplog.text


def test_a_cell_where_nothing_is_seen_has_no_averages(sources, caplog):
    blind = small_cell(sources, sensor={"limiting_magnitude": 5})
    found = seed_statistics(blind)
    assert np.isnan(found["rmse_median"]).all()
    assert np.isnan(found["used_share"]).all()
    assert "warning: no target was ever tasked" in caplog.text
    np.testing.assert_array_equal(found["never_observed"], [4, 4])
    np.testing.assert_array_equal(found["inconsistent_rotation_share"], [0, 0])
