"""Page that replays a run: observers, fields of view, detections, tracks, maneuvers and truth.

The page is one file (`cislunar.figures.space.page`). It has a time slider, and a panel with what is
known at that time of the track that is clicked. Tracks have ellipsoids of one or three standard
deviations, enlarged by a factor that the page states. Truth, errors and true maneuvers are drawn
only on request.
"""

from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
import plotly.graph_objects as go

from cislunar.errors import ConfigurationError
from cislunar.figures import style
from cislunar.figures.space import VIEWS, body_traces, page_html, scene_layout
from cislunar.runtime import Array, array_of

DIV_ID = "scene"
"""Identifier of the plot's element in the page."""

_POSITION_KM, _ERROR_KM, _TURN, _SHARE = 1.0 / 16.0, 1e-3, 2.0**-20, 2.0**-13
"""Resolutions: of positions, errors, components of unit vectors and rotations, and elements of a
covariance's root relative to its largest standard deviation."""
_DOUBLINGS = 1.0 / 64.0
"""Resolution of the binary logarithm of standard deviations."""


class ReplayFact(NamedTuple):
    """What is known of the objects over time, for the panel.

    Attributes
    ----------
    values : array_like, shape (time, object) or (time, object, n)
        NaN where nothing is known.
    unit : str
    resolution : float
        To which the page rounds the values.
    names : sequence of str
        Texts in place of the values 0, 1 and so on, if there are any.
    truth : bool
        Whether the values are shown only together with the truth.
    """

    values: Any
    unit: str = ""
    resolution: float = 0.01
    names: Sequence[str] = ()
    truth: bool = False


class ReplayDetections(NamedTuple):
    """Detections in order of time.

    Attributes
    ----------
    time_s : array_like, shape (row,)
        Seconds since the start of the run.
    observer, object : array_like of int, shape (row,)
        Indices; -1 for a detection without an object.
    direction : array_like, shape (row, 3)
        Measured unit vector from the observer, rotating frame.
    magnitude : array_like, shape (row,)
        NaN if unknown.
    """

    time_s: Any
    observer: Any
    object: Any
    direction: Any
    magnitude: Any


class ReplayManeuver(NamedTuple):
    """A maneuver: `time_s` since the start of the run, index of the `object`, change of velocity
    `change_m_s`, and whether it is a true one (`truth`) or an estimated one."""

    time_s: float
    object: int
    change_m_s: float
    truth: bool


class Replay(NamedTuple):
    """Arrays of a replay, in the rotating frame of Earth and Moon with the origin in their
    barycenter.

    Attributes
    ----------
    title : str
    utc : sequence of str, (time,)
        Dates, ISO 8601, UTC.
    time_s : array_like, shape (time,)
        Seconds since the start of the run, rising.
    earth_km, moon_km : array_like, shape (time, 3)
    axes : array_like, shape (time, 3, 3)
        Rotations from the rotating frame to the ICRF.
    observers : mapping of str to float
        Width of the field of view by name of the observer, deg.
    observer_km, aim_km : array_like, shape (time, observer, 3)
        Positions, and those at which the observers point; NaN for an idle observer.
    objects : sequence of str
        Names of the objects.
    estimate_km : array_like, shape (time, object, 3)
        Estimated positions; NaN where there is no track.
    covariance_km2 : array_like, shape (time, object, 3, 3)
        Covariances of the estimated positions; NaN where there is none.
    error_km : array_like, shape (time, object, 3), or None
        Truth less estimate; None without truth.
    detections : ReplayDetections
    maneuvers : sequence of ReplayManeuver
    facts : mapping of str to ReplayFact
        Further rows of the panel by their labels.
    untracked_km : array_like, shape (time, object, 3), or None
        True positions of objects while they have no track, NaN otherwise; None: they are not shown.
    """

    title: str
    utc: Sequence[str]
    time_s: Any
    earth_km: Any
    moon_km: Any
    axes: Any
    observers: Mapping[str, float]
    observer_km: Any
    aim_km: Any
    objects: Sequence[str]
    estimate_km: Any
    covariance_km2: Any
    error_km: Any
    detections: ReplayDetections
    maneuvers: Sequence[ReplayManeuver] = ()
    facts: Mapping[str, ReplayFact] = {}
    untracked_km: Any = None


