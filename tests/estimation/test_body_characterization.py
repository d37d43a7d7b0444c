"""Spin, amplitude and area times albedo from the light curve of a body of unknown attitude."""

import numpy as np
import pytest
from oracles.light_curves import FACETS
from oracles.reflection import lambert_phong_magnitude
from simulated_light_curves import observed_rows, rotation, rotation_at, simulated

from cislunar.attitude.quaternion import attitude_matrix
from cislunar.estimation.light_curves.model_selection.characterization import (
    AMBIGUOUS,
    UNIQUE,
    UNKNOWN_BODY,
    amplitude_of,
    area_albedo_of,
    attitude_status,
    characterize,
)
from cislunar.estimation.light_curves.model_selection.selection import select_model
from cislunar.estimation.light_curves.row_blocks import RANGE, SUN, TIME, VIEW
from cislunar.photometry.materials import Material


def test_what_is_known_without_an_attitude():
    """Intervals contain the truth, and an unknown frame widens the attitude, not the rate."""
    inside = []
    for seed in range(3):
        data, model, _, u = simulated(
            lambda attitudes, rows: lambert_phong_magnitude(attitudes, rows, FACETS, Material()),
            seed,
        )
        selected = select_model(data, model, np.random.default_rng(1))
        found = characterize(selected, data, model, np.random.default_rng(2))
        attitudes, omega = rotation(model, u, data[:, TIME])
        clean = lambert_phong_magnitude(attitudes, data, FACETS, Material())
        axis = attitude_matrix(rotation(model, u, [0.0])[0][0]).T @ omega / np.linalg.norm(omega)
        inside += [
            found.spin_period_h.contains(2.0 * np.pi / np.linalg.norm(omega) / 3600.0),
            np.rad2deg(np.arccos(axis @ found.spin_axis)) < found.spin_axis_radius_deg,
            found.amplitude_mag.contains(amplitude_of(clean, data, False)),
            found.area_albedo_m2.contains(area_albedo_of(clean, data, False)),
        ]
        assert found.spin_period_h.high / found.spin_period_h.low < 1.05  # prior: a fifth
        assert found.status in (UNIQUE, AMBIGUOUS)
    assert np.sum(inside) >= 10
    wide = selected._replace(log_evidence={**selected.log_evidence, "large deviations": 1e6})
    assert attitude_status(wide, model) == UNKNOWN_BODY
    narrow, broad = (rotation_at(each, model, 7200.0) for each in (selected, wide))
    added = np.diag(broad.covariance - narrow.covariance)[:3]
    np.testing.assert_allclose(np.rad2deg(np.sqrt(added)), 5.0, rtol=0.03)
    assert attitude_status(selected._replace(model_error_mag=0.3), model) == UNKNOWN_BODY
    unknown = characterize(wide, data, model, np.random.default_rng(2))
    usual, widened = (np.log(each.spin_period_h) for each in (found, unknown))
    np.testing.assert_allclose(widened - widened[0], 2.7 * (usual - usual[0]), rtol=1e-6)
    assert unknown.spin_axis_radius_deg == pytest.approx(1.8 * found.spin_axis_radius_deg)


def test_area_times_albedo_is_that_of_a_sphere():
    """A diffuse sphere of known radius, by the library's own magnitudes of spheres."""
    data = observed_rows(50)
    phase = np.arccos(np.sum(data[:, SUN] * data[:, VIEW], axis=1))
    light = 2.0 / 3.0 * 0.4 * 1.5**2 * (np.sin(phase) + (np.pi - phase) * np.cos(phase))
    magnitude = -26.74 - 2.5 * np.log10(light / (np.pi * data[:, RANGE] ** 2))
    assert area_albedo_of(magnitude, data, False) == pytest.approx(0.4 * np.pi * 1.5**2, rel=1e-9)
    assert amplitude_of(magnitude, data, False) == pytest.approx(0.0, abs=1e-9)
    faint = magnitude + 2.5 * np.log10(4.0 * np.pi)
    assert area_albedo_of(faint, data, True) == pytest.approx(0.4 * np.pi * 1.5**2, rel=1e-9)
