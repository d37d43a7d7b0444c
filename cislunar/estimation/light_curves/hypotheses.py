"""The modes of a light curve's posterior: how they are found, kept and weighted (docs/attitude.md).

A `Hypotheses` has the best minima of the cost, each with its Gauss-Newton information H. The
posterior is a mixture of Gaussians N(u_j, H_j^-1) with Laplace's weights (Tierney & Kadane 1986)
log w_j = -cost(u_j) - log(det H_j) / 2 + constant.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import copy_into, njit_alloc, njit_noalloc
from cislunar.estimation.light_curves.levenberg_marquardt import (
    INITIAL_DAMPING,
    WARM_DAMPING,
    is_known,
    refine,
)
from cislunar.estimation.light_curves.light_curve import (
    Anchor,
    anchor_cost,
    cost_and_derivatives,
    cost_with,
    initial_state,
    propagated_parameters,
)
from cislunar.estimation.light_curves.row_blocks import ROTATION, make_cost_work
from cislunar.estimation.triangular import cholesky, solve_lower, solve_transposed
from cislunar.runtime import Array

_FIRST_ROWS = 20
"""Number of rows below which all starts come from the prior."""

_SCREENING_ROWS = 96
"""Number of rows of a light curve on which starts are screened."""

_AROUND, _ROTATION_AFRESH, _AFRESH = range(3)
"""Places of random points: around a live mode; the rotation from the prior and the other parameters
from around a live mode; all parameters from the prior."""


class Hypotheses(NamedTuple):
    """Modes of one target, best first; only the first ``count[0]`` are live.
    `u` (mode, n): parameters, in prior standard deviations. `root` (mode, n, n): lower Cholesky
    factors of their information H. `weight` (mode,): sum to 1 over the live modes. `anchor_mean`
    (mode, n), `anchor_information` (mode, n, n), `anchor_offset` (mode, 1): information of data no
    longer kept, see `cislunar.estimation.light_curves.light_curve.Anchor`. `count`: numbers of live
    modes and of searches, and whether the last fit is in doubt, see
    `cislunar.estimation.light_curves.effort`."""

    u: Array
    root: Array
    weight: Array
    anchor_mean: Array
    anchor_information: Array
    anchor_offset: Array
    count: NDArray[np.int64]


def prior_hypotheses(modes: int, size: int = ROTATION) -> Hypotheses:
    """The prior N(0, I) as the only mode, with memory for `modes` modes."""
    identity = np.tile(np.eye(size), (modes, 1, 1))
    weight = np.zeros(modes)
    weight[0] = 1.0
    return Hypotheses(
        np.zeros((modes, size)),
        identity.copy(),
        weight,
        np.zeros((modes, size)),
        identity.copy(),
        np.zeros((modes, 1)),
        np.array([1, 0, 0]),
    )


@njit_alloc
def anchor_of(hypotheses, j):
    """Anchor of a mode, which represents data no longer kept."""
    return Anchor(
        hypotheses.anchor_mean[j], hypotheses.anchor_information[j], hypotheses.anchor_offset[j]
    )


@njit_noalloc
def _draw_mode(hypotheses, rng):
    """Draw a live mode by weight."""
    left = rng.random()
    for j in range(hypotheses.count[0] - 1):
        left -= hypotheses.weight[j]
        if left < 0.0:
            return j
    return hypotheses.count[0] - 1


@njit_alloc
def _draw(hypotheses, settings, place, rng, root, u):
    """Draw a point around a mode or from its anchor, the prior; returns the mode. `place` is
    `_AROUND`, `_ROTATION_AFRESH` or `_AFRESH`."""
    j = _draw_mode(hypotheses, rng)
    for i in range(u.shape[0]):
        u[i] = rng.standard_normal()
    if place != _AROUND:
        root[:, :] = hypotheses.anchor_information[j]
        cholesky(root)
        solve_transposed(root, u)
        u += hypotheses.anchor_mean[j]
    else:
        solve_transposed(hypotheses.root[j], u)
        u[:ROTATION] *= settings.spread
        u += hypotheses.u[j]
    if place == _ROTATION_AFRESH and u.shape[0] > ROTATION:
        near = np.empty(u.shape[0])
        for i in range(near.shape[0]):
            near[i] = rng.standard_normal()
        solve_transposed(hypotheses.root[j], near)
        u[ROTATION:] = hypotheses.u[j, ROTATION:] + near[ROTATION:]
    return j


@njit_alloc
def _lowest_of_pool(hypotheses, data, model, settings, draws, starts, place, rng, points, origins):
    """The `starts` of lowest cost of some draws, into `points` and `origins`; their number. Draws
    within the merging distance of a live mode are skipped, since they converge to that mode."""
    costs = np.full(starts, np.inf)
    size = hypotheses.u.shape[1]
    u, root = np.empty(size), np.empty((size, size))
    work, filled, live = make_cost_work(size), 0, hypotheses.count[0]
    for _ in range(draws):
        j = _draw(hypotheses, settings, place, rng, root, u)
        if is_known(u, hypotheses.u[:live], hypotheses.root[:live], settings.merge_distance):
            continue
        anchor = anchor_of(hypotheses, j)
        value = cost_with(work, u, data, anchor, model, costs[starts - 1])
        if not value < costs[starts - 1]:
            continue
        rank = min(filled, starts - 1)
        while rank > 0 and value < costs[rank - 1]:
            costs[rank] = costs[rank - 1]
            points[rank] = points[rank - 1]
            origins[rank] = origins[rank - 1]
            rank -= 1
        costs[rank] = value
        points[rank] = u
        origins[rank] = j
        filled = min(filled + 1, starts)
    return filled


@njit_noalloc
def _pool(hypotheses, data, model, settings, starts, prior, afresh, rng, points, origins):
    """Starts from a random pool, all from the `prior` or half from around the live modes; their
    number."""
    near = 0 if prior else starts // 2
    draws = settings.pool if prior else settings.pool // 2
    place = _AFRESH if afresh else _ROTATION_AFRESH
    drawn = 0
    for where, number in ((place, starts - near), (_AROUND, near)):
        if number > 0:
            out = points[drawn:], origins[drawn:]
            drawn += _lowest_of_pool(
                hypotheses, data, model, settings, draws, number, where, rng, *out
            )
    return drawn


@njit_noalloc
def _log_weight(value, information, root):
    """Laplace's log weight of a minimum; -inf if it is none. `root` receives the factor of H."""
    copy_into(root, information)
    if not (np.isfinite(value) and cholesky(root)):
        return -np.inf
    log_det = 0.0
    for i in range(root.shape[0]):
        log_det += np.log(root[i, i])
    return -value - log_det


