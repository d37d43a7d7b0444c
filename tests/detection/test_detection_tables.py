"""Tables of exposures and detections against astropy and sampled errors."""

import numpy as np
import pandas as pd
import pytest
from astropy.coordinates import CartesianRepresentation, SphericalRepresentation
from astropy.time import Time
from scipy.spatial.transform import Rotation

from cislunar.detection import (
    DETECTION_COLUMNS,
    EXPOSURE_COLUMNS,
    DetectionProcess,
    Detections,
    Exposures,
    detection_table,
    expose,
    exposure_table,
    read_detections,
)
from cislunar.ephemeris.time_scales import tdb_seconds
from cislunar.errors import CislunarError, ConfigurationError, InputFileError
from cislunar.observation.scene import make_scene
from cislunar.observation.sensor import Sensor
from cislunar.observation.target_surfaces import target_surfaces
from cislunar.photometry.materials import Material
from cislunar.photometry.shapes import icosahedron

ARCSECOND = np.pi / 648_000.0
FIRST, N_TIMES = 3, 12
EPOCH_TDB = tdb_seconds("2016-12-31T22:20:00") + 0.1234567


@pytest.fixture(scope="module")
def scene():
    """Times on both sides of a leap second."""
    places = np.tile([[[1.1, 0.2, 0.1]], [[0.9, 0.1, -0.2]]], (1, N_TIMES, 1))
    sun = np.tile([300.0, 200.0, 0.0], (N_TIMES, 1))
    return make_scene(places, sun, 1800.0, observer_rate_deg_h=[30.0, -40.0, 20.0])


@pytest.fixture(scope="module")
def axes():
    return Rotation.random(N_TIMES, random_state=1).as_matrix()


@pytest.fixture(scope="module")
def observed():
    """Six exposures with up to three detections, also near the pole of the body frame."""
    exposures = Exposures(
        np.array([0, 0, 2, 2, 5, 8]),
        np.array([0, 1, 0, 1, 1, 0]),
        np.array([[0.1, 0.2], [3.0, -1.2], [-2.0, 1.4], [1.0, 0.0], [-0.5, -0.7], [2.5, 0.9]]),
        np.deg2rad([1.5, 4.0, 1.5, 4.0, 4.0, 1.5]),
        np.array([18.0, 16.0, 18.0, 16.0, 16.0, 18.0]),
    )
    rng = np.random.default_rng(2)
    exposure = np.array([0, 0, 1, 2, 2, 2, 4, 5])
    value = np.column_stack([rng.uniform(12.0, 16.0, 8), exposures.boresight[exposure]])
    value[:, 1:] += rng.normal(0.0, 0.01, size=(8, 2))
    sigma = rng.uniform(1.0, 5.0, size=(8, 3)) * [0.05, ARCSECOND, ARCSECOND]
    return exposures, Detections(exposure, value, sigma**2)


@pytest.fixture
def table(scene, axes, observed):
    exposures, detections = observed
    return detection_table(detections, exposures, scene, FIRST, EPOCH_TDB, axes)


def unit(ra, dec):
    return np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)


def sky(direction, index, scene, axes):
    """Right ascension and declination, deg, ICRF, of directions in the body frame, by astropy."""
    turned = axes[index] @ scene.observer_axes[index].T @ unit(*direction.T).T
    found = CartesianRepresentation(turned).represent_as(SphericalRepresentation)
    return np.column_stack([found.lon.deg, found.lat.deg])


def dates(seconds):
    """Dates in UTC of TDB seconds past J2000."""
    return Time(2451545.0, seconds / 86400.0, format="jd", scale="tdb").utc


