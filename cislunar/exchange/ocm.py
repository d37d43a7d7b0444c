"""CCSDS Orbit Comprehensive Messages (CCSDS 502.0-B-3, section 6) in keyword-value notation.

A message describes one object: its states and covariances (sections TRAJ and COV, of the type
CARTPV), maneuvers (section MAN), and parameters that the user defines (section USER). States,
covariances and velocity increments are in the ICRF. A catalog of several objects is several
messages.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cislunar.constants import DATE_SYSTEM
from cislunar.ephemeris.time_scales import TIME_SYSTEMS
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.exchange import key_values as kvn
from cislunar.exchange.oem import (
    USEABLE,
    Segment,
    require_segment,
    require_units,
    with_useable_span,
)
from cislunar.runtime.arguments import Array

_PREFIX = "USER_DEFINED_"
_INCREMENT = ("DV_X", "DV_Y", "DV_Z")
_OTHERS = {"MAN_DURA": 0.0, "DV_MAG_SIGMA": np.nan, "DV_DIR_SIGMA": np.nan, "DELTA_MASS": None}
"""Further elements of a maneuver that are read, and their values if they are missing; the last is
ignored."""
_UNITS = "[s,km/s,km/s,km/s{}]"
_BASES = (
    *("CANDIDATE", "PLANNED", "ANTICIPATED", "TELEMETRY", "DETERMINED", "SIMULATED"),
    "OTHER",
)
_COVARIANCE = {"COV_REF_FRAME": kvn.FRAMES, "COV_TYPE": ("CARTPV",), "COV_ORDERING": ("LTM",)}
_TRAJECTORY = {
    "CENTER_NAME": kvn.ORIGINS,
    "TRAJ_REF_FRAME": kvn.FRAMES,
    "TRAJ_TYPE": ("CARTPV", "CARTPVA"),
}
_MANEUVER = {"MAN_REF_FRAME": kvn.FRAMES, "DC_TYPE": ("CONTINUOUS",)}
"""Required keywords of the sections, and values that can be used; `_WITH_DEFAULT` may be missing,
since its default can be used."""
_WITH_DEFAULT = "DC_TYPE"


class Maneuver(NamedTuple):
    """An impulsive maneuver.

    Attributes
    ----------
    name : str
        MAN_ID, unique among the maneuvers of an object.
    tdb_s : float
        Start, TDB seconds past J2000; the impulse is at the middle of the duration.
    delta_v_km_s : ndarray, shape (3,)
        Velocity increment, ICRF, km/s.
    duration_s : float
        Duration, s.
    magnitude_sigma_percent, direction_sigma_deg : float
        Standard deviations of the increment's magnitude, in percent of it, and direction; NaN if
        they are unknown.
    basis : str
        MAN_BASIS, such as "DETERMINED" (from observations), "PLANNED" or "SIMULATED"; empty if it
        is not stated.
    """

    name: str
    tdb_s: float
    delta_v_km_s: Array
    duration_s: float = 0.0
    magnitude_sigma_percent: float = np.nan
    direction_sigma_deg: float = np.nan
    basis: str = ""


class ObjectRecord(NamedTuple):
    """Content of a message.

    Attributes
    ----------
    arc : Segment
        States and covariances.
    maneuvers : list of Maneuver
        In the order of the file.
    user_defined : dict of str to str
        Parameters that the user defines, by their names without ``USER_DEFINED_``.
    """

    arc: Segment
    maneuvers: list[Maneuver]
    user_defined: dict[str, str]


def ocm_text(
    arc: Segment,
    maneuvers: Sequence[Maneuver] = (),
    *,
    created: str,
    user_defined: Mapping[str, object] | None = None,
    comments: Sequence[str] = (),
    originator: str = "CISLUNAR",
    time_system: str = DATE_SYSTEM,
) -> str:
    """Text of a message, version 3.0; its numbers have 17 digits and are read back unchanged.

    Parameters
    ----------
    arc : Segment
        States (at least one) and covariances of the object.
    maneuvers : sequence of Maneuver
        Its maneuvers.
    user_defined : mapping, optional
        Further parameters, by names of capital letters, digits and underscores.
    created, comments, originator, time_system
        See `cislunar.exchange.oem.oem_text`.

    Returns
    -------
    str

    Raises
    ------
    ConfigurationError
        If the arc cannot be written (see `cislunar.exchange.oem.require_segment`), a name is
        unusable or occurs twice, or a number is not finite.
    """
    user = dict(user_defined or {})
    _check(arc, maneuvers, user)
    dated = kvn.dates(arc.tdb_s, time_system)
    lines = kvn.header("OCM", "3.0", created, comments, originator)
    meta = {
        "OBJECT_NAME": arc.name,
        "OBJECT_DESIGNATOR": arc.object_id,
        "TIME_SYSTEM": time_system,
        "EPOCH_TZERO": dated[0],
        "START_TIME": dated[0],
        "STOP_TIME": dated[-1],
    }
    path = {
        "CENTER_NAME": arc.center,
        "TRAJ_REF_FRAME": kvn.FRAMES[0],
        "TRAJ_TYPE": "CARTPV",
        "TRAJ_UNITS": "[km,km,km,km/s,km/s,km/s]",
    }
    if arc.useable_tdb_s:
        path |= dict(zip(USEABLE, kvn.dates(arc.span, time_system), strict=True))
    states = kvn.dated_rows(arc.tdb_s, time_system, arc.state)
    lines += ["", *kvn.block("META", meta), "", *kvn.block("TRAJ", path, states)]
    if len(arc.covariance):
        triangles = [kvn.lower_triangle(matrix) for matrix in arc.covariance]
        rows = kvn.dated_rows(arc.covariance_tdb_s, time_system, triangles)
        form = {"COV_REF_FRAME": kvn.FRAMES[0], "COV_TYPE": "CARTPV", "COV_ORDERING": "LTM"}
        lines += ["", *kvn.block("COV", form, rows)]
    for each in maneuvers:
        sigmas = each.magnitude_sigma_percent, each.direction_sigma_deg
        known = bool(np.isfinite(sigmas).all())
        composition = ("TIME_ABSOLUTE", "MAN_DURA", *_INCREMENT, *[*_OTHERS][1:3] * known)
        form = {
            "MAN_ID": each.name,
            **({"MAN_BASIS": each.basis} if each.basis else {}),
            "MAN_DEVICE_ID": "ALL",
            "MAN_REF_FRAME": kvn.FRAMES[0],
            "DC_TYPE": "CONTINUOUS",
            "MAN_COMPOSITION": ",".join(composition),
            "MAN_UNITS": _UNITS.format(",%,deg" * known),
        }
        values = [each.duration_s, *each.delta_v_km_s, *(sigmas if known else ())]
        lines += ["", *kvn.block("MAN", form, kvn.dated_rows([each.tdb_s], time_system, [values]))]
    if user:
        named = {f"{_PREFIX}{name}": value for name, value in user.items()}
        lines += ["", *kvn.block("USER", named)]
    return "\n".join(lines) + "\n"


def _check(arc: Segment, maneuvers: Sequence[Maneuver], user: Mapping[str, object]) -> None:
    """Refuse content that a message cannot have."""
    require_segment(arc)
    names = [each.name for each in maneuvers]
    for each in maneuvers:
        sigmas = np.array([each.magnitude_sigma_percent, each.direction_sigma_deg])
        values = each.tdb_s, each.duration_s, *each.delta_v_km_s
        rule = ""
        if names.count(each.name) > 1 or each.basis not in ("", *_BASES):
            rule = f"give it a name of its own, and no basis or one of {', '.join(_BASES)}"
        elif len(values) != 5 or not np.all(np.isfinite(values)) or each.duration_s < 0.0:
            rule = (
                "time, duration and the three components of the velocity increment must be "
                "finite, and the duration not negative"
            )
        elif np.isnan(sigmas).sum() == 1 or np.any(sigmas < 0.0):
            rule = "give both standard deviations, not negative, or neither"
        if rule:
            raise ConfigurationError(f"maneuver {each.name!r} of {arc.name}: {rule}")
    for name in user:
        if not re.fullmatch(r"[A-Z][A-Z0-9_]*", name):
            raise ConfigurationError(
                f"user-defined parameter {name!r} must consist of capital letters, digits and "
                "underscores"
            )


def read_ocm(path: str | Path) -> ObjectRecord:
    """Read a message in keyword-value notation.

    Parameters
    ----------
    path : str or Path
        The file, version 3.0, with one section TRAJ of Cartesian states and at most one section
        COV, in the ICRF. Sections PHYS, PERT and OD are ignored.

    Returns
    -------
    ObjectRecord

    Raises
    ------
    ConfigurationError
        If `path` is not a path.
    InputFileError
        If the file is not such a message, is truncated, or has a frame, center, element set or
        composition that cannot be converted. The message names file and line.
    """
    lines = kvn.message_lines(path, "OCM", ("3.0",))
    metadata, rest = kvn.cut(path, kvn.segments_of(path, lines)[0], "META")
    required, known = ("EPOCH_TZERO",), {"TIME_SYSTEM": TIME_SYSTEMS}
    meta = kvn.assignments(path, metadata[0][0], metadata, required, known, "message")
    system = meta.get("TIME_SYSTEM", "UTC")  # the default of the standard
    zero = kvn.read_date(f"{path}, EPOCH_TZERO", meta["EPOCH_TZERO"], system)
    sections: dict[str, list[kvn.Lines]] = {"TRAJ": [], "COV": [], "MAN": [], "USER": []}
    while rest:
        name = rest[0][1].removesuffix("_START")
        inside, rest = kvn.cut(path, rest, name)
        sections.setdefault(name, []).append(inside)
    for name in ("TRAJ", "COV", "USER"):
        if len(sections[name]) > 1 or not sections["TRAJ"]:
            raise InputFileError(
                f"{path}: {len(sections[name])} sections {name}; one of them can be read"
            )

    read = _Reader(path, system, zero)
    trajectory, tdb, state = read.table("TRAJ", sections["TRAJ"][0], _TRAJECTORY, (6, 9))
    require_units(f"{path}, section TRAJ", tdb, state)
    times, covariance = np.empty(0), np.empty((0, 6, 6))
    for section in sections["COV"]:
        _, times, rows = read.table("COV", section, _COVARIANCE, (21,))
        covariance = np.array([kvn.from_lower_triangle(row) for row in rows])
    designator = meta.get("OBJECT_DESIGNATOR") or meta.get("INTERNATIONAL_DESIGNATOR")
    arc = Segment(
        meta.get("OBJECT_NAME") or designator or kvn.UNKNOWN,
        designator or kvn.UNKNOWN,
        kvn.ORIGINS[trajectory["CENTER_NAME"]],
        tdb,
        state,
        times,
        covariance,
    )
    arc = with_useable_span(f"{path}, section TRAJ", arc, trajectory, system, zero)
    maneuvers = [each for section in sections["MAN"] for each in read.maneuvers(section)]
    user = [kvn.assignments(path, each[0][0], each, (), {}) for each in sections["USER"] if each]
    named = {key.removeprefix(_PREFIX): value for each in user for key, value in each.items()}
    return ObjectRecord(arc, maneuvers, named)


class _Reader(NamedTuple):
    """Reads sections of the file `path`, whose dates are in a time scale, or are seconds since
    `zero_tdb_s`."""

    path: str | Path
    system: str
    zero_tdb_s: float

    def table(
        self,
        name: str,
        lines: kvn.Lines,
        usable: Mapping[str, Collection[str]],
        counts: Sequence[int],
    ) -> tuple[dict[str, str], Array, Array]:
        """Keywords, times and numbers of a section. The keywords in `usable` are required, but for
        `_WITH_DEFAULT`."""
        end = next((k for k, (_, each) in enumerate(lines) if not kvn.assignment(each)), len(lines))
        if end == len(lines):
            raise InputFileError(f"{self.path}: a section {name} has no line of data; add one")
        place = lines[0][0], lines[:end]
        required = [key for key in usable if key != _WITH_DEFAULT]
        found = kvn.assignments(self.path, *place, required, usable, f"section {name}")
        row = f"a line of section {name} has {' or '.join(map(str, counts))}"
        return found, *kvn.timed_rows(
            self.path, lines[end:], self.system, counts, row, self.zero_tdb_s
        )

    def maneuvers(self, lines: kvn.Lines) -> list[Maneuver]:
        """Maneuvers of a section; those of several lines are numbered."""
        values = dict(filter(None, (kvn.assignment(line) for _, line in lines)))
        _, *names = [each.strip() for each in values.get("MAN_COMPOSITION", "").split(",")]
        if not {*_INCREMENT} <= {*names} <= {*_INCREMENT, *_OTHERS}:
            raise InputFileError(
                f"{self.path}, line {lines[0][0] if lines else 1}: MAN_COMPOSITION must be a time, "
                f"{', '.join(_INCREMENT)}, and if need be {', '.join(_OTHERS)}; convert the file"
            )
        found, tdb, rows = self.table("MAN", lines, _MANEUVER, (len(names),))
        label = found.get("MAN_ID", "")
        return [
            Maneuver(
                f"{label} {k + 1}".strip() if len(tdb) > 1 else label,
                float(start),
                row[[names.index(each) for each in _INCREMENT]],
                *(
                    float(row[names.index(each)]) if each in names else missing
                    for each, missing in _OTHERS.items()
                    if missing is not None
                ),
                found.get("MAN_BASIS", "").upper(),
            )
            for k, (start, row) in enumerate(zip(tdb, rows, strict=True))
        ]
