"""Surveys of objects that appear, in shadows, with late data and errors of the observers."""

import numpy as np
import pytest
from test_survey import HOURS, N_OBJECTS, PROBLEM, SENSOR, SETTINGS, TRUTH, surveyed

from cislunar.constants import TIME_UNIT_S
from cislunar.detection import FALSE_ALARM
from cislunar.dynamics import EARTH_MOON, propagate
from cislunar.errors import ConfigurationError
from cislunar.estimation.navigation import ObserverErrors, ObserverErrorSigma
from cislunar.orbit_determination import fit_orbits, make_angles
from cislunar.survey import ObjectDensity, true_objects
from cislunar.survey.navigation import (
    RemainingErrors,
    calibrate,
    considered,
    corrected_angles,
    uncalibrated,
)
from cislunar.targets import DrawnManeuvers

STEP = PROBLEM.scene.step


def recorded(**given):
    blocks = []
    return surveyed(record=blocks.append, **given), blocks


def test_an_object_has_no_detection_and_no_maneuver_before_it_exists():
    hours = np.array([0.0, 3.0, 0.0, 2.0, 0.0, 5.9])
    drawn = DrawnManeuvers(smallest_m_s=1, largest_m_s=5, interval_hours=2)
    _, blocks = recorded(appears_hours=hours, truth=TRUTH._replace(drawn_maneuvers=(drawn,)))
    seen = 0
    for block in blocks:
        times = PROBLEM.scene.step_s * (block.first + block.exposures.step) / 3600.0
        own = block.origin != FALSE_ALARM
        seen += np.count_nonzero(own)
        assert np.all(times[block.detections.exposure[own]] >= hours[block.origin[own]])
    assert seen > 100
    flown = blocks[-1].maneuvers
    assert np.all(flown.start_s >= 3600.0 * hours[flown.target]) and flown.start_s.size > 6
    assert np.all(np.bincount(flown.target, minlength=N_OBJECTS)[[0, 2, 4]] == 3)
    with pytest.raises(ConfigurationError, match="appears_hours"):
        surveyed(appears_hours=[1.0])


def test_late_data_are_linked_late():
    result, blocks = recorded(settings=SETTINGS.model_copy(update={"latency_minutes": 60}))
    counts = np.cumsum([block.origin.size for block in blocks])
    # blocks of 20 minutes, of which the last three have not arrived
    expected = [counts[round(72 * day) - 1 - 3] for day in result.states["day"]]
    assert result.states["detections"].tolist() == expected and counts[-1] > expected[-1]
    for minutes in (30, 120):
        with pytest.raises(ConfigurationError, match=f"latency_minutes = {minutes}") as caught:
            surveyed(settings=SETTINGS.model_copy(update={"latency_minutes": minutes}))
        assert "\n" not in str(caught.value)


def test_shadows_dim_the_objects_that_are_observed(monkeypatch):
    """The same plan and noise with and without a dimming of half a magnitude."""
    settings = SETTINGS.model_copy(update={"duration_days": 1 / 72, "link_hours": 1 / 3})
    seen = []

    def half(place, sun, primaries):
        seen.append((place.shape, sun.shape, primaries.shape))
        return np.full(place.shape[:2], 0.5)

    monkeypatch.setattr(true_objects, "dimming", half)
    magnitudes = []
    for eclipse in (False, True):
        _, (block,) = recorded(settings=settings, eclipse=eclipse)
        own = block.origin != FALSE_ALARM
        keys = zip(block.detections.exposure[own], block.origin[own], strict=True)
        magnitudes.append(dict(zip(keys, block.detections.value[own, 0], strict=True)))
    clear, dim = magnitudes
    assert seen == [((N_OBJECTS, 21, 3), (21, 3), (21, 2, 3))] and len(dim) > 3
    for key, value in clear.items():
        if key in dim:
            assert dim[key] - value == pytest.approx(0.5, abs=1e-9)
        else:
            assert value + 0.5 > SENSOR.limiting_magnitude


def test_the_density_grows_by_objects_that_enter():
    states = PROBLEM.epoch
    density = ObjectDensity(states, np.ones(len(states)), 2.0, births_per_day=12.0)
    density.advance(6.0 * 3600.0 / TIME_UNIT_S)
    assert density.expected == pytest.approx(2.0 + 3.0, rel=1e-9)


def biased(seed, sigma):
    """Orbits fitted to angles that contain errors of their observers, and these errors."""
    rng, scene, noise = np.random.default_rng(seed), PROBLEM.scene, float(SENSOR.noise[1])
    minutes, n = np.arange(0, 60 * HOURS, 20), scene.observer_position.shape[0]
    error = sigma.constant()[:5] * rng.standard_normal((n, 5))
    rows = [(m, o, j) for m in minutes.tolist() for o in range(n) for j in range(N_OBJECTS)]
    minute, observer, which = np.array(rows).T
    paths = np.array([propagate(s, minutes * STEP, method="dop853") for s in PROBLEM.epoch])
    true = paths[which, np.searchsorted(minutes, minute), :3]
    assumed = scene.observer_position[observer, minute]
    way = np.einsum("nij,nj->ni", scene.observer_axes[minute], true - assumed - error[observer, :3])
    ra, dec = np.arctan2(way[:, 1], way[:, 0]), np.arctan2(way[:, 2], np.hypot(*way.T[:2]))
    ra = ra + error[observer, 3] + noise * rng.standard_normal(ra.size) / np.cos(dec)
    dec = dec + error[observer, 4] + noise * rng.standard_normal(ra.size)
    body = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=1)
    east = np.stack([-np.sin(ra), np.cos(ra), np.zeros_like(ra)], axis=1)
    axes = scene.observer_axes[minute]
    angles = make_angles(
        minute * STEP, observer, assumed, np.einsum("nji,nj->ni", axes, body), noise
    )
    basis = np.stack([east, np.cross(body, east)], axis=1)
    angles = angles._replace(basis=np.einsum("nji,naj->nai", axes, basis))
    members = [np.flatnonzero(which == j) for j in range(N_OBJECTS)]
    return angles, members, paths[:, -1], minutes[-1] * STEP, error


