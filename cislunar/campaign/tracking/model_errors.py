"""The model errors of a campaign: variants whose truth is not what the estimators believe.

Nothing here needs the compiled library, so that the workflow knows them at once.
"""

import json
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from cislunar.campaign.settings.cells import cell_settings, true_settings

NONE, SEVERAL = "none", "several"
"""Kinds of a cell without any error, and of a variant with more than one."""

TORQUE = "angular_acceleration_deg_h2"


class ModelError(NamedTuple):
    """How the truth of a variant departs from the belief.

    `error` is the first variant with the same truth. `kind` is a key within `task2.truth`, or
    `SEVERAL`, or `NONE` where an estimator looks for errors that are not there. `size` says how
    far, in `unit` (``%`` or ``degree``): true over believed value less one; for shape and inertia
    the greatest change of a ratio of axes; for a torque what it turns a body ahead in a run; NaN if
    it has no measure.
    `also` are other settings the variant changes, such as a remedy.
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


def _size(kind: str, settings: Mapping[str, Any]) -> tuple[float, str]:
    """Size of one error and its unit."""
    true = true_settings(settings)
    if kind == TORQUE:
        return 0.5 * float(np.linalg.norm(true[kind])) * settings["duration_hours"] ** 2, "degree"
    section, _, key = kind.partition(".")
    if section in ("spread", "reflection"):  # each target has its own; another law has no size
        return np.nan, "%"
    wanted, believed = true[section][key], settings[section][key]
    if key == "inertia":
        wanted, believed = ([1, 1, 1] if value is None else value for value in (wanted, believed))
    if isinstance(wanted, str) or wanted is None or believed is None:
        return np.nan, "%"
    ratio = np.array(wanted, dtype=float) / np.array(believed, dtype=float)
    change = ratio.max() / ratio.min() if ratio.ndim else ratio
    return round(100.0 * float(change - 1.0), 9), "%"


def model_errors(task2: Mapping[str, Any]) -> list[ModelError]:
    """The variants of `task2` whose truth departs from the belief, in its order.

    And those that estimate departures, whatever the truth.
    """
    found: list[ModelError] = []
    first: dict[str, str] = {}
    for name, variant in task2["variants"]["cells"].items():
        change = dict(variant["change"])
        truth = change.pop("truth", {})
        kinds = [key for key, _ in _leaves(truth)]
        also = "; ".join(f"{key} = {value}" for key, value in _leaves(change))
        if not kinds:
            if change.get("batch", {}).get("unknowns"):
                found.append(ModelError(name, "", NONE, 0.0, "%", also))
            continue
        settings = cell_settings(task2, name)
        several = len(kinds) > 1
        size, unit = (np.nan, "%") if several else _size(kinds[0], settings)
        error = first.setdefault(json.dumps(truth, sort_keys=True), name)
        kind = SEVERAL if several else kinds[0]
        found.append(ModelError(name, error, kind, size, unit, also))
    return found


def drawn_errors(task2: Mapping[str, Any]) -> list[ModelError]:
    """Errors that can be drawn: those with a size, cells and nothing else changed."""
    cells = task2["variants"]["cells"]
    return [
        error
        for error in model_errors(task2)
        if np.isfinite(error.size) and not error.also and cells[error.variant]["targets"]
    ]
