"""Interactive page in three dimensions: orbit library, architectures, static and moving targets.

The axes of the page (`cislunar.figures.space.page`) are those of the rotating frame. The time
slider moves targets and satellites through one day from the epoch.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go
import xarray as xr

from cislunar.campaign.architectures.variables import phases_of
from cislunar.constants import SECONDS_PER_DAY
from cislunar.figures.axes import Array
from cislunar.figures.space import orbit_tracks
from cislunar.figures.space.earth_moon import bodies, thousands
from cislunar.figures.space.orbits_page_layout import PageParts, page_layout
from cislunar.figures.space.page import body_traces, bounds, coordinates, joined, page_html
from cislunar.figures.style import BLUE, FAMILY_STYLE, YELLOW, optimizer_style, style_or_gray

DIV_ID = "orbits"
"""Identifier of the plot's element in the page."""

LIBRARY_SAMPLES = 97
CHOSEN_SAMPLES = 241
FRAME_HOURS = np.arange(0.0, 24.01, 0.5)
"""Times of the slider, h since the epoch."""
PATH_HOURS = np.arange(0.0, 24.01, 1.0 / 6.0)

_HOVER_ORBIT = (
    "<b>%{text}</b>, orbit %{customdata[0]:.0f}<br>stability index %{customdata[1]:.4~g}"
    "<br>period %{customdata[2]:.2f} d<br>Jacobi constant %{customdata[3]:.4f}"
    "<br>perilune %{customdata[4]:,.0f} km from the center of the Moon<extra></extra>"
)

_HOVER_POSITION = "<br>x, y, z = %{x:,.0f}, %{y:,.0f}, %{z:,.0f} km<extra></extra>"


class _Layer(NamedTuple):
    """Traces that are shown together, and the tracks of those that move."""

    traces: list[go.Scatter3d]
    moving: dict[int, Array]
    """Positions by number of the trace, shape (n_times, n_points, 3), km."""


def orbits_page(
    orbits: xr.Dataset,
    tracked: xr.Dataset,
    targets: Mapping[str, xr.Dataset],
    architectures: Mapping[str, Mapping[str, xr.Dataset]],
) -> str:
    """HTML of the interactive page of orbits, architectures and targets.

    The data are ``orbits/families.nc``, ``orbits/tracked.nc``, ``targets/static_{scenario}.nc`` by
    scenario and ``architecture/{scenario}/{optimizer}.nc`` by both. The same data give the same
    text.
    """
    unit, placed = float(orbits.attrs["length_unit_km"]), bodies(float(orbits.attrs["mu"]))
    layers = {
        "bodies": _Layer(body_traces(*(each * unit for each, _ in placed.values())), {}),
        "library": _Layer(_library_traces(orbits), {}),
        "moving": _moving_layer(tracked),
    }
    scenario_of = {}
    for scenario, found in architectures.items():
        layers[f"targets {scenario}"] = _static_layer(scenario, targets[scenario], orbits)
        for optimizer, architecture in found.items():
            name = f"{scenario}, {optimizer_style(optimizer).label}"
            layers[name] = _architecture_layer(name, orbits, architecture)
            scenario_of[name] = scenario
    traces, indices, moving = [], {}, {}
    for name, layer in layers.items():
        first = len(traces)
        traces += layer.traces
        indices[name] = list(range(first, len(traces)))
        moving |= {first + number: track for number, track in layer.moving.items()}
    figure = go.Figure(data=traces, frames=_frames(moving))
    choices = {
        name: (indices[name], indices[f"targets {scenario}"])
        for name, scenario in scenario_of.items()
    }
    moon_km = unit * float(placed["Moon"][0][0])
    parts = PageParts(choices, indices["library"], FRAME_HOURS, moon_km, bounds(traces))
    figure.update_layout(page_layout(parts))
    for number in [each for both in list(choices.values())[:1] for part in both for each in part]:
        figure.data[number].visible = True
    return page_html(figure, "Cislunar orbits, architectures and targets", DIV_ID)


def _orbit_data(orbits: xr.Dataset, index: int) -> list[float]:
    """Data of an orbit: row, stability index, period in days, Jacobi constant, perilune in km."""
    days = float(orbits["period"].values[index]) * float(orbits.attrs["time_unit_s"])
    return [
        index,
        float(orbits["stability_index"].values[index]),
        days / SECONDS_PER_DAY,
        float(orbits["jacobi"].values[index]),
        float(orbits["perilune_km"].values[index]),
    ]


def _hover_data(orbits: xr.Dataset, members: Sequence[int], samples: int) -> np.ndarray:
    """Data of each orbit, once for each point of its track and for the gap after it."""
    data = np.array([_orbit_data(orbits, index) for index in members], dtype=np.float32)
    return np.repeat(data, samples + 1, axis=0)


