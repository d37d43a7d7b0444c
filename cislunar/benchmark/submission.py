"""Submissions to a benchmark: states with covariance, and optionally origins and times.

A submission is a file or a folder. States are in Orbit Ephemeris Messages (``*.oem``), Orbit
Comprehensive Messages (``*.ocm``) or the table of `cislunar.exchange.segments_csv` (``*.csv``), in
the ICRF. A folder may also contain ``assignments.csv`` with the columns ``object`` and ``obsID``,
the object of each detection that is assigned to one, and ``objects.csv`` with the columns
``object`` and ``cataloged_utc``, the date at which an object was first in the catalog.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from cislunar.benchmark.files import BenchmarkScenario, dates
from cislunar.dynamics import recenter
from cislunar.ephemeris import BodyTable, tdb_seconds
from cislunar.errors import CislunarError, InputFileError
from cislunar.exchange import CENTERS, Segment, named_rows, read_ocm, read_oem, read_segments
from cislunar.runtime import Array

ASSIGNMENTS, OBJECTS = "assignments.csv", "objects.csv"

_SAME_S = 1e-3
"""Largest difference between the time of a state and a scoring epoch."""

_READERS = {
    ".oem": read_oem,
    ".ocm": lambda path: [read_ocm(path).arc],
    ".csv": read_segments,
}


class ScoredStates(NamedTuple):
    """States of a submission at one scoring epoch: `names` of the objects, `state` (object, 6), km
    and km/s, ICRF, center of the Earth, and `covariance` (object, 6, 6), NaN if not given."""

    names: list[str]
    state: Array
    covariance: Array


class Submission(NamedTuple):
    """A submission.

    Attributes
    ----------
    states : list of ScoredStates
        At each scoring epoch.
    assigned : dict of str to str, or None
        Object of each assigned detection, by ``obsID``.
    cataloged : dict of str to float, or None
        Time at which an object was first in the catalog, TDB seconds past J2000.
    """

    states: list[ScoredStates]
    assigned: dict[str, str] | None
    cataloged: dict[str, float] | None


def read_submission(path: str | Path, scenario: BenchmarkScenario) -> Submission:
    """Read and check a submission.

    Parameters
    ----------
    path : str or Path
        File or folder.
    scenario : BenchmarkScenario

    Returns
    -------
    Submission

    Raises
    ------
    InputFileError
        If a file cannot be read; if a frame, a time scale or an identifier is unknown, a value is
        not finite, a covariance is not positive definite, an object has no state at a scoring epoch
        between its first and its last state, or none at any. The message names the file.
    """
    root = Path(path)
    if not root.exists():
        raise InputFileError(f"{root}: no such file or folder; give a submission")
    own = sorted(root.iterdir()) if root.is_dir() else [root]
    own = [each for each in own if each.name not in (ASSIGNMENTS, OBJECTS)]
    sources = [each for each in own if each.suffix.lower() in _READERS]
    if not sources:
        raise InputFileError(f"{root}: has no states; give a file {', '.join(_READERS)}")
    table = scenario.forces().table
    epochs = scenario.scoring_tdb
    found: list[dict[str, tuple[Array, Array, Segment]]] = [{} for _ in epochs]
    arcs: dict[str, tuple[str, float, float]] = {}
    for source in sources:
        for segment in _READERS[source.suffix.lower()](source):
            place = f"{source}, object {segment.name!r}"
            _take(place, segment, epochs, table, found)
            first, last = segment.tdb_s[[0, -1]].tolist()
            _, earlier, later = arcs.get(segment.name, ("", first, last))
            arcs[segment.name] = place, min(first, earlier), max(last, later)
    _require_complete_arcs(arcs, epochs, found)
    if not any(found):
        first, last = dates(epochs[[0, -1]])
        raise InputFileError(
            f"{root}: has no state at a scoring epoch; give states at the epochs of "
            f"scenario.yaml, {first} to {last} (UTC)"
        )
    states = [
        ScoredStates(
            list(each),
            np.array([state for state, *_ in each.values()]).reshape(-1, 6),
            np.array([matrix for _, matrix, _ in each.values()]).reshape(-1, 6, 6),
        )
        for each in found
    ]
    names = {name for each in found for name in each}
    assigned = cataloged = None
    if root.is_dir() and (root / ASSIGNMENTS).exists():
        assigned = _assignments(root / ASSIGNMENTS, names)
    if root.is_dir() and (root / OBJECTS).exists():
        cataloged = _dates_of(root / OBJECTS, found, scenario)
    return Submission(states, assigned, cataloged)


def _take(place: str, segment: Segment, epochs: Array, table: BodyTable, found: list[dict]) -> None:
    """Add the states of a segment at scoring epochs to those found."""
    name, times = segment.name, segment.tdb_s
    for number, epoch in enumerate(epochs.tolist()):
        k = int(np.argmin(np.abs(times - epoch)))
        begins, ends = epoch - segment.span[0], segment.span[1] - epoch
        if abs(times[k] - epoch) > _SAME_S or min(begins, ends) < -_SAME_S:
            continue
        date = dates([epoch])[0]
        if name in found[number]:
            # one segment may begin where another one ends: the state is that of the later one
            *_, other = found[number][name]
            after = begins <= _SAME_S and other.span[1] - epoch <= _SAME_S
            before = ends <= _SAME_S and epoch - other.span[0] <= _SAME_S
            if after == before:
                raise InputFileError(f"{place}: has two states at {date}; give one")
            if before:
                continue
        state = recenter(segment.state[k], table, epoch, old=CENTERS[segment.center], new="earth")
        state[:3] += state[3:] * (epoch - times[k])
        matrix = np.full((6, 6), np.nan)
        for at in np.flatnonzero(np.abs(segment.covariance_tdb_s - epoch) <= _SAME_S)[:1]:
            matrix = segment.covariance[at]
            _require_positive(f"{place}, {date}", matrix)
        found[number][name] = state, matrix, segment


def _require_complete_arcs(
    arcs: dict[str, tuple[str, float, float]], epochs: Array, found: list[dict]
) -> None:
    """Refuse an object without a state at a scoring epoch between its first and last state."""
    for name, (place, first, last) in arcs.items():
        for epoch, states in zip(epochs.tolist(), found, strict=True):
            if first < epoch < last and name not in states:
                raise InputFileError(
                    f"{place}: has no state at {dates([epoch])[0]}, a scoring epoch within its "
                    "arc; give one, or begin another object after a gap"
                )


def _require_positive(place: str, matrix: Array) -> None:
    """Refuse a covariance that is not positive definite."""
    diagonal = np.diagonal(matrix)
    if np.all(diagonal > 0.0):
        scale = np.sqrt(diagonal)
        try:
            np.linalg.cholesky(matrix / np.outer(scale, scale))
            return
        except np.linalg.LinAlgError:
            pass
    raise InputFileError(
        f"{place}: the covariance is not positive definite; give it in km^2, km^2/s and km^2/s^2 "
        "with all digits"
    )


def _rows(path: Path, other: str, names: set[str]) -> list[tuple[str, dict[str, str]]]:
    """Rows of a table of known objects: place and text by column."""
    rows = named_rows(path, "row", "object", (other,))[1]
    for place, row in rows:
        if row["object"] not in names:
            raise InputFileError(
                f"{place}: object {row['object']!r} has no state at a scoring epoch; leave it out, "
                "or give its states"
            )
    return rows


def _assignments(path: Path, names: set[str]) -> dict[str, str]:
    assigned: dict[str, str] = {}
    for place, row in _rows(path, "obsID", names):
        if row["obsID"] in assigned:
            raise InputFileError(f"{place}: obsID {row['obsID']!r} occurs twice; assign it once")
        assigned[row["obsID"]] = row["object"]
    return assigned


def _dates_of(path: Path, found: list[dict], scenario: BenchmarkScenario) -> dict[str, float]:
    """Dates at which objects entered the catalog: between the scoring epoch of their first state
    and the one before."""
    begins = [scenario.epoch_tdb, *scenario.scoring_tdb.tolist()]
    first = {name: number for number in reversed(range(len(found))) for name in found[number]}
    given: dict[str, float] = {}
    for place, row in _rows(path, "cataloged_utc", {*first}):
        name = row["object"]
        try:
            time = tdb_seconds(row["cataloged_utc"])
        except CislunarError as error:
            raise InputFileError(f"{place}: cataloged_utc: {error}") from error
        low, high = begins[first[name] : first[name] + 2]
        if not low - _SAME_S <= time <= high + _SAME_S:
            raise InputFileError(
                f"{place}: cataloged_utc {row['cataloged_utc']} of object {name!r} is not from "
                f"{dates([low])[0]} to its first scored state, {dates([high])[0]} (UTC); correct it"
            )
        if name in given:
            raise InputFileError(f"{place}: object {name!r} occurs twice; give one date")
        given[name] = time
    lacking = sorted({*first} - {*given})
    if lacking:
        raise InputFileError(f"{path}: object {lacking[0]!r} has no date; give one of each object")
    return given
