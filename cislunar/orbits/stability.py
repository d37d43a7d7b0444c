"""Linear stability of periodic orbits (Paul & Fan, section 3)."""

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import MU
from cislunar.dynamics import CR3BP, primary_distances, propagate, propagate_stm
from cislunar.runtime import Array
from cislunar.runtime.arguments import number_of

_SAMPLES = 256


def farthest_state(state: ArrayLike, period: float, mu: float = MU) -> Array:
    """State of an orbit at which the distance to the nearest primary is largest, or the given
    state, (6,), nondimensional, rotating frame. The eigenvalues of the monodromy matrix do not
    depend on the initial point, but their roundoff does: started at a close approach, the same
    orbit loses up to six digits."""
    times = period * (np.arange(_SAMPLES) / _SAMPLES - 0.5)
    times = np.append(0.0, times[times != 0.0])
    states = propagate(state, times, forces=CR3BP(mu), method="dop853")
    nearest = np.minimum(*primary_distances(states, mu))
    return states[np.argmax(nearest)]


def monodromy(state: ArrayLike, period: float, mu: float = MU) -> Array:
    """State transition matrix (6, 6) over a period, from the point farthest from the primaries."""
    return propagate_stm(farthest_state(state, period, mu), period, forces=CR3BP(mu))[1]


def stability_index(state: ArrayLike, period: float, mu: float = MU) -> float:
    """Stability index (|eta| + 1/|eta|)/2 of the monodromy eigenvalue eta of largest modulus.

    Parameters
    ----------
    state : array_like, shape (6,)
        State on the orbit, nondimensional, rotating frame.
    period : float
        Period, nondimensional.
    mu : float
        Mass ratio.

    Returns
    -------
    float
        1 for a linearly stable orbit and larger for an unstable one.

    Raises
    ------
    ConfigurationError, ConvergenceError
        If the period is not positive, or the orbit cannot be propagated; see
        `cislunar.dynamics.propagation.propagate`.
    """
    period = number_of("period", period, positive=True)
    # The unit pair of eigenvalues is defective and splits numerically; the index is even in
    # log|eta|, so that the split enters only squared and no eigenvalue has to be singled out.
    largest = float(np.abs(np.linalg.eigvals(monodromy(state, period, mu))).max())
    return max(1.0, 0.5 * (largest + 1.0 / largest))