def test_directions_and_dates_are_those_of_astropy(scene, axes, observed, table):
    exposures, detections = observed
    index = FIRST + exposures.step
    frames = exposure_table(exposures, 0.2, scene, FIRST, EPOCH_TDB, axes)
    assert tuple(frames) == EXPOSURE_COLUMNS and tuple(table) == DETECTION_COLUMNS
    of = detections.exposure
    for frame, direction, k in (
        (frames, exposures.boresight, index),
        (table, detections.value[:, 1:], index[of]),
    ):
        for row, each in enumerate(direction):
            expected = sky(each[None], k[row], scene, axes)[0]
            found = frame[["ra", "dec"]].to_numpy()[row]
            np.testing.assert_allclose(found, expected, atol=1e-11)
        given = Time([text.removesuffix("Z") for text in frame["obsTime"]], scale="utc")
        late = (given - dates(EPOCH_TDB + 1800.0 * k)).sec
        # the formulas of TDB - TT differ by tens of microseconds
        assert np.abs(late).max() < 1e-4
        assert all(text.endswith("Z") for text in frame["obsTime"])
    assert table["ra"].between(0.0, 360.0, inclusive="left").all()
    assert frames["stn"].tolist() == exposures.observer.tolist()
    assert table["stn"].tolist() == exposures.observer[of].tolist()
    assert table["expID"].tolist() == frames["expID"].to_numpy()[of].tolist()
    assert frames["expID"].is_unique and table["obsID"].is_unique
    np.testing.assert_array_equal(table["mag"], detections.value[:, 0])
    np.testing.assert_allclose(table["rmsMag"] ** 2, detections.variance[:, 0])
    np.testing.assert_allclose(frames["fieldDeg"], [3.0, 8.0, 3.0, 8.0, 8.0, 3.0])
    assert frames["limMag"].tolist() == exposures.limiting_magnitude.tolist()


def test_errors_are_those_of_sampled_directions(scene, axes, observed, table):
    exposures, detections = observed
    rng = np.random.default_rng(3)
    n, correlations = 200_000, []
    for row, e in enumerate(detections.exposure):
        mean, sigma = detections.value[row, 1:], np.sqrt(detections.variance[row, 1:])
        sample = mean + sigma * rng.normal(size=(n, 2))
        ra, dec = np.deg2rad(sky(sample, FIRST + exposures.step[e], scene, axes)).T
        center = np.deg2rad(table[["ra", "dec"]].to_numpy()[row])
        turn = (ra - center[0] + np.pi) % (2.0 * np.pi) - np.pi
        arcs = np.array([turn * np.cos(center[1]), dec - center[1]]) / ARCSECOND
        rms = arcs.std(axis=1)
        np.testing.assert_allclose(table[["rmsRA", "rmsDec"]].to_numpy()[row], rms, rtol=8e-3)
        correlations.append(np.corrcoef(arcs)[0, 1])
        assert table["rmsCorr"][row] == pytest.approx(correlations[-1], abs=0.01)
    assert np.ptp(correlations) > 0.5


def test_the_stated_number_of_false_alarms_is_that_of_the_simulation(scene, axes):
    """The field is square in the tangent plane; a wide one shows the difference to a sphere."""
    sensor, steps = Sensor(field_of_view_deg=40.0), np.arange(N_TIMES - FIRST)
    n = steps.size
    limits = sensor.limits()
    exposures = Exposures(
        steps, np.zeros(n, dtype=np.int64), np.tile([0.3, 0.2], (n, 1)),
        np.full(n, limits.half_field), np.full(n, limits.limiting_magnitude),
    )  # fmt: skip
    states = np.zeros((1, N_TIMES, 6))
    states[..., 0] = -5.0
    attitudes = np.tile([0.0, 0.0, 0.0, 1.0], (1, N_TIMES, 1))
    found, *_ = expose(
        FIRST, exposures, DetectionProcess(false_alarms_deg2=10.0), scene,
        target_surfaces(icosahedron(), Material(), 1), sensor, states, attitudes,
        np.zeros((1, N_TIMES, 2, 3)), np.random.default_rng(4), n_steps=n,
        command=np.full((n, 2), -1), kept=np.ones((1, n, 2), dtype=bool),
    )  # fmt: skip
    stated = exposure_table(exposures, 10.0, scene, FIRST, EPOCH_TDB, axes)["falseAlarms"]
    assert abs(found.exposure.size - stated.sum()) < 4.0 * np.sqrt(stated.sum())
    assert stated.sum() * (np.tan(0.5) - 0.5) > 8.0 * np.sqrt(stated.sum())


def test_tables_of_exposures_without_detections(scene, axes, observed, tmp_path):
    exposures = observed[0]
    none = Detections(np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 3)))
    table = detection_table(none, exposures, scene, FIRST, EPOCH_TDB, axes)
    assert tuple(table) == DETECTION_COLUMNS and len(table) == 0
    table.to_csv(tmp_path / "none.csv", index=False)
    assert len(read_detections(tmp_path / "none.csv")) == 0


