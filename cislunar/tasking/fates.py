"""What became of the looks a loop tasked: shares for log and table, a warning where many fail.

A look is a step at which a target has an observer; of several observers the best counts.
"""

import logging
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.observation.measurement import NOT_TASKED
from cislunar.observation.sensor import Sensor
from cislunar.tasking.realization import FATE_NAMES, World

logger = logging.getLogger("cislunar")

LOOK_FATES = {f"{name}_share": number for number, name in enumerate(FATE_NAMES) if number}
"""Fates of a look, by the names of their shares."""

LARGEST_LOSS = 0.3
"""A run that loses a larger share of its looks to one cause says so."""

LARGEST_SHARE = 0.95
"""Share of a prior deviation that is left, above which an unknown counts as not told."""


class Names(NamedTuple):
    """What the user calls that which a warning tells to change; those of the library."""

    limit: str = "Sensor.limiting_magnitude"
    body: str = "the material and the facets given to target_surfaces"
    irradiance: str = "PhotometryModel.irradiance"
    sphere: str = "TaskingModel.diffuse_reflection_coefficient"
    exclusion: str = "Sensor.exclusion"
    interval: str = "LoopSettings.interval_minutes"


LIBRARY = Names()


def counted(fate: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Number of looks of each fate, shape (fate,), from indices in any shape."""
    return np.array([np.count_nonzero(fate == number) for number in range(len(FATE_NAMES))])


def fate_shares(counts: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
    """Shares of the looks by their counts (..., fate), shape (...), NaN where there are none."""
    looks = counts.sum(axis=-1) - counts[..., NOT_TASKED]
    with np.errstate(invalid="ignore"):
        return {name: counts[..., number] / looks for name, number in LOOK_FATES.items()}


def report_fates(counts: NDArray[np.int64], world: World, names: Names = LIBRARY) -> None:
    """Log the shares of all realizations together, and warn where many looks found nothing.

    `counts` are those of `counted`; the settings of `world` that would change the matter are named.
    """
    shares = {name: float(share) for name, share in fate_shares(counts).items()}
    if np.isnan(shares["used_share"]):
        logger.warning(
            "warning: no target was ever tasked, since none is visible to tasking's sphere; %s",
            _mends(world, names)["faint_share"],
        )
        return
    listed = [f"{name.removesuffix('_share')} {100 * of:.1f} %" for name, of in shares.items()]
    looks = counts.sum() - counts[NOT_TASKED]
    logger.info("of %d looks at tasked targets: %s", looks, ", ".join(reversed(listed)))
    for name, mend in _mends(world, names).items():
        if shares[name] > LARGEST_LOSS:
            cause = name.removesuffix("_share")
            logger.warning("warning: %.1f %% of the looks %s; %s", 100 * shares[name], cause, mend)


def report_unknowns(
    sigma: Any, prior: Mapping[str, float], updates: NDArray[np.int64], key: str = "unknowns"
) -> None:
    """Warn of unknowns that the light curves of a run could not carry.

    Parameters
    ----------
    sigma : array-like, shape (seed, epoch, target, n), or None
        Standard deviations of what was estimated besides the motion.
    prior : mapping
        Those before, by name, in the same order.
    updates : ndarray of int, shape (seed, target)
        Measurements used.
    key : str
        What the unknowns are called in the message.
    """
    seen = updates > 0
    if not prior or sigma is None or not seen.any():
        return
    last = np.asarray(sigma[:, -1], dtype=float)[seen] / np.array(list(prior.values()))
    shares = np.nanmedian(last, axis=0)
    untold = [name for name, of in zip(prior, shares, strict=True) if of > LARGEST_SHARE]
    count, rows = len(prior) + 6, float(np.median(updates[seen]))
    if count > rows:
        logger.warning(
            "warning: %s: %d unknowns of a target (%s, and the six of its rotation), but half the "
            "targets have %d measurements or fewer; leave some out",
            key, count, ", ".join(prior), rows,
        )  # fmt: skip
    elif untold:
        logger.warning(
            "warning: %s: light curves tell nothing of %s: half the targets keep more than %.0f %% "
            "of the prior's standard deviation; leave it out, or track fewer targets",
            key, ", ".join(untold), 100.0 * LARGEST_SHARE,
        )  # fmt: skip


def _mends(world: World, names: Names) -> dict[str, str]:
    """What would change a loss."""
    given = world.settings.sensor
    sensor = given if isinstance(given, Sensor) else given[0]
    faint = f"raise {names.limit} = {sensor.limiting_magnitude:g}, or see {names.body}"
    if world.surfaces.irradiance_4pi:
        faint += (
            f"; {names.irradiance} = 4pi, as printed, makes bodies 2.75 mag fainter than "
            "light that spreads as 1/r^2, and than the sphere that tasking judges by unless "
            f"{names.sphere} says otherwise"
        )
    angles = ", ".join(
        f"{body} {getattr(sensor.exclusion, f'{body}_deg'):g}" for body in ("sun", "moon", "earth")
    )
    return {
        "faint_share": faint,
        "excluded_share": (
            f"lower {names.exclusion} ({angles}), or task more often "
            f"({names.interval}): an observer keeps its target until the next tasking"
        ),
    }