def _library_traces(orbits: xr.Dataset) -> list[go.Scatter3d]:
    """Every candidate orbit, a trace for each family in its color."""
    family = orbits["family"].values.astype(str)
    traces = []
    for name in dict.fromkeys(family.tolist()):
        members = np.flatnonzero(family == name).tolist()
        label = _family_label(name)
        tracks = [orbit_tracks.orbit_track_km(orbits, index, LIBRARY_SAMPLES) for index in members]
        color = style_or_gray(FAMILY_STYLE, name, label).color
        traces.append(go.Scatter3d(
            **coordinates(joined(tracks)), mode="lines", name=f"{label} ({len(members)})",
            legendgroup=name, legendgrouptitle=None if traces else {"text": "Orbit library"},
            line={"color": color, "width": 1.5}, opacity=0.8,
            customdata=_hover_data(orbits, members, LIBRARY_SAMPLES),
            hovertemplate=_HOVER_ORBIT.replace("%{text}", label),
        ))  # fmt: skip
    return traces


def _family_label(family: str) -> str:
    return FAMILY_STYLE[family].label if family in FAMILY_STYLE else family.replace("_", " ")


def _moving_layer(tracked: xr.Dataset) -> _Layer:
    """Moving targets with their paths over the day."""
    names = tracked["family"].values.astype(str)
    track = orbit_tracks.target_tracks_km(tracked, FRAME_HOURS)
    paths = orbit_tracks.target_tracks_km(tracked, PATH_HOURS)
    path = go.Scatter3d(
        **coordinates(joined(list(np.swapaxes(paths, 0, 1)))), mode="lines",
        name="paths of moving targets", line={"color": "#444444", "width": 1}, opacity=0.6,
        hoverinfo="skip", legendgroup="paths", visible="legendonly",
    )  # fmt: skip
    points = go.Scatter3d(
        **coordinates(track[0]), mode="markers", name=f"moving targets ({len(names)})",
        legendgrouptitle={"text": "Targets"}, legendgroup="moving targets",
        marker={"color": "#111111", "size": 3, "symbol": "diamond"},
        text=_target_texts(tracked),
        hovertemplate=f"%{{text}}{_HOVER_POSITION}",
    )  # fmt: skip
    return _Layer([points, path], {0: track})


def _target_texts(tracked: xr.Dataset) -> list[str]:
    """Names of the moving targets, where they have any, and their orbit classes."""
    families = tracked["family"].values.astype(str).tolist()
    if "name" not in tracked:
        return [f"{family}, moving target {k}" for k, family in enumerate(families)]
    names = tracked["name"].values.astype(str).tolist()
    return [f"{name}, {family}" for name, family in zip(names, families, strict=True)]


def _static_layer(scenario: str, targets: xr.Dataset, orbits: xr.Dataset) -> _Layer:
    """Static targets of one scenario."""
    where = targets["position"].values * float(orbits.attrs["length_unit_km"])
    trace = go.Scatter3d(
        **coordinates(where), mode="markers", legendgroup=f"static targets {scenario}", opacity=0.6,
        name=f"static targets of {scenario} ({thousands(len(where))})", visible=False,
        marker={"color": "#5B7C99", "size": 2 if len(where) < 1000 else 1.2},
        hovertemplate=f"static target of scenario {scenario}{_HOVER_POSITION}",
    )  # fmt: skip
    return _Layer([trace], {})


def _architecture_layer(name: str, orbits: xr.Dataset, architecture: xr.Dataset) -> _Layer:
    """Orbits and satellites of an architecture, in colors that no family has."""
    counts = architecture["satellites"].values.tolist()
    chosen = list(zip(architecture["orbit"].values.tolist(), counts, strict=True))
    members = [orbit for orbit, _ in chosen]
    families = orbits["family"].values.astype(str)[members]
    curves = [orbit_tracks.orbit_track_km(orbits, index, CHOSEN_SAMPLES) for index in members]
    given = {"legendgroup": f"architecture {name}", "visible": False}
    lines = go.Scatter3d(
        **coordinates(joined(curves)), mode="lines", name="orbits of the architecture",
        line={"color": BLUE, "width": 6},
        legendgrouptitle={"text": f"Scenario {name}"}, hovertemplate=_HOVER_ORBIT,
        customdata=_hover_data(orbits, members, CHOSEN_SAMPLES),
        text=np.repeat([_family_label(f) for f in families], CHOSEN_SAMPLES + 1).tolist(), **given,
    )  # fmt: skip
    tracks = [
        orbit_tracks.satellite_tracks(orbits, orbit, count, FRAME_HOURS, phase)
        for (orbit, count), phase in zip(chosen, phases_of(architecture), strict=True)
    ]
    track = np.concatenate(tracks, axis=1) * float(orbits.attrs["length_unit_km"])
    texts = [
        f"satellite {k + 1} of {count} on orbit {orbit}, {_family_label(family)}"
        for (orbit, count), family in zip(chosen, families, strict=True)
        for k in range(count)
    ]
    satellites = go.Scatter3d(
        **coordinates(track[0]), mode="markers", name=f"satellites ({len(texts)})", text=texts,
        marker={"color": YELLOW, "size": 6, "line": {"color": "black", "width": 2}},
        hovertemplate="%{text}<extra></extra>", **given,
    )  # fmt: skip
    return _Layer([lines, satellites], {1: track})


def _frames(moving: Mapping[int, Array]) -> list[go.Frame]:
    """A frame for each time, with the positions of everything that moves."""
    return [
        go.Frame(
            name=f"{hour:.1f}",
            data=[go.Scatter3d(**coordinates(track[k])) for track in moving.values()],
            traces=list(moving),
        )
        for k, hour in enumerate(FRAME_HOURS)
    ]