def test_a_table_survives_a_file(table, observed, tmp_path):
    path = tmp_path / "detections.csv"
    table.assign(remark="own").to_csv(path, index=False)
    found, direct = read_detections(path), read_detections(table)
    exposures, detections = observed
    assert found["remark"].tolist() == ["own"] * len(table)
    for name in ("obsID", "expID", "obsTime"):
        assert found[name].tolist() == table[name].tolist()
    for name in ("ra", "dec", "rmsRA", "rmsDec", "rmsCorr", "mag", "rmsMag"):
        np.testing.assert_allclose(found[name], table[name], rtol=1e-14, atol=1e-15)
    expected = EPOCH_TDB + 1800.0 * (FIRST + exposures.step[detections.exposure])
    np.testing.assert_allclose(found["tdb"], expected, rtol=0.0, atol=1e-6)
    np.testing.assert_array_equal(direct["tdb"], found["tdb"])
    assert "tdb" not in table


def changed(name, row, value):
    def change(table):
        table[name] = table[name].astype(object)
        table.loc[row, name] = value
        return table

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda table: table.drop(columns=["rmsCorr", "mag"]), r"columns rmsCorr, mag are missing"),
        (changed("dec", 2, np.nan), r"row 3: dec = nan must be a number between"),
        (changed("ra", 0, np.inf), r"row 1: ra = inf must be a finite number"),
        (changed("mag", 4, "faint"), r"row 5: mag = faint must be a finite number"),
        (changed("rmsDec", 1, 0.0), r"row 2: rmsDec = 0\.0 must be a positive number"),
        (changed("dec", 1, 90.5), r"row 2: dec = 90\.5 must be .* between -90 and 90"),
        (changed("rmsCorr", 3, -1.0), r"row 4: rmsCorr = -1\.0 must be .* between -1 and 1"),
        (changed("obsID", 3, "3-0-0"), r"row 4: obsID = 3-0-0 must not occur twice"),
        (changed("expID", 3, np.nan), r"row 4: expID = nan must be given"),
        (changed("obsTime", 2, "yesterday"), r"row 3: obsTime: 'yesterday' is not a date"),
        (changed("obsTime", 0, "1969-07-20T20:17:40Z"), r"row 1: obsTime: .* 1972"),
        (
            changed("obsTime", 5, "2016-12-31T23:00:00Z"),
            r"row 6: obsTime = 2016.* must not be before that of",
        ),
    ],
)
@pytest.mark.parametrize("file", [True, False])
def test_a_faulty_table_is_one_line_that_names_the_place(table, tmp_path, change, message, file):
    source, fault, place = change(table), ConfigurationError, "detections"
    if file:
        path = tmp_path / "own.csv"
        source.to_csv(path, index=False)
        source, fault, place = path, InputFileError, str(path)
    with pytest.raises(fault, match=message) as caught:
        read_detections(source)
    assert str(caught.value).startswith(place) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "content", [b"", b"\xff\xfe\x00\x81\n\x90", b"obsID,expID\n1,2\n1,2,3\n", None]
)
def test_an_unreadable_file_is_one_line(tmp_path, content):
    path = tmp_path / "own.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(CislunarError, match=r"own\.csv") as caught:
        read_detections(path)
    assert "\n" not in str(caught.value)


def test_the_index_of_a_table_does_not_matter(table):
    part = table.iloc[3:9]
    for given in (part, part.set_axis([7] * len(part))):
        pd.testing.assert_frame_equal(
            read_detections(given), read_detections(part.reset_index(drop=True))
        )


def test_names_of_stations_and_detections_stay_text(table, tmp_path):
    """Codes of the Minor Planet Center have leading zeros."""
    table["stn"], table["obsID"] = "003", [f"00{k}" for k in range(len(table))]
    path = tmp_path / "own.csv"
    table.to_csv(path, index=False)
    found = read_detections(path)
    assert found["stn"].tolist() == ["003"] * len(table)
    assert found["obsID"].tolist() == table["obsID"].tolist()
    assert read_detections(table.assign(stn=7))["stn"].tolist() == ["7"] * len(table)
