"""What became of the looks a cell tasked: shares for log and table, and a warning where many fail.

A look is a step at which a target has an observer; of several observers the best counts.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cislunar.campaign.data.progress import logger
from cislunar.observation.measurement import NOT_TASKED
from cislunar.tasking.realization import FATE_NAMES

LOOK_FATES = {f"{name}_share": number for number, name in enumerate(FATE_NAMES) if number}
"""Fates of a look, by the names of their shares."""

LARGEST_LOSS = 0.3
"""A cell that loses a larger share of its looks to one cause says so."""


def counted(fate: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Number of looks of each fate, shape (fate,), from indices in any shape."""
    return np.array([np.count_nonzero(fate == number) for number in range(len(FATE_NAMES))])


def fate_shares(counts: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
    """Shares of the looks by their counts (..., fate), shape (...), NaN where there are none."""
    looks = counts.sum(axis=-1) - counts[..., NOT_TASKED]
    with np.errstate(invalid="ignore"):
        return {name: counts[..., number] / looks for name, number in LOOK_FATES.items()}


def report_fates(counts: NDArray[np.int64], settings: Mapping[str, Any]) -> None:
    """Log the shares of all realizations together, and warn where many looks found nothing.

    `counts` are those of `counted`; `settings` are those of the cell, which are named with what
    would change the matter.
    """
    shares = {name: float(share) for name, share in fate_shares(counts).items()}
    if np.isnan(shares["used_share"]):
        logger.warning(
            "warning: no target was ever tasked, since none is visible to tasking's sphere; %s",
            _mends(settings)["faint_share"],
        )
        return
    listed = [f"{name.removesuffix('_share')} {100 * of:.1f} %" for name, of in shares.items()]
    looks = counts.sum() - counts[NOT_TASKED]
    logger.info("of %d looks at tasked targets: %s", looks, ", ".join(reversed(listed)))
    for name, mend in _mends(settings).items():
        if shares[name] > LARGEST_LOSS:
            cause = name.removesuffix("_share")
            logger.warning("warning: %.1f %% of the looks %s; %s", 100 * shares[name], cause, mend)


def _mends(settings: Mapping[str, Any]) -> dict[str, str]:
    """What would change a loss."""
    sensor, light = settings["sensor"], settings["photometry"]["irradiance"]
    faint = (
        f"raise task2.sensor.limiting_magnitude = {sensor['limiting_magnitude']}, or see "
        "task2.material and task2.body"
    )
    if light == "4pi":
        faint += (
            "; task2.photometry.irradiance = 4pi, as printed, makes bodies 2.75 mag fainter than "
            "light that spreads as 1/r^2, and than the sphere that tasking judges by unless "
            "task2.tasking.diffuse_reflection_coefficient says otherwise"
        )
    angles = ", ".join(f"{body} {angle}" for body, angle in sensor["exclusion_deg"].items())
    return {
        "faint_share": faint,
        "excluded_share": (
            f"lower task2.sensor.exclusion_deg ({angles}), or task more often "
            "(task2.interval_minutes): an observer keeps its target until the next tasking"
        ),
    }
