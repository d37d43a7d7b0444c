"""What it takes to stay on a periodic orbit: the velocity that cancels its unstable deviations."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import LENGTH_UNIT_KM, MU, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics.cr3bp import CR3BP
from cislunar.dynamics.propagation import propagate_stm
from cislunar.errors import ConfigurationError
from cislunar.orbits.stability import farthest_state

Array = NDArray[np.float64]

_PLACES = 64  # of manoeuvres on the orbit
_STABLE = (
    1e-3  # modulus beyond 1 from which an eigenvalue is unstable: the unit pair splits by 1e-5
)
_YEAR_S = 365.25 * SECONDS_PER_DAY
_METRES_PER_SECOND = 1e3 * LENGTH_UNIT_KM / TIME_UNIT_S


def unstable_modes(state: ArrayLike, period: float, mu: float = MU) -> tuple[Array, Array]:
    """Unstable part of a deviation around a periodic orbit, and how it grows in a period.

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
    modes : ndarray, shape (place, mode, 6)
        Rows that a deviation at equally spaced places is multiplied with to have its unstable
        coordinates. Along a free flight these do not change until the orbit closes. No modes if no
        eigenvalue of the monodromy matrix exceeds 1 in modulus by 1e-3.
    growth : ndarray, shape (mode, mode)
        Factor of the coordinates where the orbit closes.

    Raises
    ------
    ConvergenceError
        If the propagation fails.
    """
    times = period * np.arange(1, _PLACES + 1) / _PLACES
    start = farthest_state(state, period, mu)
    to_place = propagate_stm(start, times, forces=CR3BP(mu))[1]
    values, vectors = np.linalg.eig(to_place[-1].T)
    unstable = vectors[:, (np.abs(values) > 1.0 + _STABLE) & (values.imag >= 0.0)]
    rows = np.array([part for v in unstable.T for part in (v.real, v.imag) if part.any()])
    rows = rows.reshape(-1, 6)
    growth = rows @ to_place[-1] @ np.linalg.pinv(rows)
    begin = np.concatenate([np.eye(6)[None], to_place[:-1]])
    return rows @ np.linalg.inv(begin), growth


def station_keeping_m_s(
    state: ArrayLike,
    period: float,
    *,
    position_km: float = 1.0,
    velocity_m_s: float = 0.01,
    least_days: float = 1.0,
    most_days: float = 60.0,
    mu: float = MU,
) -> float:
    """Estimate the velocity a year that keeps a satellite on an unstable periodic orbit.

    A manoeuvre cancels the unstable part of the estimated deviation by the least change of
    velocity, as in Floquet mode control (C. Simo, G. Gomez, J. Llibre, R. Martinez and
    J. Rodriguez, Acta Astronautica 15, 1987). With the rows W of `unstable_modes` at the place of
    the manoeuvre, V their part along the velocity, W' at the one before, and the covariance S of
    independent errors of the estimate, its mean square is the trace of

        V^+ (W' S W'^T + W S W^T) V^+^T :

    the error left at the manoeuvre before, grown on the way, and the new one. Manoeuvres are
    equally spaced, by the whole number of 64ths of a period that makes the mean over the orbit of
    the root mean squares, times the manoeuvres in a year, least.

    Limits. Linear about the orbit, in the circular problem and without errors of execution or
    solar pressure. A deviation that does not grow exponentially is not cancelled, so that a
    linearly stable orbit costs nothing. It orders orbits rather than sizes tanks.

    Parameters
    ----------
    state : array_like, shape (6,)
        State on the orbit, nondimensional, rotating frame.
    period : float
        Period, nondimensional.
    position_km, velocity_m_s : float
        Standard deviations of each component of the estimate at a manoeuvre.
    least_days, most_days : float
        Shortest and longest time between manoeuvres.
    mu : float
        Mass ratio.

    Returns
    -------
    float
        m/s a year; 0 for a linearly stable orbit.

    Raises
    ------
    ConfigurationError
        If an error or a time is not positive.
    ConvergenceError
        If the propagation fails.
    """
    given = {"position_km": position_km, "velocity_m_s": velocity_m_s, "least_days": least_days}
    for name, value in given.items():
        if not value > 0.0:
            raise ConfigurationError(f"{name} = {value} must be positive")
    if not most_days >= least_days:
        raise ConfigurationError(f"most_days = {most_days} must be at least {least_days}")
    modes, growth = unstable_modes(state, period, mu)
    if growth.size == 0:
        return 0.0
    sigma = np.repeat([position_km / LENGTH_UNIT_KM, velocity_m_s / _METRES_PER_SECOND], 3)
    cancel = np.linalg.pinv(modes[:, :, 3:])
    now = np.sum((cancel @ modes * sigma) ** 2, axis=(1, 2))
    step_s = period * TIME_UNIT_S / _PLACES
    fewest = max(1, int(np.ceil(least_days * SECONDS_PER_DAY / step_s)))
    most = max(fewest, int(most_days * SECONDS_PER_DAY / step_s))
    turns = -(-most // _PLACES)
    past = [np.linalg.matrix_power(growth, turn) @ modes for turn in range(turns, -1, -1)]
    past = np.concatenate(past)
    costs = []
    for steps in range(fewest, most + 1):
        first = turns * _PLACES - steps
        left = cancel @ past[first : first + _PLACES] * sigma
        before = np.sum(left**2, axis=(1, 2))
        costs.append(np.mean(np.sqrt(before + now)) * _YEAR_S / (steps * step_s))
    return float(np.min(costs)) * _METRES_PER_SECOND
