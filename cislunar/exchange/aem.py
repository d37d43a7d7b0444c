"""CCSDS Attitude Ephemeris Messages (CCSDS 504.0-B, section 4) in keyword-value notation.

An attitude is a unit quaternion ``[rho; q4]`` with the scalar last (Q1, Q2, Q3, QC). It transforms
the components of a vector in REF_FRAME_A, the ICRF, into those in REF_FRAME_B, the body frame, by
the matrix ``A(q)`` of `cislunar.attitude.quaternion` (504.0-B, annex F). Angular velocities are in
the body frame, deg/s.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cislunar.constants import DATE_SYSTEM
from cislunar.ephemeris.time_scales import TIME_SYSTEMS
from cislunar.errors import InputFileError
from cislunar.exchange import key_values as kvn
from cislunar.runtime.arguments import UNIT_NORM, Array, array_of, require_unit

BODY = "SC_BODY_1"
"""Name of the body frame of the only body."""

_READ_NORM = 1e-3
"""Difference from the unit norm up to which a quaternion is normalized that has few digits."""

_TYPES = {"QUATERNION": 4, "QUATERNION/ANGVEL": 7}
"""Attitude types that are read, and the count of their numbers."""

_REQUIRED = (
    *("OBJECT_NAME", "OBJECT_ID", "REF_FRAME_A", "REF_FRAME_B", "TIME_SYSTEM", "START_TIME"),
    *("STOP_TIME", "ATTITUDE_TYPE"),
)


class AttitudeSegment(NamedTuple):
    """Attitudes of an object relative to the ICRF.

    Attributes
    ----------
    name, object_id : str
        OBJECT_NAME and OBJECT_ID.
    tdb_s : ndarray, shape (time,)
        TDB seconds past J2000, increasing.
    quaternion : ndarray, shape (time, 4)
        Unit quaternions, scalar last, from the ICRF to the body frame.
    angular_velocity_deg_s : ndarray, shape (time, 3) or (0, 3)
        Body frame, deg/s; (0, 3) if there are none.
    body : str
        Name of the body frame.
    """

    name: str
    object_id: str
    tdb_s: Array
    quaternion: Array
    angular_velocity_deg_s: Array = np.empty((0, 3))
    body: str = BODY


def aem_text(
    segments: Iterable[AttitudeSegment],
    *,
    created: str,
    comments: Sequence[str] = (),
    originator: str = "CISLUNAR",
    time_system: str = DATE_SYSTEM,
) -> str:
    """Text of a message, version 2.0; its numbers have 17 digits and are read back unchanged.

    Parameters
    ----------
    segments : iterable of AttitudeSegment
        In order. The header of the message states their convention.
    created, comments, originator, time_system
        See `cislunar.exchange.oem.oem_text`.

    Returns
    -------
    str

    Raises
    ------
    ConfigurationError
        If a segment has no attitudes, times that do not increase, or arrays of unequal lengths, a
        quaternion is not of unit norm, or an angular velocity is not finite.
    """
    stated = (
        *comments,
        "Quaternions Q1 Q2 Q3 QC, scalar last; they transform components in REF_FRAME_A into those",
        "in REF_FRAME_B. Angular velocities are those of REF_FRAME_B in ANGVEL_FRAME, deg/s.",
    )
    lines = kvn.header("AEM", "2.0", created, stated, originator)
    for segment in segments:
        of, kind = f"of {segment.name}", "QUATERNION"
        rows = array_of(f"quaternion {of}", segment.quaternion, ("time", 4))
        require_unit(f"quaternion {of}", rows, "time")
        kvn.require_times(f"tdb_s {of}", segment.tdb_s, len(rows))
        if len(segment.angular_velocity_deg_s):
            name, axes = f"angular velocity {of}", (len(rows), 3)
            rates = array_of(name, segment.angular_velocity_deg_s, axes)
            rows, kind = np.hstack([rows, rates]), "QUATERNION/ANGVEL"
        dated = kvn.dates(segment.tdb_s, time_system)
        values = segment.name, segment.object_id, kvn.FRAMES[0], segment.body, time_system
        meta = dict(zip(_REQUIRED, (*values, dated[0], dated[-1], kind), strict=True))
        if kind != "QUATERNION":
            meta["ANGVEL_FRAME"] = segment.body
        data = kvn.dated_rows(segment.tdb_s, time_system, rows)
        lines += ["", *kvn.block("META", meta), *kvn.block("DATA", {}, data)]
    return "\n".join(lines) + "\n"


def read_aem(path: str | Path) -> list[AttitudeSegment]:
    """Read a message in keyword-value notation.

    Parameters
    ----------
    path : str or Path
        The file, version 1.0 or 2.0, with quaternions, or with quaternions and angular velocities
        in the body frame. One of its two frames is the ICRF.

    Returns
    -------
    list of AttitudeSegment
        In the order of the file, from the ICRF to the body frame.

    Raises
    ------
    ConfigurationError
        If `path` is not a path.
    InputFileError
        If the file is not such a message, is truncated, or has another attitude type, frames or
        time scale, or a quaternion that is not of unit norm. The message names file and line.
    """
    lines = kvn.message_lines(path, "AEM", ("1.0", "2.0"))
    return [_segment(path, each) for each in kvn.segments_of(path, lines)]


def _segment(path: str | Path, lines: kvn.Lines) -> AttitudeSegment:
    first = lines[0][0]
    metadata, rest = kvn.cut(path, lines, "META")
    inside, _ = kvn.cut(path, rest, "DATA")
    conventions = {"QUATERNION_TYPE": ("FIRST", "LAST"), "ATTITUDE_DIR": ("A2B", "B2A")}
    usable = {"TIME_SYSTEM": TIME_SYSTEMS, "ATTITUDE_TYPE": _TYPES, **conventions}
    meta = kvn.assignments(path, first, metadata, _REQUIRED, usable)
    count = _TYPES[meta["ATTITUDE_TYPE"]]
    row = f"an attitude of type {meta['ATTITUDE_TYPE']} has {count}"
    tdb, values = kvn.timed_rows(path, inside, meta["TIME_SYSTEM"], (count,), row)
    kvn.require_stop(path, inside or lines, meta, tdb, "attitudes")
    quaternion, rates = values[:, :4], values[:, 4:]
    if meta.get("QUATERNION_TYPE") == "FIRST":
        quaternion = np.roll(quaternion, -1, axis=1)
    norm = np.linalg.norm(quaternion, axis=1, keepdims=True)
    wrong = np.flatnonzero(np.abs(norm - 1.0) > _READ_NORM)
    if wrong.size:
        raise InputFileError(
            f"{path}, line {inside[wrong[0]][0]}: the quaternion is not of unit norm; correct it"
        )
    quaternion = np.where(np.abs(norm - 1.0) > UNIT_NORM, quaternion / norm, quaternion)
    frames = [meta["REF_FRAME_A"], meta["REF_FRAME_B"]]
    inertial = [frame.upper() in kvn.FRAMES for frame in frames]
    if sum(inertial) != 1:
        raise InputFileError(
            f"{path}, line {first}: REF_FRAME_A = {frames[0]} and REF_FRAME_B = {frames[1]}; one "
            f"of them must be the body frame and the other one of {', '.join(kvn.FRAMES)}"
        )
    body = frames[inertial.index(False)]
    if inertial[1] != (meta.get("ATTITUDE_DIR") == "B2A"):
        quaternion = quaternion * np.array([-1.0, -1.0, -1.0, 1.0])
    if rates.size and meta.get("ANGVEL_FRAME", body) != body:
        raise InputFileError(
            f"{path}, line {first}: ANGVEL_FRAME = {meta['ANGVEL_FRAME']} must be {body}"
        )
    # the angular velocity of frame B with respect to frame A (504.0-B, annex F)
    rates = (-rates if inertial[1] else rates) if rates.size else np.empty((0, 3))
    return AttitudeSegment(meta["OBJECT_NAME"], meta["OBJECT_ID"], tdb, quaternion, rates, body)
