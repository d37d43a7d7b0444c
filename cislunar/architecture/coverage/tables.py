"""Tables of the coverage objectives: the elements that each candidate sees, as bits."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.architecture.coverage.kernels import add_layers
from cislunar.architecture.coverage.measures import day_starts
from cislunar.architecture.orbit_slots import free_orbit_slots, orbit_slots_at, steady_orbits
from cislunar.constants import MU
from cislunar.dynamics import require_nondimensional
from cislunar.errors import ConfigurationError
from cislunar.orbits.families import OrbitSet
from cislunar.runtime.arguments import array_of, count_of, require_choice, require_kind
from cislunar.visibility import VisibilitySettings, distinct_phases, mark_observations
from cislunar.visibility.shade import lost_observations, shade_of
from cislunar.visibility.tracks import satellite_tracks

_ORBITS_PER_BATCH = 8
_WORD = 64
_EQUAL = 1e-6
"""Differences between steps, relative to their mean, up to which times are at equal steps."""

_WINDOWS = ("sample", "day")
"""Kinds of element: a target at one time, or a target on one day."""


@dataclass(frozen=True)
class CoverageTables:
    """Elements (target at a time or on a day) seen from every (orbit slot, satellite count).

    An orbit slot is an orbit with n satellites at the phases j/n (as in the paper), or one phase of
    an orbit with one satellite (free phases); for the arrays `orbit` to `stability_index` see
    `OrbitSlots`. `layers` (slot, satellites, layer, word) hold in layer j, as bits, the elements
    that at least j + 1 of the satellites see. Element e is bit ``e % 8`` of byte ``e // 8``; the
    target index varies fastest, then time or day, see `shape` (windows, targets). `fold` is the
    number of satellites that must see an element for it to count fully."""

    layers: NDArray[np.uint64]
    orbit: NDArray[np.int64]
    phase: NDArray[np.float64]
    family: NDArray[np.str_]
    stability_index: NDArray[np.float64]
    fold: int
    shape: tuple[int, int]

    @property
    def n_elements(self) -> int:
        """Number of (target, time) or (target, day) pairs."""
        return self.shape[0] * self.shape[1]

    @property
    def max_satellites(self) -> int:
        """Largest number of satellites in one orbit slot."""
        return self.layers.shape[1]


def as_words(bits: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Rows of bytes (..., byte), padded with zeros to words of 64 bits (..., word)."""
    padding = [(0, 0)] * (bits.ndim - 1) + [(0, -bits.shape[-1] % (_WORD // 8))]
    return np.pad(bits, padding).view(np.uint64)


def _by_day(bits: NDArray[np.uint8], shape: tuple[int, int], starts: NDArray) -> NDArray[np.uint8]:
    """Bits of (time, target) combined into bits of (day, target), row by row."""
    days = np.empty((*bits.shape[:-1], (len(starts) * shape[1] + 7) // 8), dtype=np.uint8)
    for row in np.ndindex(bits.shape[:-1]):
        seen = np.unpackbits(bits[row], count=shape[0] * shape[1], bitorder="little")
        daily = np.bitwise_or.reduceat(seen.reshape(shape), starts, axis=0)
        days[row] = np.packbits(daily, bitorder="little")
    return days


def _marked(given: tuple, shade: Any) -> NDArray[np.uint8]:
    """Bits of the observations of targets at rest, without those lost in a shadow; for `given` see
    `cislunar.visibility.kernel.mark_observations`."""
    bits = mark_observations(*given)
    if shade is not None:
        at = shade.time * len(given[1]) + shade.target
        lost = lost_observations(*given, shade).astype(np.uint8) << (at & 7).astype(np.uint8)
        np.bitwise_and.at(bits, (slice(None), slice(None), at >> 3), ~lost)
    return bits


def _joined(bits: list[NDArray[np.uint8]], n_targets: int) -> NDArray[np.uint8]:
    """Bits of all times from those of single times."""
    seen = [np.unpackbits(own, axis=-1, count=n_targets, bitorder="little") for own in bits]
    return np.packbits(np.concatenate(seen, axis=-1), axis=-1, bitorder="little")


def coverage_tables(
    orbits: OrbitSet,
    target: ArrayLike,
    times: ArrayLike,
    sun_position: ArrayLike,
    settings: VisibilitySettings,
    *,
    phases: int | None = None,
    max_satellites: int = 10,
    fold: int = 1,
    window: str = "sample",
    max_stability_index: float = np.inf,
    propagator: str = "dopri5",
    mu: float = MU,
    progress: Callable[[int, int], None] | None = None,
) -> CoverageTables:
    """Tabulate the elements that satellites see, at phases j/n as in the paper or at free phases.

    The table has one bit for each candidate, target and time: 9 kB per candidate for 100 targets
    hourly over a month, 29 MB for the 3200 candidates of 100 orbits and 32 phases. The positions of
    a few orbits at a time need further memory.

    Parameters
    ----------
    orbits : OrbitSet
        Candidate orbits.
    target : array_like, shape (target, 3) or (target, time, 3)
        Static targets, or the positions of moving targets at the times; nondimensional, rotating
        frame.
    times : array_like, shape (time,)
        Nondimensional times since the epoch, at equal steps.
    sun_position : array_like, shape (time, 3)
        Sun at those times, nondimensional, rotating frame.
    settings : VisibilitySettings
        Photometry and exclusion.
    phases : int, optional
        Number of phases 0, 1/phases, ... of a period, each with its own satellite. If omitted, n
        satellites on an orbit are at the phases j/n (Paul & Fan, section 3).
    max_satellites : int
        Largest number of satellites on one orbit, if `phases` is omitted.
    fold : int
        Number of satellites that must see an element for it to count fully.
    window : str
        "sample" for target-hours, or "day" for target-days.
    max_stability_index : float
        Orbits with a larger stability index are excluded.
    propagator : str
        Method for the observers, see `cislunar.visibility.tracks.satellite_tracks`.
    mu : float
        Mass ratio.
    progress : callable, optional
        Called with (orbits done, orbits).

    Returns
    -------
    CoverageTables

    Raises
    ------
    ConfigurationError
        If a count is less than 1, the window or the propagator is unknown, no orbit has a stability
        index within the limit, shapes disagree, a value is not finite, a target is evidently in km,
        or the times are not at equal steps.
    ConvergenceError
        If a satellite meets the center of a primary.
    """
    require_kind("orbits", orbits, OrbitSet, "give an OrbitSet")
    require_kind("settings", settings, VisibilitySettings, "give VisibilitySettings")
    if phases is not None:
        count_of("phases", phases)
    count_of("fold", fold)
    count_of("max_satellites", max_satellites)
    require_choice("window", window, _WINDOWS)
    allowed = steady_orbits(orbits, max_stability_index)
    if phases is None:
        phase, members = distinct_phases(max_satellites)
        per_orbit, counts, layer = 1, max_satellites, min(fold, max_satellites)
    else:
        phase = np.arange(phases) / phases
        per_orbit, counts, layer = phases, 1, 1
    times = array_of("times", times, ("time",))
    steps = np.diff(times)
    if steps.size and not np.ptp(steps) <= _EQUAL * steps.mean():
        raise ConfigurationError("times must increase by equal steps")
    moving = np.ndim(target) == 3
    target = array_of("target", target, ("target", *[times.size] * moving, 3))
    require_nondimensional("target", target)
    target = np.ascontiguousarray(target)
    sun = np.ascontiguousarray(array_of("sun_position", sun_position, (times.size, 3)))
    shape = (len(times), len(target))
    starts = day_starts(times)
    n_windows = len(starts) if window == "day" else len(times)
    n_words = -(-n_windows * len(target) // _WORD)
    layers = np.zeros((len(allowed) * per_orbit, counts, layer, n_words), dtype=np.uint64)
    # moving targets are at rest at each of the times
    parts = [(slice(None), target)]
    if target.ndim == 3:
        places = np.ascontiguousarray(target.swapaxes(0, 1))
        parts = [(slice(t, t + 1), place) for t, place in enumerate(places)]
    faintness = settings.faintness_at(len(times))
    shades = [shade_of(place, sun[at], mu) if settings.eclipse else None for at, place in parts]
    for first in range(0, len(allowed), _ORBITS_PER_BATCH):
        batch = allowed[first : first + _ORBITS_PER_BATCH]
        track = satellite_tracks(
            orbits.state[batch], orbits.period[batch], phase, times,
            propagator=propagator, mu=mu,
        )  # fmt: skip
        found = []
        for (at, place), shade in zip(parts, shades, strict=True):
            own = np.ascontiguousarray(track[:, :, at])
            given = own, place, sun[at], settings.exclusion_deg.cosines, faintness[at], mu
            found.append(_marked(given, shade))
        bits = found[0] if target.ndim == 2 else _joined(found, len(target))
        rows = as_words(_by_day(bits, shape, starts) if window == "day" else bits)
        for orbit in range(len(batch)):
            slot = (first + orbit) * per_orbit
            if phases is not None:
                layers[slot : slot + per_orbit, 0, 0] = rows[orbit]
                continue
            for count, member in enumerate(members):
                for row in member:
                    add_layers(layers[slot, count], rows[orbit, row : row + 1])
        if progress is not None:
            progress(first + len(batch), len(allowed))
    if phases is None:
        slots = orbit_slots_at(orbits, allowed, np.zeros(allowed.size))
    else:
        slots = free_orbit_slots(orbits, phases, max_stability_index)
    return CoverageTables(
        layers=layers, fold=fold, shape=(n_windows, len(target)), **slots._asdict()
    )
