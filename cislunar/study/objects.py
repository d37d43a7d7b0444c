"""Observers and targets of a study, from orbits by name, states, tables and messages.

A collection is a mapping of names to objects, a sequence of objects, which get numbers, an array of
states of shape (object, 6), or a file: a table (``*.csv``, see `cislunar.orbits.observers` and
`cislunar.targets.tables`) or an OEM (``*.oem``). An object is

- text, as `cislunar.study.orbit_text.FORM` states, with states in km and km/s, or the path of an
  OEM that has this object only,
- six numbers, a nondimensional state in the rotating frame at the epoch,
- one or several members of a family (`cislunar.orbits.families.OrbitSet`), or
- a mapping with the keys of `OBJECT_KEYS`.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cislunar.campaign.data.own_targets import objects_dataset
from cislunar.campaign.settings.cell_settings import sensor_change
from cislunar.constants import LENGTH_UNIT_KM, MU, SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.dynamics.propagation import closest_approaches, propagate, propagate_periodic
from cislunar.errors import (
    ConfigurationError,
    ConvergenceError,
    InputFileError,
    did_you_mean,
    known_keys,
    placed,
)
from cislunar.exchange.inertial import Epoch, rotating_state_at
from cislunar.exchange.oem import Segment, objects_of
from cislunar.exchange.table_rows import OWN_FAMILY, check_state
from cislunar.orbits.families import OrbitSet
from cislunar.orbits.observers import check_clear, load_observers, observer_orbits
from cislunar.quantities import in_kilometers, in_unit, nondimensional
from cislunar.runtime.arguments import Array, array_of, number_of, require_unit
from cislunar.runtime.progress import logger
from cislunar.runtime.progress import shown as to_terminal
from cislunar.runtime.settings_words import shown
from cislunar.study.orbit_text import COMPONENTS, member_of, members_of, read_orbit, state_of
from cislunar.targets.tables import TargetStates, check_closed_targets, load_target_states

PATH_POINTS = 721
"""Points of the path of an orbit in a figure."""
_OF_FAMILY = ("family", "jacobi", "period_days", "member", "phase", "count")
_WAYS = ("family", "state", "state_km", "icrf_km", "oem")
"""Keys that determine an orbit."""
_PRECISE = ("covariance_km", "quaternion", "angular_velocity_deg_h")
OBJECT_KEYS = {
    "observer": (*_OF_FAMILY, "state", "state_km", "oem", "sensor"),
    "target": (*_OF_FAMILY, "state", "state_km", "icrf_km", "center", "oem", *_PRECISE),
}
"""Keys of an object. `count` members are spread along the family. `state_km` is in km and km/s,
rotating frame; `icrf_km` in km and km/s, ICRF, relative to `center` (EARTH, MOON or EARTH
BARYCENTER). `covariance_km` (6, 6) is that of position and velocity in the frame of the state, in
km^2, km^2/s and km^2/s^2. `quaternion`, scalar last, is the rotation from the inertial frame to the
body frame, and `angular_velocity_deg_h` is in the body frame."""


class StudyObject(NamedTuple):
    """An observer or a target.

    Attributes
    ----------
    name : str
        Name in all results.
    family : str
        Orbit family, or `OWN_FAMILY`.
    state : ndarray, shape (6,)
        At the epoch, nondimensional, rotating frame of the CR3BP.
    period : float
        Nondimensional; 0 for an orbit that is not closed.
    segments : tuple of Segment
        Ephemeris of the object, or its state at the epoch, in the ICRF; empty without one.
    sensor : dict
        Settings of the observer's sensor that differ from those of the study.
    covariance_km : ndarray, shape (6, 6), or None
        Initial covariance, km^2, km^2/s and km^2/s^2, in the ICRF with `segments`, else in the
        rotating frame.
    quaternion : tuple of 4 float or None
        Initial estimate of the attitude, scalar last, from the inertial frame to the body frame.
    angular_velocity_deg_h : tuple of 3 float or None
        Initial estimate of the angular velocity, body frame, deg/h.
    """

    name: str
    family: str
    state: Array
    period: float = 0.0
    segments: tuple[Segment, ...] = ()
    sensor: Mapping[str, Any] = {}
    covariance_km: Array | None = None
    quaternion: tuple[float, ...] | None = None
    angular_velocity_deg_h: tuple[float, ...] | None = None

    @property
    def designator(self) -> str:
        """OBJECT_ID of the messages; the name without any."""
        return self.segments[0].object_id if self.segments else self.name

    def path(self, duration: float) -> Array:
        """Positions (time, 3) over a period, or a nondimensional duration if it is not closed."""
        if not self.period:
            return propagate(self.state, np.linspace(0.0, duration, PATH_POINTS))[:, :3]
        times = np.linspace(-0.5, 0.5, PATH_POINTS) * self.period
        return propagate_periodic(self.state, self.period, times)[:, :3]


def read_objects(what: str, given: Any, epoch: Epoch, days: float) -> list[StudyObject]:
    """Objects of a study.

    Parameters
    ----------
    what : {"observer", "target"}
        Kind of the objects.
    given : mapping, sequence, array_like, OrbitSet, str or Path
        The collection, see `cislunar.study.objects`.
    epoch : Epoch
        Epoch of the study and its axes.
    days : float
        Duration of the study, d.

    Returns
    -------
    list of StudyObject
        In the given order, with unique names.

    Raises
    ------
    ConfigurationError, InputFileError
        If an object cannot be read; the message names it.
    """
    place = f"{what}s"
    remedy = "give a mapping of names to orbits, a table (*.csv) or an OEM (*.oem)"
    if isinstance(given, str | Path):
        if Path(given).suffix.lower() not in (".csv", ".oem"):
            raise ConfigurationError(f"{place} = {shown(str(given))}: {remedy}")
        found = _of_file(what, Path(given), epoch, days)
    elif isinstance(given, OrbitSet):
        found = _members(what, "", given)
    elif isinstance(given, Iterable) and not hasattr(given, "to_csv"):  # of a data frame
        named = isinstance(given, Mapping)
        numbered = ((f"{what} {number}", each) for number, each in enumerate(given, 1))
        pairs = given.items() if named else numbered
        found = [each for name, own in pairs for each in _objects(what, name, own, epoch)]
    else:
        raise ConfigurationError(f"{place} = {shown(given)}: {remedy}")
    names = [each.name for each in found]
    if not found:
        raise ConfigurationError(f"{place}: none is given; give at least one")
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ConfigurationError(f"{place}: the name {twice[0]!r} occurs twice; rename one")
    for each in found:
        _check_orbit(what, each, days)
    return found


def _check_orbit(what: str, given: StudyObject, days: float) -> None:
    """Refuse an observer whose orbit meets the Earth or the Moon, and warn of such a target."""
    place, duration = _place(what, given.name), days * SECONDS_PER_DAY / TIME_UNIT_S
    if what == "observer" and given.segments:
        return  # it follows its ephemeris
    try:
        with placed(f"{place}: its orbit cannot be followed", ConvergenceError, InputFileError):
            least = closest_approaches(given.state, given.period or duration)
        check_clear(place, *(LENGTH_UNIT_KM * each for each in least))
    except InputFileError as error:
        if what == "observer":
            raise
        with to_terminal():
            logger.warning("warning: %s", error)


def _place(what: str, name: Any) -> str:
    """An object in a message, where the name of one without a name says what it is."""
    return f"{what} {name!r}" if name != f"{what} {str(name).split(' ')[-1]}" else str(name)


def _of_file(what: str, path: Path, epoch: Epoch, days: float) -> list[StudyObject]:
    """Objects of a table or an OEM."""
    if path.suffix.lower() == ".oem":
        return _of_message(path, epoch)
    if what == "observer":
        rows = load_observers(path)
        orbits = observer_orbits(rows, days)
        return [
            StudyObject(row.name, row.family, state, float(period), (), sensor_change(row.sensor))
            for row, state, period in zip(rows, orbits.state, orbits.period, strict=True)
        ]
    targets = load_target_states(path)
    check_closed_targets(path, targets)
    return [StudyObject(*row) for row in zip(*targets, strict=True)]


def _of_message(path: Path, epoch: Epoch) -> list[StudyObject]:
    """Objects of an OEM, each with its segments and its covariance at the epoch."""
    return [_with_segments(str(path), each, epoch) for each in objects_of(path).values()]


def _with_segments(place: str, segments: Sequence[Segment], epoch: Epoch) -> StudyObject:
    state = rotating_state_at(place, segments, epoch)
    known = [
        matrix
        for each in segments
        for time, matrix in zip(each.covariance_tdb_s, each.covariance, strict=True)
        if abs(time - epoch.tdb_s) < 1.0
    ]
    return StudyObject(
        segments[0].name, OWN_FAMILY, state, 0.0, tuple(segments), {}, known[0] if known else None
    )


def _objects(what: str, name: Any, given: Any, epoch: Epoch) -> list[StudyObject]:
    """Objects of one entry of a collection, which are several for several members of a family."""
    place = _place(what, name)
    if not isinstance(name, str) or not name.strip() or not name.isprintable():
        raise ConfigurationError(f"{what}s: {shown(name)} is no name; give a text, in quotes")
    if name != name.strip():
        raise ConfigurationError(f"{what}s: {name!r} begins or ends with a blank; remove it")
    if isinstance(given, OrbitSet):
        return _members(place, name, given)
    if isinstance(given, str | Path):
        if Path(given).suffix.lower() != ".oem":
            with placed(place):
                orbit = read_orbit(str(given))
            return [StudyObject(name, orbit.family, np.array(orbit.state), orbit.period)]
        given = {"oem": given}
    if isinstance(given, Mapping):
        return _of_mapping(what, name, place, given, epoch)
    return [StudyObject(name, OWN_FAMILY, _state(place, "state", given, ""))]


def _members(place: str, name: str, members: OrbitSet) -> list[StudyObject]:
    """Members of families, with a number after the name if there are several."""
    for family, state in zip(members.family, members.state, strict=True):
        check_state(place if name else f"{place} of {family}", COMPONENTS, state, "")
    several = members.period.size > 1 or not name
    return [
        StudyObject(
            f"{name or family} {number}" if several else name, str(family), state, float(period)
        )
        for number, (family, state, period) in enumerate(
            zip(members.family, members.state, members.period, strict=True), 1
        )
    ]


def _of_mapping(
    what: str, name: str, place: str, given: Mapping[str, Any], epoch: Epoch
) -> list[StudyObject]:
    """Objects of a mapping with keys of `OBJECT_KEYS`."""
    known = OBJECT_KEYS[what]
    for key in given:
        if key not in known:
            remedy = did_you_mean(str(key), known) or known_keys(known)
            raise ConfigurationError(f"{place}: unknown key {key!r}: {remedy}")
    ways = [key for key in _WAYS if key in given]
    if len(ways) != 1:
        possible = ", ".join(key for key in known if key in _WAYS)
        raise ConfigurationError(
            f"{place}: {' and '.join(ways) or 'no orbit'} given; give one of {possible}"
        )
    for key in _OF_FAMILY[1:]:
        if key in given and ways != ["family"]:
            raise ConfigurationError(f"{place}: {key} belongs to a family, not to {ways[0]}")
    if "center" in given and ways != ["icrf_km"]:
        raise ConfigurationError(f"{place}: center belongs to icrf_km, not to {ways[0]}")
    found = _of_way(ways[0], name, place, given, epoch)
    more = {key: _estimate(place, key, given[key]) for key in _PRECISE if key in given}
    if "sensor" in given:
        more["sensor"] = given["sensor"]
    return [each._replace(**more) for each in found]


def _of_way(
    way: str, name: str, place: str, given: Mapping[str, Any], epoch: Epoch
) -> list[StudyObject]:
    """Objects without the keys that do not concern the orbit."""
    if way == "family":
        return _of_family(name, place, given)
    if way == "oem":
        if not isinstance(given["oem"], str | Path):
            raise ConfigurationError(f"{place}: oem = {shown(given['oem'])} must be a path")
        objects = _of_message(Path(given["oem"]), epoch)
        if len(objects) != 1:
            raise ConfigurationError(
                f"{place}: {given['oem']} has {len(objects)} objects; give the file in place of "
                "the names, or a file with one object"
            )
        return [objects[0]._replace(name=name)]
    if way == "icrf_km":
        center = str(given.get("center", "EARTH")).upper()
        values = array_of(f"{place}: icrf_km", in_kilometers(place, given["icrf_km"]), (6,))
        segment = Segment(name, name, center, np.array([epoch.tdb_s]), values[None])
        return [_with_segments(place, [segment], epoch)]
    unit = "km" if way == "state_km" else ""
    return [StudyObject(name, OWN_FAMILY, _state(place, way, given[way], unit))]


def _of_family(name: str, place: str, given: Mapping[str, Any]) -> list[StudyObject]:
    """One member of a family, or `count` members."""
    family = given["family"]
    values = {"jacobi": given.get("jacobi"), "period": given.get("period_days")}
    values["period"] = in_unit(f"{place}: period_days", values["period"], "d")
    if "count" in given:
        for key in ("member", "phase"):
            if key in given:
                raise ConfigurationError(f"{place}: {key} is of one member; leave out count")
        with placed(place):
            members = members_of(family, **values, count=given["count"])
        return _members(place, name, members)
    values |= {key: given.get(key) for key in ("member", "phase")}
    chosen = {key: value for key, value in values.items() if value is not None}
    if not chosen.keys() & {"jacobi", "period"}:
        raise ConfigurationError(f"{place}: give jacobi, period_days or count of {family}")
    numbers = {key: number_of(f"{place}: {key}", value) for key, value in chosen.items()}
    orbit = member_of(place, family, numbers)
    return [StudyObject(name, orbit.family, np.array(orbit.state), orbit.period)]


def _state(place: str, key: str, given: Any, unit: str) -> Array:
    """A state in the rotating frame, nondimensional."""
    converted = in_kilometers(place, given) if unit else nondimensional(place, given, "state")
    return state_of(f"{place}: {key}", converted, unit)


def _estimate(place: str, key: str, given: Any) -> Any:
    """A key of the initial estimate."""
    axes = {"covariance_km": (6, 6), "quaternion": (4,), "angular_velocity_deg_h": (3,)}[key]
    given = in_unit(f"{place}: {key}", given, "deg/h") if key.endswith("deg_h") else given
    values = array_of(f"{place}: {key}", given, axes)
    if key == "quaternion":
        require_unit(f"{place}: quaternion", values)
    if key == "covariance_km" and (
        not np.allclose(values, values.T, rtol=1e-9, atol=0.0)
        or np.linalg.eigvalsh(values).min() <= 0.0
    ):
        raise ConfigurationError(f"{place}: covariance_km is not symmetric and positive definite")
    return values if key == "covariance_km" else tuple(values.tolist())


def orbits_of_objects(objects: Sequence[StudyObject], dim: str) -> xr.Dataset:
    """Objects as a data set of orbits."""
    keys = "name", "family", "state", "period"
    name, family, state, period = ([getattr(each, key) for each in objects] for key in keys)
    given = TargetStates(name, family, np.array(state), np.array(period))
    units = {"mu": MU, "length_unit_km": LENGTH_UNIT_KM, "time_unit_s": TIME_UNIT_S}
    return objects_dataset(dim, given).assign_attrs(units)
