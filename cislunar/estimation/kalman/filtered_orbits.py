"""Estimated orbits in the state of a filter, and their changes from outside.

A state is a NamedTuple with `translation` (target, 6) and `root` (target, n, n), lower Cholesky
factors of covariances whose last six rows are those of position and velocity. `failed` (target,) is
HEALTHY where an estimate goes on.
"""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.estimation.estimator import HEALTHY, OrbitEstimates
from cislunar.estimation.kalman.gaussian_mixture import GaussianMixture, restart_mixtures
from cislunar.estimation.track_arrays import replaced_roots, widened_roots
from cislunar.runtime import Array

State = TypeVar("State", bound=Any)


def orbits_of(index: int, state: Any, failed: NDArray) -> OrbitEstimates:
    """Orbits of a state at a time index, see `Estimator.orbits`."""
    lower, translation = state.root[:, -6:], state.translation.copy()
    translation[failed != HEALTHY] = np.nan
    return OrbitEstimates(index, translation, lower @ np.swapaxes(lower, 1, 2))


def corrected_orbits(
    state: State, mixture: GaussianMixture, failed: NDArray, shift: Array, covariance: Array
) -> tuple[State, NDArray[np.bool_]]:
    """State with corrected orbits and which they are, see `Estimator.correct`."""
    # a gap keeps the Gaussian of its begin for a later split
    single = (failed == HEALTHY) & (mixture.count == 0) & (mixture.since < 0)
    root = widened_roots(state.root, covariance, single)
    translation = state.translation + np.where(single[:, None], shift, 0.0)
    return state._replace(root=root, translation=translation), single


def with_orbits(
    state: State,
    mixture: GaussianMixture,
    targets: ArrayLike,
    translation: Array,
    covariance: Array,
) -> State:
    """State with other orbits of some targets, see `Estimator.replace_orbits`. Translations and
    mixtures are changed in place; the mixtures begin anew."""
    root = replaced_roots(state.root, covariance, targets)
    state.translation[targets] = translation
    restart_mixtures(mixture, targets)
    return state._replace(root=root)
