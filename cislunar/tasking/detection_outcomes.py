"""Detection outcomes of the tasked observations: shares for log and table, warnings of losses. An
observation here is a step at which a target has an observer; of several observers the best outcome
counts."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.observation import NOT_TASKED, Sensor
from cislunar.runtime import logger
from cislunar.tasking.realization import OUTCOME_NAMES
from cislunar.tasking.state import SimulationInputs

OBSERVATION_OUTCOMES = {
    f"{name}_share": number for number, name in enumerate(OUTCOME_NAMES) if number
}
"""Detection outcomes by the names of their shares."""

_LARGEST_LOSS = 0.3
"""Share of the observations lost to one cause above which a warning is logged."""

_LARGEST_SHARE = 0.95
"""Posterior over prior standard deviation above which a parameter counts as not determined."""


class SettingNames(NamedTuple):
    """Names of settings for warnings; the defaults are those of the library."""

    limit: str = "Sensor.limiting_magnitude"
    body: str = "the material and the facets given to target_surfaces"
    irradiance: str = "PhotometryModel.irradiance"
    sphere: str = "TaskingModel.diffuse_reflection_coefficient"
    exclusion: str = "Sensor.exclusion_deg"
    interval: str = "LoopSettings.interval_minutes"


_LIBRARY_NAMES = SettingNames()


def count_outcomes(outcome: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Number of observations of each outcome, shape (outcome,), from indices in any shape."""
    return np.array([np.count_nonzero(outcome == number) for number in range(len(OUTCOME_NAMES))])


def outcome_shares(counts: NDArray[np.int64]) -> dict[str, NDArray[np.float64]]:
    """Shares of the outcomes by their counts (..., outcome), shape (...); NaN if there are none."""
    observations = counts.sum(axis=-1) - counts[..., NOT_TASKED]
    with np.errstate(invalid="ignore"):
        return {
            name: counts[..., number] / observations
            for name, number in OBSERVATION_OUTCOMES.items()
        }


def report_outcomes(
    counts: NDArray[np.int64], inputs: SimulationInputs, names: SettingNames = _LIBRARY_NAMES
) -> None:
    """Log the shares over all realizations, and warn if many observations detected nothing.

    `counts` are those of `count_outcomes`; a warning names the settings in `inputs` that remedy it.
    """
    shares = {name: float(share) for name, share in outcome_shares(counts).items()}
    if np.isnan(shares["used_share"]):
        logger.warning(
            "warning: no target was ever tasked, since the sphere that tasking assumes is never "
            "visible; %s",
            _remedies(inputs, names)["faint_share"],
        )
        return
    listed = [f"{name.removesuffix('_share')} {100 * of:.1f} %" for name, of in shares.items()]
    observations = counts.sum() - counts[NOT_TASKED]
    logger.info(
        "of %d observations of tasked targets: %s", observations, ", ".join(reversed(listed))
    )
    for name, remedy in _remedies(inputs, names).items():
        if shares[name] > _LARGEST_LOSS:
            cause = name.removesuffix("_share")
            logger.warning(
                "warning: %.1f %% of the observations %s; %s", 100 * shares[name], cause, remedy
            )


def report_estimated_parameters(
    sigma: Any,
    prior: Mapping[str, float],
    updates: NDArray[np.int64],
    key: str = "estimated_parameters",
) -> None:
    """Warn of estimated parameters that the light curves of a run cannot determine.

    Parameters
    ----------
    sigma : array_like, shape (seed, epoch, target, n), or None
        Standard deviations of the estimated parameters.
    prior : mapping
        Prior standard deviations, by name, in the same order.
    updates : ndarray of int, shape (seed, target)
        Measurements used.
    key : str
        Key of the estimated parameters in the message.
    """
    seen = updates > 0
    if not prior or sigma is None or not seen.any():
        return
    last = np.asarray(sigma[:, -1], dtype=float)[seen] / np.array(list(prior.values()))
    shares = np.nanmedian(last, axis=0)
    uninformed = [name for name, of in zip(prior, shares, strict=True) if of > _LARGEST_SHARE]
    count, rows = len(prior) + 6, float(np.median(updates[seen]))
    if count > rows:
        logger.warning(
            "warning: %s: %d parameters of a target (%s, and the six of its rotation), but half "
            "the targets have %d measurements or fewer; leave some out",
            key, count, ", ".join(prior), rows,
        )  # fmt: skip
    elif uninformed:
        logger.warning(
            "warning: %s: light curves do not determine %s: half the targets keep more than "
            "%.0f %% of the prior's standard deviation; leave it out, or track fewer targets",
            key, ", ".join(uninformed), 100.0 * _LARGEST_SHARE,
        )  # fmt: skip


def _remedies(inputs: SimulationInputs, names: SettingNames) -> dict[str, str]:
    """Remedies of a loss, by the name of its share."""
    given = inputs.settings.sensor
    sensor = given if isinstance(given, Sensor) else given[0]
    faint = f"raise {names.limit} = {sensor.limiting_magnitude:g}, or see {names.body}"
    if inputs.surfaces.irradiance_4pi:
        faint += (
            f"; {names.irradiance} = 4pi, as printed, makes bodies 2.75 mag fainter than "
            "light that spreads as 1/r^2, and than the sphere that tasking assumes unless "
            f"{names.sphere} is changed"
        )
    angles = ", ".join(f"{body} {angle:g}" for body, angle in sensor.exclusion_deg)
    return {
        "faint_share": faint,
        "excluded_share": (
            f"lower {names.exclusion} ({angles}), or task more often "
            f"({names.interval}): an observer keeps its target until the next tasking"
        ),
    }
