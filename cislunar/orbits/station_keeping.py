"""Station-keeping cost of periodic orbits: the velocity that cancels their unstable deviations."""

import numpy as np
from numpy.typing import ArrayLike

from cislunar.constants import LENGTH_UNIT_KM, MU, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics import CR3BP, VELOCITY_UNIT_M_S, propagate_stm
from cislunar.errors import ConfigurationError
from cislunar.orbits.stability import farthest_state
from cislunar.runtime import Array
from cislunar.runtime.arguments import number_of

_PLACES = 64  # possible maneuvers per revolution
_STABLE = (
    1e-3  # modulus beyond 1 from which an eigenvalue is unstable: the unit pair splits by 1e-5
)
_YEAR_S = 365.25 * SECONDS_PER_DAY


def unstable_modes(state: ArrayLike, period: float, mu: float = MU) -> tuple[Array, Array]:
    """Unstable part of a deviation around a periodic orbit, and its growth over a period.

    The modes (point, mode, 6) are rows by which a deviation at equally spaced points is multiplied
    to obtain its unstable coordinates; these are constant along the orbit until it closes, where
    they grow by the factor (mode, mode). There are no modes if no eigenvalue of the monodromy
    matrix exceeds 1 in modulus by 1e-3."""
    times = period * np.arange(1, _PLACES + 1) / _PLACES
    start = farthest_state(state, period, mu)
    to_point = propagate_stm(start, times, forces=CR3BP(mu))[1]
    values, vectors = np.linalg.eig(to_point[-1].T)
    unstable = vectors[:, (np.abs(values) > 1.0 + _STABLE) & (values.imag >= 0.0)]
    rows = np.array([part for v in unstable.T for part in (v.real, v.imag) if part.any()])
    rows = rows.reshape(-1, 6)
    growth = rows @ to_point[-1] @ np.linalg.pinv(rows)
    begin = np.concatenate([np.eye(6)[None], to_point[:-1]])
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
    """Estimate the velocity change per year that keeps a satellite on an unstable periodic orbit.

    A maneuver cancels the unstable part of the estimated deviation by the least change of velocity,
    as in Floquet mode control (C. Simo, G. Gomez, J. Llibre, R. Martinez and J. Rodriguez, Acta
    Astronautica 15, 1987). Let W be the rows of `unstable_modes` at the maneuver, V their part
    along the velocity, W' the rows at the previous maneuver, and S the covariance of independent
    estimation errors. The mean square of the maneuver is the trace of

        V^+ (W' S W'^T + W S W^T) V^+^T :

    the residual error of the previous maneuver, grown since then, plus the new error. Maneuvers are
    equally spaced by a whole number of 64ths of a period. This number minimizes the mean over the
    orbit of the root mean squares, times the number of maneuvers per year.

    The estimate is linear about the orbit, in the CR3BP, without execution errors or solar
    radiation pressure. Deviations that do not grow exponentially are not canceled, so that a
    linearly stable orbit costs nothing. The estimate serves to rank orbits rather than to size
    tanks.

    Parameters
    ----------
    state : array_like, shape (6,)
        State on the orbit, nondimensional, rotating frame.
    period : float
        Period, nondimensional.
    position_km, velocity_m_s : float
        Standard deviations of each component of the estimate at a maneuver.
    least_days, most_days : float
        Shortest and longest time between maneuvers.
    mu : float
        Mass ratio.

    Returns
    -------
    float
        Velocity change, m/s per year; 0 for a linearly stable orbit.

    Raises
    ------
    ConfigurationError
        If the period, a standard deviation or `least_days` is not positive, `most_days` is less
        than `least_days`, or the state is not of 6 finite numbers.
    ConvergenceError
        If the orbit meets the center of a primary.
    """
    given = {"period": period, "position_km": position_km, "velocity_m_s": velocity_m_s,
             "least_days": least_days}  # fmt: skip
    for name, value in given.items():
        number_of(name, value, positive=True)
    if not most_days >= least_days:
        raise ConfigurationError(f"most_days = {most_days} must be at least {least_days}")
    modes, growth = unstable_modes(state, period, mu)
    if growth.size == 0:
        return 0.0
    sigma = np.repeat([position_km / LENGTH_UNIT_KM, velocity_m_s / VELOCITY_UNIT_M_S], 3)
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
    return float(np.min(costs)) * VELOCITY_UNIT_M_S
