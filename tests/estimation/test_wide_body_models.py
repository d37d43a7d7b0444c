"""Evidence for the models of a body whose shape or reflection law is uncertain."""

from functools import partial

import numpy as np
import pytest
from oracles.light_curves import FACETS
from oracles.reflection import lambert_phong_magnitude
from simulated_light_curves import simulated

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


def test_strong_evidence_for_a_wide_model_brings_a_model_error(monkeypatch):
    """A Lambert-Phong body whose residuals pass the tests, as those of few magnitudes may."""
    monkeypatch.setattr(selection, "explains", lambda *_: True)
    magnitude = partial(lambert_phong_magnitude, facets=FACETS, material=Material())
    data, model, _, _ = simulated(magnitude, 1)
    settings = ModelSelectionSettings(effort=1)
    with monkeypatch.context() as without:
        without.setattr(selection, "wide_needed", lambda _: False)
        first = selection.select_model(data[:80], model, np.random.default_rng(1), settings)
        given = first, data[:110], model, np.random.default_rng(2), settings
        assert selection.refitted(*given)[1]
    assert first.model_error_mag == 0.0 and first.tempering == 1.0
    selected = selection.select_model(data[:80], model, np.random.default_rng(1), settings)
    assert selected.model_error_mag > 0.0 and selected.tempering < 1.0
    assert any(each.error.tau > 0.0 for each in selected.untempered)
    # grown light curves are searched once more for the same reason
    assert not selection.refitted(*given)[1]
