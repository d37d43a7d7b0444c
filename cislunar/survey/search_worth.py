"""Worth of an architecture for the search: how many observers see the undetected objects each day.

The prior density of undetected objects is represented by particles of equal weight. With c(e) the
number of satellites that can detect a particle on a day, e, the worth of an architecture is

    f = mean over particles and days of min(c(e), k) / k,                                       (1)

where the particles begin anew each day, because a prior does not change with time. It is the
expected share of objects that at least j observers can detect in a day, averaged over j = 1 to
k. A linked orbit is confirmed if three observers have detected it
(`cislunar.orbit_determination.ConfirmationRule`), hence k = 3. The worth is the k-fold coverage of
moving targets, so that searches, bounds and proofs of
`cislunar.architecture.coverage.CoverageObjective` apply.

Assumptions and limitations
---------------------------
- Telescopes point everywhere at once: the worth bounds what a search with fields can reach.
- Objects that have been found are not removed from the prior.
- Particles move in the CR3BP, as spheres of the size that the settings of visibility state.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cislunar.architecture.coverage import CoverageTables, coverage_tables, day_starts
from cislunar.constants import MU
from cislunar.dynamics import CR3BP
from cislunar.errors import ConfigurationError
from cislunar.orbit_determination import AdmissibleRegion
from cislunar.orbits.families import OrbitSet
from cislunar.runtime.arguments import array_of
from cislunar.survey.density import ObjectDensity
from cislunar.visibility.counts import VisibilitySettings

_OBSERVERS = 3
"""Observers whose detections confirm an orbit, k of equation (1)."""


def search_tables(
    orbits: OrbitSet,
    state: ArrayLike,
    times: ArrayLike,
    sun_position: ArrayLike,
    settings: VisibilitySettings,
    *,
    region: AdmissibleRegion | None = None,
    fold: int = _OBSERVERS,
    mu: float = MU,
    **more: Any,
) -> CoverageTables:
    """Particles that satellites can detect on each day, from every orbit slot.

    Parameters
    ----------
    orbits : OrbitSet
        Candidate orbits.
    state : array_like, shape (particle, 6)
        States at the first time of each day, nondimensional, rotating frame, for instance from
        `cislunar.survey.sample_prior`.
    times : array_like, shape (time,)
        Nondimensional times since the epoch, at equal steps.
    sun_position : array_like, shape (time, 3)
        Sun at those times, nondimensional, rotating frame.
    settings : VisibilitySettings
        Size of the spheres and exclusion.
    region : AdmissibleRegion, optional
        Particles that leave it, or meet a body, within a day are left out.
    fold : int
        k of equation (1).
    mu : float
        Mass ratio.
    **more
        Further arguments of `cislunar.architecture.coverage.coverage_tables`.

    Returns
    -------
    CoverageTables
        Of the elements (day, particle).

    Raises
    ------
    ConfigurationError
        If no particle stays in the region, the times of the days differ, or another argument is
        impossible; see `cislunar.architecture.coverage.coverage_tables`.
    """
    states = array_of("state", state, ("particle", 6))
    when = array_of("times", times, ("time",))
    density = ObjectDensity(states, np.ones(len(states)), 1.0, forces=CR3BP(mu), region=region)
    starts = day_starts(when)
    day = np.repeat(np.arange(starts.size), np.diff(starts, append=when.size))
    step = np.arange(when.size) - starts[day]
    since, longest = when - when[starts[day]], int(step.max(initial=0)) + 1
    elapsed = since[day == day[np.argmax(step)]]
    if np.any(np.abs(since - elapsed[step]) > 1e-9):
        raise ConfigurationError("times must have equal steps")
    path = np.empty((len(states), longest, 3))
    for k in range(longest):
        density.advance(float(elapsed[k]))
        path[:, k] = density.state[:, :3]
    stays = density.weight > 0.0
    if not stays.any():
        raise ConfigurationError(
            f"none of {len(states)} particles stays in the admissible region for a day; "
            "give other states or a wider region"
        )
    return coverage_tables(
        orbits, path[stays][:, step], when, sun_position, settings, fold=fold, window="day", mu=mu,
        **more,
    )  # fmt: skip
