"""Quality of a catalog that is compared with the truth, on a table made by hand."""

import numpy as np
import pandas as pd
import pytest
from maneuvered_arcs import STEP, arcs, linked

from cislunar.detection import FALSE_ALARM
from cislunar.errors import ConfigurationError
from cislunar.survey import ORBIT_COLUMNS, catalog_state, orbit_table
from cislunar.survey.settings import QualitySettings


def orbit(confirmed, of, error_km, nees, now_km=5.0, now_nees=6.0, detections=10, right=10):
    row = {
        "day": 1.0, "confirmed": confirmed, "verdict": "orbit", "object": of,
        "detections": detections, "right_detections": right, "observers": 3,
        "error_km": error_km, "sigma_km": 1.0, "nees": nees, "now_km": now_km, "now_nees": now_nees,
        "averaged_nees": min(nees, 12.0),
    }  # fmt: skip
    assert set(row) == set(ORBIT_COLUMNS)
    return row


def test_right_wrong_false_and_duplicate_orbits_are_counted():
    table = pd.DataFrame([
        orbit(True, 0, 1.0, 4.0), orbit(True, 0, 2.0, 8.0, now_nees=10.0),
        orbit(True, 1, 3.0, 6000.0, now_km=40.0, now_nees=9000.0),
        orbit(True, 2, 900.0, 1e6, now_km=900.0), orbit(True, FALSE_ALARM, np.nan, np.nan, np.nan),
        orbit(False, 3, 1.0, 6.0), orbit(True, 4, 1.0, 6.0, right=9),
    ])  # fmt: skip
    origin = np.array([0, 1, 2, 3, 4, FALSE_ALARM])
    found = catalog_state(
        table, origin, np.array([3, 3, 4, 3, 2, 5]), QualitySettings(),
        outside=np.array([False, True, True, False, False, True]),
        maneuvered=np.array([False, True, False, False, False, False]), known=[0, 1, 2, 3],
    )  # fmt: skip
    assert (found.objects, found.detected, found.findable, found.confirmed) == (6, 5, 5, 6)
    assert (found.right, found.wrong, found.false, found.duplicate, found.candidates) == (
        3, 1, 1, 1, 1,
    )  # fmt: skip
    # findable: 0, 1, 2, 3 and 5, of which 0 and 1 have a correct orbit
    assert found.completeness == pytest.approx(2 / 5)
    assert (found.completeness_inside, found.completeness_outside) == pytest.approx((1 / 2, 1 / 3))
    assert found.completeness_maneuvering == 1.0
    assert found.custody == pytest.approx(1 / 5)  # object 1 is 40 km from its prediction
    assert found.purity == pytest.approx(49 / 60)  # of the false orbit none
    assert found.nees == pytest.approx(np.mean([4.0, 8.0, 6000.0, 6.0]))
    assert found.covered == pytest.approx(3 / 4)  # chi squared of six degrees of freedom: 12.6
    assert found.nees_averaged == pytest.approx(np.mean([4.0, 8.0, 12.0, 6.0]))
    assert found.covered_averaged == 1.0
    assert found.nees_ballistic == pytest.approx(6.0)
    assert found.nees_now_ballistic == pytest.approx(np.mean([6.0, 10.0, 6.0]))
    # object 2 is farther from its orbit than a right one, and that of object 3 is not confirmed
    assert found.error_known_km == pytest.approx((5.0 * 40.0 * 500.0 * 500.0) ** 0.25)
    unknown = catalog_state(table, origin, np.zeros(6, dtype=int), QualitySettings())
    assert np.isnan(unknown.error_known_km)


def test_an_orbit_of_several_objects_with_equally_many_detections_is_wrong():
    angles, fits, truth = arcs((0.3, -0.2, 0.5))
    fits = fits.take([0, 1])
    origin = np.full(angles.time.size, FALSE_ALARM)
    first, second = fits.detections(0), fits.detections(1)
    origin[first], origin[second] = 0, 1
    half = second[: second.size // 2]
    origin[half] = 2
    last = round(float(fits.epoch[1]) / STEP)
    states = np.array([truth[0], truth[1], truth[1]])

    def table_of(averaged=None):
        return orbit_table(
            linked(fits, [True, True]), angles, origin, lambda of, index: states[of], last, STEP,
            0.1, averaged=averaged,
        )  # fmt: skip

    with pytest.raises(ConfigurationError, match="epoch of orbit 0 is no time of the truth"):
        orbit_table(
            linked(fits._replace(epoch=fits.epoch + 0.25 * STEP), [True, True]), angles, origin,
            lambda of, index: states[of], last, STEP, 0.1,
        )  # fmt: skip

    def quality():
        table = table_of()
        return catalog_state(table, origin, np.full(3, 3), QualitySettings())

    # 20 and 19 of 39 detections
    assert second.size % 2 == 1 and (quality().right, quality().wrong) == (2, 0)
    origin[second[-1]] = FALSE_ALARM
    assert (quality().right, quality().wrong) == (1, 1)

    # normalized errors by the second state and covariance
    alone = table_of()
    assert alone["averaged_nees"].equals(alone["nees"])
    miss = states[0] - fits.state[0]
    wider = fits.updated([0], fits.state[[0]] + 0.5 * miss, 4.0 * fits.covariance[[0]])
    ratio = table_of(wider)["averaged_nees"][0] / alone["nees"][0]
    assert ratio == pytest.approx(1.0 / 16.0)