@njit_alloc
def _select(hypotheses, settings, found, roots, log_weights, origins):
    """Replace the live modes by the best of the minima found."""
    order = np.argsort(-log_weights, kind="mergesort")  # stable
    best = log_weights[order[0]]
    means = hypotheses.anchor_mean.copy()
    informations = hypotheses.anchor_information.copy()
    offsets = hypotheses.anchor_offset.copy()
    kept, total = 0, 0.0
    for candidate in order:
        if kept == settings.modes or log_weights[candidate] < best - settings.drop:
            break
        u, root = hypotheses.u[:kept], hypotheses.root[:kept]
        if is_known(found[candidate], u, root, settings.merge_distance):
            continue
        origin = origins[candidate]
        hypotheses.u[kept] = found[candidate]
        hypotheses.root[kept] = roots[candidate]
        hypotheses.weight[kept] = np.exp(log_weights[candidate] - best)
        hypotheses.anchor_mean[kept] = means[origin]
        hypotheses.anchor_information[kept] = informations[origin]
        hypotheses.anchor_offset[kept] = offsets[origin]
        total += hypotheses.weight[kept]
        kept += 1
    hypotheses.weight[:kept] /= total
    hypotheses.weight[kept:] = 0.0
    hypotheses.count[0] = kept


@njit_alloc
def _thinned(data):
    """A thinned light curve, long enough to find basins of attraction."""
    every = max(1, data.shape[0] // _SCREENING_ROWS)
    if every == 1:
        return data
    thin = np.empty(((data.shape[0] + every - 1) // every, data.shape[1]))
    for i in range(thin.shape[0]):
        thin[i] = data[i * every]
    return thin


@njit_alloc
def search(hypotheses, data, model, settings, rng, afresh):
    """Find the modes of the posterior given the whole light curve. The live modes are refined, and
    so are the points of lowest cost from a random pool, first on a thinned light curve. The minima
    are sorted by weight and merged, and the best are kept. All points of a search `afresh` come
    from the prior, and so do their rotations while the light curve is short."""
    live, size = hypotheses.count[0], hypotheses.u.shape[1]
    prior = afresh or data.shape[0] < _FIRST_ROWS
    starts = settings.first_starts if prior else settings.starts
    found, origins = np.empty((live + starts, size)), np.empty(live + starts, np.int64)
    thin, total = _thinned(data), live
    if starts > 0:
        out = found[live:], origins[live:]
        total += _pool(hypotheses, thin, model, settings, starts, prior, afresh, rng, *out)
    roots, log_weights = np.empty((total, size, size)), np.empty(total)
    information, distance = np.empty((size, size)), settings.merge_distance
    kept, u = 0, np.empty(size)
    for i in range(total):
        origin = i if i < live else origins[i]
        u[:] = hypotheses.u[i] if i < live else found[i]
        anchor = anchor_of(hypotheses, origin)
        iterations = settings.warm_iterations if i < live else settings.iterations
        damping = WARM_DAMPING if i < live and size > ROTATION else INITIAL_DAMPING
        heeded = kept if i >= live else 0
        known = (found[:heeded], roots[:heeded], distance)
        value = 0.0
        if i >= live and thin.shape[0] < data.shape[0]:
            value = refine(u, thin, anchor, model, damping, iterations, information, *known)
        if value < np.inf:
            value = refine(u, data, anchor, model, damping, iterations, information, *known)
        log_weight = _log_weight(value, information, roots[kept])
        if log_weight > -np.inf:
            found[kept], origins[kept], log_weights[kept] = u, origin, log_weight
            kept += 1
    if kept > 0:
        _select(
            hypotheses, settings, found[:kept], roots[:kept], log_weights[:kept], origins[:kept]
        )
    hypotheses.count[1] += 1


@njit_alloc
def condense(hypotheses, data, model, memory):
    """Condense part of a light curve (n, ROW_COLUMNS) into the anchors, so that its rows can be
    dropped. Around each live mode the cost of the data is replaced by its second-order expansion.
    The information of an anchor beyond the prior N(0, I) then fades by the factor `memory`, with
    its cost at the mode unchanged."""
    size = hypotheses.u.shape[1]
    gradient, root = np.empty(size), np.empty((size, size))
    information = np.empty((size, size))
    for j in range(hypotheses.count[0]):
        u, anchor = hypotheses.u[j], anchor_of(hypotheses, j)
        value = cost_and_derivatives(u, data, anchor, model, gradient, information)
        # the minimum of the expansion of anchor and data about u
        root[:, :] = information
        if not (np.isfinite(value) and cholesky(root)):
            hypotheses.anchor_offset[j, 0] = np.inf  # it does not represent the dropped data
            continue
        step = -gradient
        solve_lower(root, step)
        solve_transposed(root, step)
        mean = u + step
        # with Lambda = I + m (H - I) and Lambda mean' = m H mean; m = 1 changes nothing
        pull = memory * (information @ mean)
        anchor.information[:, :] = memory * information
        for i in range(size):
            anchor.information[i, i] += 1.0 - memory
        root[:, :] = anchor.information
        cholesky(root)
        solve_lower(root, pull)
        solve_transposed(root, pull)
        anchor.mean[:] = pull
        anchor.offset[0] += value - anchor_cost(u, anchor)


@njit_alloc
def _carried_root(root, carried, scale):
    """Root of the covariance of the first `carried` parameters of a mode, times `scale`. `root` is
    the factor L of the information H. The result is L^-T if there are no other parameters, else the
    Cholesky factor of the block of H^-1."""
    size = root.shape[0]
    inverse, column = np.empty((size, size)), np.empty(size)
    for i in range(size):
        column[:] = 0.0
        column[i] = scale
        solve_transposed(root, column)
        inverse[:, i] = column
    if carried == size:
        return inverse
    covariance = np.zeros((carried, carried))
    for a in range(carried):
        for b in range(a + 1):
            for i in range(size):
                covariance[a, b] += inverse[a, i] * inverse[b, i]
    cholesky(covariance)
    return covariance


@njit_alloc
def mixture_points(hypotheses, model, quaternion, omega, weight, deviations):
    """Equally weighted points of every live mode with its mean and covariance; their number. They
    are ``u_j +- sqrt(c) L_j e_i`` for the c parameters on which attitudes at other times depend,
    with ``L_j L_j^T`` their covariance in H_j^-1. Outputs at the epoch are attitude (2 c mode, 4),
    rate (2 c mode, 3) and rotation deviations (2 c mode, c - 6)."""
    carried = propagated_parameters(model)
    from_u = np.empty(carried)
    scale = np.sqrt(float(carried))
    number = 0
    for j in range(hypotheses.count[0]):
        columns = _carried_root(hypotheses.root[j], carried, scale)
        for i in range(carried):
            for sign in (1.0, -1.0):
                for c in range(carried):
                    from_u[c] = hypotheses.u[j, c] + sign * columns[c, i]
                initial_state(from_u, model, quaternion[number], omega[number])
                for c in range(ROTATION, carried):
                    deviations[number, c - ROTATION] = model.sigma[c] * from_u[c]
                weight[number] = hypotheses.weight[j] / (2 * carried)
                number += 1
    return number