def replay_page(replay: Replay) -> str:
    """HTML of the replay of a run. The same arrays give the same text.

    Parameters
    ----------
    replay : Replay

    Returns
    -------
    str

    Raises
    ------
    ConfigurationError
        If an array has another shape, or a value that must be known is not finite.
    """
    arrays, facts = _arrays(replay), replay.facts
    earth, moon = arrays["earth"][0], arrays["moon"][0]
    places = [arrays[name][0].reshape(-1, 3) for name in ("observer", "estimate", "earth", "moon")]
    if "untracked" in arrays:
        places.append(arrays["untracked"][0].reshape(-1, 3))
    every = np.concatenate(places)
    bounds = np.column_stack((np.nanmin(every, axis=0), np.nanmax(every, axis=0)))
    # orbits in one plane still need a box
    middle, half = bounds.mean(axis=1), 0.5 * np.ptp(bounds, axis=1)
    half = np.maximum(1.04 * half, 0.4 * half.max())
    bounds = np.column_stack((middle - half, middle + half))
    traces = [*body_traces(earth[0], moon[0]), *_traces()]
    figure = go.Figure(data=traces, layout=scene_layout(bounds))
    # buttons for the camera are at the right end
    legend = {"title": replay.title, "x": 0.005, "xanchor": "left", "bgcolor": "rgba(0, 0, 0, 0)"}
    figure.update_layout(legend=legend)
    figure.layout.scene.camera = {"eye": {"x": 0.75, "y": -1.85, "z": 0.85}, "center": {"z": -0.1}}
    given = {
        "traces": [trace.name for trace in traces],
        "utc": list(replay.utc),
        "objects": list(replay.objects),
        "observers": list(replay.observers),
        "field_deg": list(map(float, replay.observers.values())),
        "maneuvers": [[float(m[0]), int(m[1]), float(m[2]), bool(m[3])] for m in replay.maneuvers],
        "facts": [
            {"label": label, "unit": fact.unit, "names": list(fact.names), "truth": fact.truth,
             "digits": max(0, -round(np.floor(np.log10(fact.resolution))))}
            for label, fact in facts.items()
        ],
        "views": VIEWS,
        "bounds": bounds.tolist(),
        "truth": replay.error_km is not None,
    }  # fmt: skip
    own = files("cislunar.figures.replay")
    return page_html(
        figure, replay.title, DIV_ID,
        height="100%",
        controls=own.joinpath("controls.html").read_text("utf-8"),
        script=own.joinpath("replay.js").read_text("utf-8"),
        arrays=arrays,
        facts=given,
    )  # fmt: skip


def _arrays(replay: Replay) -> dict[str, tuple[Array, float]]:
    """Checked arrays of the page with their resolutions."""
    times = array_of("time_s", replay.time_s, ("time",))
    n, n_observers, n_objects = len(times), len(replay.observers), len(replay.objects)
    if not np.all(np.diff(times) > 0.0) or len(replay.utc) != n:
        raise ConfigurationError("time_s: give times that rise, each with its date in utc")

    def positions(name: str, *axes: str | int, finite: bool = True) -> tuple[Array, float]:
        given = array_of(f"{name}_km", getattr(replay, f"{name}_km"), axes, finite=finite)
        return given, _ERROR_KM if name == "error" else _POSITION_KM

    covariance = array_of(
        "covariance_km2", replay.covariance_km2, (n, n_objects, 3, 3), finite=False
    )
    scale, root = _roots(covariance)
    rows = replay.detections
    count = np.size(rows.time_s)
    found = {
        "time": (times, 1.0),
        "earth": positions("earth", n, 3),
        "moon": positions("moon", n, 3),
        "axes": (array_of("axes", replay.axes, (n, 3, 3)), _TURN),
        "observer": positions("observer", n, n_observers, 3),
        "aim": positions("aim", n, n_observers, 3, finite=False),
        "estimate": positions("estimate", n, n_objects, 3, finite=False),
        "scale": (scale, _DOUBLINGS),
        "root": (root, _SHARE),
        "seen_time": (array_of("time_s of detections", rows.time_s, (count,)), 1.0),
        "seen_observer": (array_of("observer", rows.observer, (count,)), 1.0),
        "seen_object": (array_of("object", rows.object, (count,)), 1.0),
        "seen_direction": (array_of("direction", rows.direction, (count, 3), finite=False), _TURN),
        "seen_magnitude": (array_of("magnitude", rows.magnitude, (count,), finite=False), 0.01),
    }
    if replay.error_km is not None:
        found["error"] = positions("error", n, n_objects, 3, finite=False)
    if replay.untracked_km is not None:
        found["untracked"] = positions("untracked", n, n_objects, 3, finite=False)
    for number, (label, fact) in enumerate(replay.facts.items()):
        values = array_of(label, fact.values, finite=False)
        if values.shape[:2] != (n, n_objects):
            raise ConfigurationError(f"{label} has shape {values.shape}; give (time, object, ...)")
        found[f"fact{number}"] = values, 1.0 if fact.names else fact.resolution
    return found


