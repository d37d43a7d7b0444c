"""Repeated searches where one search may not have found all relevant modes (compiled). A fit is in
doubt if its best mode leaves residuals larger than the noise explains, if another mode is about as
likely, or if the best mode is none of those before the fit, so that the posterior had missed it.
The search is repeated, with all points from the prior, until the fit is clear, two consecutive
searches have not increased the evidence (Laplace's approximation), or the limit is reached."""

import numpy as np

from cislunar.compiled import njit_alloc
from cislunar.estimation.light_curves.hypotheses import anchor_of, search
from cislunar.estimation.light_curves.levenberg_marquardt import squared_distance
from cislunar.estimation.light_curves.light_curve import anchor_cost, cost

_CLEAR_WEIGHT = 0.95
"""Weight of the best mode from which on the fit is unambiguous."""

_LARGEST_EXCESS = 4.0
"""Standard deviations of chi squared above its mean from which on a fit is poor, and a mode is none
of those before."""

_LEAST_GAIN = 0.1
"""Gain of the log-evidence below which a search has found nothing new."""


@njit_alloc
def _evidence(hypotheses, data, model, before, roots):
    """Logarithm of the evidence, up to a constant, and whether the best mode fits poorly or is none
    of those `before` the fit (mode, n), if any, whose information has the Cholesky factors
    `roots`."""
    u, root, rows = hypotheses.u[0], hypotheses.root[0], data.shape[0]
    anchor, freedom = anchor_of(hypotheses, 0), model.noise_freedom
    value = cost(u, data, anchor, model, np.inf)
    misfit = value - anchor_cost(u, anchor)
    chi2 = 2.0 * misfit
    if freedom > 0.0:
        chi2 = freedom * (np.exp(2.0 * misfit / (freedom + rows)) - 1.0)
    log_det, least = 0.0, np.inf if before.shape[0] > 0 else 0.0
    for i in range(root.shape[0]):
        log_det += np.log(root[i, i])
    for j in range(before.shape[0]):
        least = min(least, squared_distance(u, before[j], roots[j]))
    suspect = _exceeds(chi2, rows) or _exceeds(least, u.shape[0])
    return -value - log_det - np.log(hypotheses.weight[0]), suspect


@njit_alloc
def _exceeds(chi2, freedom):
    """Whether chi squared is much larger than its degrees of freedom explain."""
    return chi2 > freedom + _LARGEST_EXCESS * np.sqrt(2.0 * freedom)


@njit_alloc
def search_until_clear(hypotheses, data, model, settings, rng):
    """`cislunar.estimation.light_curves.hypotheses.search` up to `settings.searches` times. The
    last entry of `count` is then whether the best mode is still suspect: it fits poorly, or no data
    have confirmed it since it was found. With one search it remains 0."""
    if settings.searches == 1:
        search(hypotheses, data, model, settings, rng, False)
        return
    live = hypotheses.count[0] if hypotheses.count[1] > 0 else 0  # the prior is no mode
    before = hypotheses.u[:live].copy(), hypotheses.root[:live].copy()
    evidence, suspect, without_gain = -np.inf, True, 0
    for number in range(settings.searches):
        if without_gain == 2 or not (suspect or hypotheses.weight[0] < _CLEAR_WEIGHT):
            break
        last = evidence
        search(hypotheses, data, model, settings, rng, number > 0)
        evidence, suspect = _evidence(hypotheses, data, model, *before)
        without_gain = 0 if evidence > last + _LEAST_GAIN else without_gain + 1
    hypotheses.count[2] = suspect
