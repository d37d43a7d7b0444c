"""The model errors of a campaign: variants whose truth differs from the assumed model.

This module does not need the compiled library, so that the workflow can import it quickly.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from cislunar.campaign.settings import CellSettings, typed
from cislunar.campaign.settings.cell_settings import cell_settings, true_settings

NONE, SEVERAL = "none", "several"
"""Kinds of a cell without any error, and of a variant with more than one."""

TORQUE = "angular_acceleration_deg_h2"


class ModelError(NamedTuple):
    """Difference of the truth of a variant from the assumed model.

    `error` is the first variant with the same truth. `kind` is a key within `task2.truth`, or
    `SEVERAL`, or `NONE` where an estimator estimates errors that do not exist. `size` is in `unit`
    (``%`` or ``degree``): true over assumed value less one; for shape and inertia the largest
    change of a ratio of axes; for a torque the additional rotation of a body in a run; NaN if it
    has no measure. `also` are other settings that the variant changes, such as a remedy.
    """

    variant: str
    error: str
    kind: str
    size: float
    unit: str
    also: str


def _leaves(change: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys of the innermost entries, with their values."""
    for key, value in change.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _size(kind: str, settings: CellSettings) -> tuple[float, str]:
    """Size of one error and its unit."""
    if kind == TORQUE:
        size = float(np.linalg.norm(settings.truth.angular_acceleration_deg_h2))
        return 0.5 * size * settings.duration_hours**2, "degree"
    section, _, key = kind.partition(".")
    # random deviations differ from target to target, and another law or torque has no size
    if section in ("parameter_sigma", "parameter_freedom", "reflection", "torque"):
        return np.nan, "%"
    true = true_settings(settings)
    true_value, assumed = (getattr(getattr(each, section), key) for each in (true, settings))
    if key == "inertia":
        true_value, assumed = (
            [1, 1, 1] if value is None else value for value in (true_value, assumed)
        )
    if isinstance(true_value, str) or true_value is None or assumed is None:
        return np.nan, "%"
    ratio = np.array(true_value, dtype=float) / np.array(assumed, dtype=float)
    change = ratio.max() / ratio.min() if ratio.ndim else ratio
    return round(100.0 * float(change - 1.0), 9), "%"


def model_errors(task2: Mapping[str, Any]) -> list[ModelError]:
    """The variants of `task2` whose truth differs from the assumed model, in order.

    They include those that estimate body-parameter deviations, whatever the truth, and no
    repetitions on other days.
    """
    found: list[ModelError] = []
    first: dict[str, str] = {}
    for name, variant in task2["variants"]["cells"].items():
        if "repeats" in variant:
            continue
        change = dict(variant["change"])
        truth = change.pop("truth", {})
        kinds = [key for key, _ in _leaves(truth)]
        also = "; ".join(f"{key} = {value}" for key, value in _leaves(change))
        if not kinds:
            if change.get("batch", {}).get("estimated_parameters"):
                found.append(ModelError(name, "", NONE, 0.0, "%", also))
            continue
        settings = typed(cell_settings(task2, name), CellSettings)
        several = len(kinds) > 1
        size, unit = (np.nan, "%") if several else _size(kinds[0], settings)
        error = first.setdefault(json.dumps(truth, sort_keys=True), name)
        kind = SEVERAL if several else kinds[0]
        found.append(ModelError(name, error, kind, size, unit, also))
    return found


def plotted_errors(task2: Mapping[str, Any]) -> list[ModelError]:
    """Errors for the figure: those with a size, cells, and no other change."""
    cells = task2["variants"]["cells"]
    return [
        error
        for error in model_errors(task2)
        if np.isfinite(error.size) and not error.also and cells[error.variant]["targets"]
    ]