def test_confirmed_orbits_calibrate_the_observers():
    """Errors left over are those of the covariance, and far below the prior; orbits with the
    corrected angles are consistent."""
    sigma = ObserverErrorSigma(position_m=100, pointing_arcsec=3)
    squared, left, consistent = [], [], ([], [], [])
    for seed in range(3):
        angles, members, truth, epoch, error = biased(seed, sigma)
        found = uncalibrated(sigma, len(error))
        for number in range(3):
            used = corrected_angles(angles, PROBLEM.scene, found)
            fits = fit_orbits(used, members, truth, epoch, forces=EARTH_MOON)
            assert (fits.status == 0).all()
            remaining = RemainingErrors(angles, PROBLEM.scene, found)
            covariance = considered(fits, remaining, forces=EARTH_MOON).covariance
            nees = [
                (t - s) @ np.linalg.solve(p, t - s)
                for t, s, p in zip(truth, fits.state, covariance, strict=True)
            ]
            consistent[number].extend(nees)
            found = calibrate(fits, remaining, sigma, forces=EARTH_MOON)
        off = error - found.mean
        squared += [e @ np.linalg.solve(found.covariance[o, :, o], e) for o, e in enumerate(off)]
        left.append(np.rad2deg(off[:, 3:]) * 3600.0)
    n = len(squared)
    # errors of observers are correlated with each other, by which the mean varies more
    assert abs(np.mean(squared) / 5.0 - 1.0) < 6.0 * np.sqrt(2.0 / (5.0 * n))
    assert np.sqrt(np.mean(np.square(left))) < 0.75
    for nees in consistent:
        assert 0.4 < np.mean(nees) / 6.0 < 1.8


def test_the_calibration_is_the_joint_least_squares_solution():
    """Against one system of equations for orbits and observers, with derivatives by differences."""
    sigma = ObserverErrorSigma(position_m=100, pointing_arcsec=3)
    angles, members, truth, epoch, error = biased(7, sigma)
    start = uncalibrated(sigma, len(error))
    fits = fit_orbits(
        corrected_angles(angles, PROBLEM.scene, start), members, truth, epoch, forces=EARTH_MOON
    ).take([0, 1])
    noise = np.sqrt(angles.covariance[0, 0, 0])

    def residuals(states, errors):
        used = corrected_angles(angles, PROBLEM.scene, start._replace(mean=errors))
        out = []
        for state, rows in zip(states, members, strict=False):
            path = propagate(state, angles.time[rows] - epoch, start=epoch, method="dop853")
            way = path[:, :3] - used.observer_position[rows]
            along = np.einsum("nc,nc->n", way, used.direction[rows])[:, None]
            out.append(np.einsum("nac,nc->na", used.basis[rows], way) / along / noise)
        return np.concatenate(out).ravel()

    states, errors = fits.state, np.zeros_like(error)
    base, columns = residuals(states, errors), []
    for array, size in ((states, 1e-7 * np.ones(6)), (errors, sigma.constant()[:5])):
        for index in np.ndindex(array.shape):
            ends = []
            for sign in (1.0, -1.0):
                changed = array.copy()
                changed[index] += sign * size[index[1]]
                pair = (changed, errors) if array is states else (states, changed)
                ends.append(residuals(*pair))
            columns.append((ends[0] - ends[1]) / 2.0)
    design = np.array(columns).T
    n = errors.size
    prior = np.concatenate([np.zeros((n, 12)), np.eye(n)], axis=1)
    whole = np.concatenate([design, prior])
    scale = np.linalg.norm(whole, axis=0)
    step = np.linalg.lstsq(whole / scale, -np.concatenate([base, np.zeros(n)]), rcond=None)[0]
    expected = (step / scale)[12:].reshape(errors.shape) * sigma.constant()[:5]
    remaining = RemainingErrors(angles, PROBLEM.scene, start)
    found = calibrate(fits, remaining, sigma, forces=EARTH_MOON)
    spread = np.sqrt(np.diag(found.covariance.reshape(n, n))).reshape(errors.shape)
    assert np.abs((found.mean - expected) / spread).max() < 0.05


def test_a_survey_with_errors_of_the_observers_is_consistent_if_they_are_calibrated():
    truth = TRUTH._replace(observer_sigma=ObserverErrorSigma(position_m=100, pointing_arcsec=3))
    nees = {}
    for treatment in ("none", "considered", "calibrated"):
        errors = ObserverErrors(position_m=100, pointing_arcsec=3, treatment=treatment)
        end = surveyed(truth=truth, observer_errors=errors).states.iloc[-1]
        nees[treatment] = end["nees"], end["right"]
    assert nees["none"][0] > 60.0
    for treatment in ("considered", "calibrated"):
        assert 1.0 < nees[treatment][0] < 15.0 and nees[treatment][1] >= 3