def _roots(covariance: Array) -> tuple[Array, Array]:
    """Binary logarithm of the largest standard deviation along an axis, km, and the lower
    triangle (..., 6) of the Cholesky root relative to it; NaN without a covariance."""
    known = np.isfinite(covariance).all(axis=(-1, -2))
    usable = np.where(known[..., None, None], covariance, np.eye(3))
    largest = np.sqrt(np.max(np.diagonal(usable, axis1=-2, axis2=-1), axis=-1))
    # a covariance that rounding made indefinite is given a small additional variance
    relative = usable / largest[..., None, None] ** 2 + 1e-9 * np.eye(3)
    root = np.linalg.cholesky(relative)[..., *np.tril_indices(3)]
    scale = np.where(known, np.log2(largest), np.nan)
    return scale, np.where(known[..., None], root, np.nan)


def _traces() -> list[go.Scatter3d | go.Mesh3d]:
    """Traces without coordinates, which the script of the page sets at every time."""
    nothing = {axis: [None] for axis in "xyz"}

    def lines(name: str, color: str, width: float, **more: Any) -> go.Scatter3d:
        drawn = {"mode": "lines", "line": {"color": color, "width": width}, "hoverinfo": "skip"}
        return go.Scatter3d(**nothing, name=name, **drawn, **more)

    def marks(name: str, color: str, size: float, symbol: str, **more: Any) -> go.Scatter3d:
        marker = {"color": color, "size": size, "symbol": symbol, **more}
        return go.Scatter3d(
            **nothing, name=name, mode="markers", marker=marker, hovertemplate="%{text}"
            "<br>x, y, z = %{x:,.0f}, %{y:,.0f}, %{z:,.0f} km<extra></extra>",
        )  # fmt: skip

    def surface(name: str, color: str, opacity: float) -> go.Mesh3d:
        corners = {axis: [0.0, 0.0, 0.0] for axis in "xyz"} | {"i": [0], "j": [1], "k": [2]}
        return go.Mesh3d(**corners, name=name, color=color, opacity=opacity, hoverinfo="skip",
                         showlegend=True, flatshading=False)  # fmt: skip

    dark = {"line": {"color": "black", "width": 1}}
    return [
        marks("observers", style.YELLOW, 6, "square", **dark),
        surface("fields of view", style.ORANGE, 0.3),
        lines("detections", style.GREEN, 4),
        marks("tracks", style.BLUE, 4, "circle"),
        surface("ellipsoids", style.SKY, 0.25),
        lines("paths", "#9A9A9A", 1.5),
        lines("path of the selected object", style.VERMILION, 4),
        marks("selected object", style.VERMILION, 6, "circle"),
        marks("maneuvers", style.PURPLE, 6, "cross", **dark),
        marks("truth", "#111111", 4, "diamond-open"),
        lines("errors", "#111111", 2),
        marks("true maneuvers", style.VERMILION, 6, "x", **dark),
    ]
