"""Repeated searches where one search may not have found all relevant modes (compiled). A fit is in
doubt if its best mode leaves residuals larger than the noise explains, or if another mode is about
as likely. The search is repeated until the fit is clear, two consecutive searches have not
increased the evidence (Laplace's approximation), or the limit is reached."""

import numpy as np

from cislunar.compiled import njit_alloc, njit_noalloc
from cislunar.estimation.light_curves.hypotheses import anchor_of, search
from cislunar.estimation.light_curves.light_curve import anchor_cost, cost

_CLEAR_WEIGHT = 0.95
"""Weight of the best mode from which on the fit is unambiguous."""

_LARGEST_EXCESS = 4.0
"""Standard deviations of chi squared above its mean from which on a fit is poor."""

_LEAST_GAIN = 0.1
"""Gain of the log-evidence below which a search has found nothing new."""


@njit_alloc
def _evidence(hypotheses, data, model):
    """Logarithm of the evidence, up to a constant, and whether the best mode fits poorly."""
    u, root, rows = hypotheses.u[0], hypotheses.root[0], data.shape[0]
    anchor, freedom = anchor_of(hypotheses, 0), model.noise_freedom
    value = cost(u, data, anchor, model, np.inf)
    misfit = value - anchor_cost(u, anchor)
    chi2 = 2.0 * misfit
    if freedom > 0.0:
        chi2 = freedom * (np.exp(2.0 * misfit / (freedom + rows)) - 1.0)
    log_det = 0.0
    for i in range(root.shape[0]):
        log_det += np.log(root[i, i])
    poor = chi2 > rows + _LARGEST_EXCESS * np.sqrt(2.0 * rows)
    return -value - log_det - np.log(hypotheses.weight[0]), poor


@njit_noalloc
def search_until_clear(hypotheses, data, model, settings, rng):
    """`cislunar.estimation.light_curves.hypotheses.search` up to `settings.searches` times."""
    search(hypotheses, data, model, settings, rng)
    if settings.searches == 1:
        return
    evidence, poor = _evidence(hypotheses, data, model)
    without_gain = 0
    for _ in range(1, settings.searches):
        if without_gain == 2 or not (poor or hypotheses.weight[0] < _CLEAR_WEIGHT):
            return
        before = evidence
        search(hypotheses, data, model, settings, rng)
        evidence, poor = _evidence(hypotheses, data, model)
        without_gain = 0 if evidence > before + _LEAST_GAIN else without_gain + 1
