"""Axes, color bar, menus and time slider of the page of orbits."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import LENGTH_UNIT_KM

_WHITE = "rgba(255, 255, 255, 0.85)"


class PageParts(NamedTuple):
    """What the controls of the page act on.

    `choices` gives for each architecture the numbers of its traces and of its targets', `library`
    those of the orbits; `hours` are the slider's, since the epoch. `moon_km` is the x of the Moon,
    `bounds_km`, shape (3, 2), the least and greatest coordinates of everything shown.
    """

    choices: Mapping[str, tuple[Sequence[int], Sequence[int]]]
    library: Sequence[int]
    hours: ArrayLike
    moon_km: float
    bounds_km: NDArray[np.float64]


def page_layout(parts: PageParts) -> dict[str, Any]:
    """Layout of the page, for ``plotly.graph_objects.Layout``."""
    menus = [_view_menu(parts), _library_menu(parts.library), _play_buttons()]
    if parts.choices:
        menus.insert(0, _architecture_menu(parts.choices))
    for menu, x in zip(menus[:-1], (0.0, 0.24, 0.44), strict=False):
        menu.update(x=x, xanchor="left", y=1.0, yanchor="top", bgcolor=_WHITE)
    return {
        "scene": _scene(parts.bounds_km),
        "legend": {
            "x": 0.995, "xanchor": "right", "y": 0.98, "yanchor": "top", "bgcolor": _WHITE,
            "tracegroupgap": 2, "itemsizing": "constant", "font": {"size": 11},
        },
        "margin": {"l": 10, "r": 10, "t": 10, "b": 10},
        "separators": ".\N{THIN SPACE}",
        "updatemenus": menus,
        "sliders": [_slider(parts.hours)],
        "uirevision": "fixed",
        "hoverlabel": {"align": "left"},
    }  # fmt: skip


def _scene(bounds_km: NDArray[np.float64]) -> dict[str, Any]:
    axis = {
        "tickformat": ",d", "showbackground": False, "gridcolor": "#DDDDDD",
        "zerolinecolor": "#BBBBBB", "showspikes": False, "nticks": 6,
    }  # fmt: skip
    box = _box(bounds_km)
    return {
        **{
            f"{x}axis": {
                **axis,
                "title": {"text": f"{x}, km, rotating frame"},
                "range": box[f"scene.{x}axis.range"],
            }
            for x in "xyz"
        },
        "aspectmode": "manual",
        "aspectratio": box["scene.aspectratio"],
        "camera": {
            "eye": {"x": 0.65, "y": -1.65, "z": 0.8},
            "center": {"x": 0, "y": 0, "z": -0.15},
        },
        "dragmode": "orbit",
    }


def _architecture_menu(choices: Mapping[str, tuple]) -> dict[str, Any]:
    """One architecture at a time, with the static targets of its scenario."""
    every = sorted({number for both in choices.values() for part in both for number in part})

    def button(label: str, shown: Sequence[int]) -> dict[str, Any]:
        visible = [number in shown for number in every]
        return {"label": label, "method": "restyle", "args": [{"visible": visible}, every]}

    buttons = [
        button(f"Scenario {name}", [*traces, *targets])
        for name, (traces, targets) in choices.items()
    ]
    return {"buttons": [*buttons, button("no architecture", [])], "name": "architecture"}


def _box(bounds_km: NDArray[np.float64]) -> dict[str, Any]:
    """Ranges of the axes, with the ratio that gives them equal scales."""
    extent = np.diff(bounds_km, axis=1)[:, 0]
    ratio = extent / np.cbrt(np.prod(extent))
    return {
        **{f"scene.{x}axis.range": bounds_km[k].tolist() for k, x in enumerate("xyz")},
        "scene.aspectratio": dict(zip("xyz", ratio.tolist(), strict=True)),
    }


def _view_menu(parts: PageParts) -> dict[str, Any]:
    """Everything, or a cube around a place."""

    def cube(x_km: float, half_km: float) -> dict[str, Any]:
        center = np.array([x_km, 0.0, 0.0])
        return _box(np.column_stack((center - half_km, center + half_km)))

    views = {
        "everything": _box(parts.bounds_km),
        "Earth to Moon": cube(parts.moon_km - 0.5 * LENGTH_UNIT_KM, 300_000.0),
        "orbits about the Moon": cube(parts.moon_km, 90_000.0),
        "low lunar orbits": cube(parts.moon_km, 15_000.0),
        "Earth": cube(parts.moon_km - LENGTH_UNIT_KM, 50_000.0),
    }
    return {
        "buttons": [
            {"label": f"View: {name}", "method": "relayout", "args": [change]}
            for name, change in views.items()
        ],
        "name": "view",
    }


def _library_menu(library: Sequence[int]) -> dict[str, Any]:
    states = {"Library: shown": True, "Library: by family": "legendonly", "Library: hidden": False}
    return {
        "buttons": [
            {"label": label, "method": "restyle", "args": [{"visible": state}, list(library)]}
            for label, state in states.items()
        ],
        "name": "library",
    }


def _animation(duration_ms: int) -> dict[str, Any]:
    return {
        "mode": "immediate",
        "frame": {"duration": duration_ms, "redraw": True},
        "transition": {"duration": 0},
        "fromcurrent": True,
    }


def _play_buttons() -> dict[str, Any]:
    return {
        "type": "buttons", "direction": "left", "showactive": False, "name": "play",
        "x": 0.0, "xanchor": "left", "y": -0.01, "yanchor": "top", "pad": {"r": 8},
        "buttons": [
            {"label": "Play", "method": "animate",
             "args": [None, _animation(120)]},
            {"label": "Pause", "method": "animate",
             "args": [[None], _animation(0)]},
        ],
    }  # fmt: skip


def _slider(hours: ArrayLike) -> dict[str, Any]:
    return {
        "x": 0.09, "xanchor": "left", "len": 0.9, "y": 0.0, "yanchor": "top",
        "currentvalue": {"prefix": "time since the epoch: ", "suffix": " h", "xanchor": "left"},
        "pad": {"t": 0, "b": 0},
        "steps": [
            {"label": f"{hour:.1f}", "method": "animate",
             "args": [[f"{hour:.1f}"], _animation(0)]}
            for hour in hours
        ],
    }  # fmt: skip
