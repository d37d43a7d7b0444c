"""Encoding of an architecture as labels for a black-box optimizer.

Every slot has one orbit and one satellite count. The count is an ordered integer. The orbit can be
encoded in four ways, and the encoding decides whether a tree-structured Parzen estimator (TPE) can
learn: it builds one density per label, so that a label must order similar orbits next to each
other. A categorical label with 302 values cannot be learned, because its one pseudo-count per
category dominates the few good trials. The rank by stability index is the default: the campaign
compares all four (``tables/label_comparison.csv``), and it reached the largest J.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.architecture.objective import Objective
from cislunar.errors import ConfigurationError
from cislunar.runtime.arguments import require_choice

Architecture = tuple[NDArray[np.int64], NDArray[np.int64]]

LABELS = ("family_position", "index", "stability_rank", "categorical")
"""Encodings of an orbit: its family and its position along it; its index along all families; its
rank by stability index; an unordered category."""

_SAME_STABILITY = 1e-6
"""Relative difference of neighboring stability indices below which they are equal."""


def _family_ranges(family: NDArray[np.str_]) -> list[tuple[int, int]]:
    """First index and number of members of each run of equal families."""
    starts = np.flatnonzero(np.r_[True, family[1:] != family[:-1]])
    return list(zip(starts.tolist(), np.diff(np.r_[starts, len(family)]).tolist(), strict=True))


def stability_order(stability_index: ArrayLike) -> NDArray[np.int64]:
    """Orbits by ascending stability index, shape (orbit,); equal ones in the order of the library.
    A northern orbit and its southern mirror image have the same stability index, but their
    numerical values differ by rounding, which depends on the machine. An index within
    `_SAME_STABILITY` of the next smaller one is therefore equal to it. (Rounding to a number of
    digits would separate equal indices on either side of a rounding boundary.)"""
    index = np.asarray(stability_index, dtype=float)
    order = np.argsort(index, kind="stable")
    steps = np.diff(index[order]) > _SAME_STABILITY * index[order][1:]
    group = np.empty(index.size, dtype=np.int64)
    group[order] = np.concatenate([[0], np.cumsum(steps)])
    return np.argsort(group, kind="stable")


class Range(NamedTuple):
    """Values of a label: an interval, or with `categories` one of 0 .. categories - 1."""

    low: float
    high: float
    categories: int = 0


def _integers(low: int, high: int) -> Range:
    """Ordered integers with equal probability, as the integer part of a uniform label.
    `hp.uniformint` gives its two ends half the probability, and a quantized density costs TPE
    several times as much as a continuous one."""
    return Range(low, high + 1)


def _category(number: int) -> Range:
    """One of a number of categories."""
    return Range(0, number, number)


def hyperopt_space(ranges: Mapping[str, Range]) -> dict[str, Any]:
    """Labels as Hyperopt expressions."""
    from hyperopt import hp

    return {
        name: hp.randint(name, of.categories)
        if of.categories
        else hp.uniform(name, of.low, of.high)
        for name, of in ranges.items()
    }


def _integer(value: float, low: int, high: int) -> int:
    """A sample of `_integers`, clipped because the upper end of the interval may be sampled."""
    return min(max(int(value), low), high)


def build_space(
    objective: Objective, *, n_slots: int = 10, labels: str = "stability_rank"
) -> tuple[dict[str, Range], Callable[[Mapping[str, Any]], Architecture]]:
    """Search space of an architecture, a `Range` by label, and its decoder, which turns a sample of
    the space into ``(orbit, satellites)``, int64 arrays (slot,). `labels` is one of `LABELS`."""
    if not 1 <= n_slots <= objective.n_orbits:
        raise ConfigurationError(
            f"slots = {n_slots} must lie in 1 .. {objective.n_orbits}, the number of orbits"
        )
    require_choice("labels", labels, LABELS)
    slots = range(n_slots)
    space = {f"satellites_{i}": _integers(1, objective.max_satellites) for i in slots}
    ranges = _family_ranges(objective.family)
    by_stability = stability_order(objective.stability_index)
    for i in slots:
        if labels == "family_position":
            space[f"family_{i}"] = _category(len(ranges))
            space[f"position_{i}"] = Range(0.0, 1.0)
        elif labels == "categorical":
            space[f"orbit_{i}"] = _category(objective.n_orbits)
        else:
            space[f"orbit_{i}"] = _integers(0, objective.n_orbits - 1)

    def decode_orbit(sample: Mapping[str, Any], i: int) -> int:
        if labels == "family_position":
            start, members = ranges[int(sample[f"family_{i}"])]
            return start + _integer(sample[f"position_{i}"] * members, 0, members - 1)
        index = _integer(sample[f"orbit_{i}"], 0, objective.n_orbits - 1)
        return int(by_stability[index]) if labels == "stability_rank" else index

    def decode(sample: Mapping[str, Any]) -> Architecture:
        orbit = np.array([decode_orbit(sample, i) for i in slots], dtype=np.int64)
        counts = [_integer(sample[f"satellites_{i}"], 1, objective.max_satellites) for i in slots]
        return orbit, np.array(counts, dtype=np.int64)

    return space, decode
