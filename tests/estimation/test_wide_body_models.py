"""Evidence for the models of a body whose shape or reflection law is uncertain."""

import numpy as np
import pytest
from oracles.light_curves import FACETS
from oracles.reflection import lambert_phong_magnitude
from simulated_light_curves import as_believed, simulated

from cislunar.estimation.light_curves.model_selection import selection
from cislunar.estimation.light_curves.model_selection.body_models import (
    Candidate,
    mixture,
    wide_needed,
)
from cislunar.estimation.light_curves.model_selection.correlated import Minimum, ModelError
from cislunar.estimation.light_curves.model_selection.settings import ModelSelectionSettings
from cislunar.photometry.materials import Material


def _candidate(body, log_evidence, u=0.0):
    minimum = Minimum(np.full(6, u), np.eye(6), log_evidence)
    return Candidate(body, ModelError(0.0, 1.0), minimum)


@pytest.mark.parametrize(
    ("exact", "wide", "needed"),
    [([-9.0, -10.0], [-7.0], False), ([-9.0, -10.0], [-20.0, -5.5], True), ([-9.0], [], False)],
)
def test_a_wide_model_is_needed_with_twenty_times_the_evidence(exact, wide, needed):
    found = [_candidate("material", each) for each in exact]
    found += [_candidate("other law", each) for each in wide]
    assert wide_needed(found) == needed


def test_a_mixture_has_the_likely_candidates_with_their_shares():
    found = [_candidate("known", np.log(each)) for each in (0.2, 0.5, 1e-9, 0.3)]
    likely, weight = mixture([each.with_share(0.1) for each in found])
    np.testing.assert_allclose(weight, [0.5, 0.3, 0.2])
    np.testing.assert_allclose([each.log_evidence for each in likely], np.log(0.1 * weight))


def _lambert_phong(attitudes, data):
    return lambert_phong_magnitude(attitudes, data, FACETS, Material())


def _nearly_as_believed(attitudes, data):
    """15 % of the difference to the Lambert-Phong law."""
    believed, other = as_believed(attitudes, data), _lambert_phong(attitudes, data)
    seen = np.isfinite(believed) & np.isfinite(other)
    return np.where(seen, 0.85 * believed + 0.15 * np.where(seen, other, 0.0), np.inf)


@pytest.fixture
def passing(monkeypatch):
    """Residuals that pass the tests, as those of few magnitudes may."""
    monkeypatch.setattr(selection, "explains", lambda *_: True)
    return monkeypatch


def test_strong_evidence_for_a_wide_model_brings_a_model_error(passing):
    data, model, _, _ = simulated(_lambert_phong, 1)
    settings = ModelSelectionSettings(effort=1)
    with passing.context() as without:
        without.setattr(selection, "wide_needed", lambda _: False)
        first = selection.select_model(data[:80], model, np.random.default_rng(1), settings)
    assert first.model_error_mag == 0.0 and first.tempering == 1.0
    selected = selection.select_model(data[:80], model, np.random.default_rng(1), settings)
    assert selected.model_error_mag > 0.02 and selected.tempering < 0.9
    none = [
        max(e.log_evidence for e in each.untempered if e.error.tau == 0.0)
        for each in (first, selected)
    ]
    assert none[1] == pytest.approx(none[0] - np.log(13.0))  # the prior of "no model error"


def test_strong_evidence_in_a_grown_light_curve_leads_to_a_search(passing):
    data, model, _, _ = simulated(_nearly_as_believed, 1)
    settings = ModelSelectionSettings(effort=1)
    first = selection.select_model(data[:60], model, np.random.default_rng(1), settings)
    assert first.wide and not wide_needed(first.untempered)
    for rows, needed in ((75, False), (96, True)):
        grown, kept = selection.refitted(first, data[:rows], model, None, settings)
        assert {each.body for each in grown.untempered} & {"known", "material"}
        assert wide_needed(grown.untempered) == needed
        assert kept != needed
