"""Axes, menus and time slider of the interactive page of orbits."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cislunar.constants import LENGTH_UNIT_KM

_MENUS_PX = 0, 230, 430
"""Places of the menus."""
_BUTTONS_PX = 150
"""Width of the buttons beside the time slider, which begins behind them."""
_WHITE = "rgba(255, 255, 255, 0.85)"

VIEWS = {
    "Earth to Moon": (0.5, 300_000.0),
    "orbits about the Moon": (1.0, 90_000.0),
    "low lunar orbits": (1.0, 15_000.0),
    "Earth": (0.0, 50_000.0),
}
"""Views by name: the center of a cube, on the line from the Earth (0) to the Moon (1), and half of
the length of its edges, km."""


class PageParts(NamedTuple):
    """The parts of the page on which its controls act.

    `choices` holds for each architecture the numbers of its traces and those of the traces of its
    targets; `library` holds the numbers of the traces of orbits. `hours` are the times of the
    slider since the epoch. `moon_km` is the x coordinate of the Moon, `bounds_km`, shape (3, 2),
    the least and greatest coordinates of everything shown.
    """

    choices: Mapping[str, tuple[Sequence[int], Sequence[int]]]
    library: Sequence[int]
    hours: ArrayLike
    moon_km: float
    bounds_km: NDArray[np.float64]


def page_layout(parts: PageParts) -> dict[str, Any]:
    """Layout of the page, as arguments of ``plotly.graph_objects.Layout``."""
    menus = [_view_menu(parts), _library_menu(parts.library), _play_buttons()]
    if parts.choices:
        menus.insert(0, _architecture_menu(parts.choices))
    for menu, left in zip(menus[:-1], _MENUS_PX, strict=False):
        menu.update(x=0.0, xanchor="left", y=1.0, yanchor="top", bgcolor=_WHITE, pad={"l": left})
    return {
        **scene_layout(parts.bounds_km), "updatemenus": menus, "sliders": [_slider(parts.hours)],
    }  # fmt: skip


def scene_layout(bounds_km: NDArray[np.float64]) -> dict[str, Any]:
    """Layout of axes at equal scales and of the legend, as arguments of
    ``plotly.graph_objects.Layout``.

    Parameters
    ----------
    bounds_km : ndarray, shape (3, 2)
        Least and greatest coordinates, rotating frame, km.
    """
    return {
        "scene": _scene(bounds_km),
        "legend": {
            "x": 0.995, "xanchor": "right", "y": 0.98, "yanchor": "top", "bgcolor": _WHITE,
            "tracegroupgap": 2, "itemsizing": "constant", "font": {"size": 11},
        },
        "margin": {"l": 10, "r": 10, "t": 10, "b": 10},
        "separators": ".\N{THIN SPACE}",
        "uirevision": "fixed",
        "hoverlabel": {"align": "left"},
    }  # fmt: skip


def _scene(bounds_km: NDArray[np.float64]) -> dict[str, Any]:
    axis = {
        "tickformat": ",d", "showbackground": False, "gridcolor": "#DDDDDD",
        "zerolinecolor": "#BBBBBB", "showspikes": False, "nticks": 6,
    }  # fmt: skip
    box = _box(bounds_km)
    titled = {
        f"{x}axis": {**axis, "title": {"text": f"{x}, km, rotating frame"},
                     "range": box[f"scene.{x}axis.range"]}
        for x in "xyz"
    }  # fmt: skip
    eye, center = {"x": 0.65, "y": -1.65, "z": 0.8}, {"x": 0, "y": 0, "z": -0.15}
    return {
        **titled, "aspectmode": "manual", "aspectratio": box["scene.aspectratio"],
        "camera": {"eye": eye, "center": center}, "dragmode": "orbit",
    }  # fmt: skip


def _architecture_menu(choices: Mapping[str, tuple]) -> dict[str, Any]:
    """Menu that shows one architecture with the static targets of its scenario."""
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
    """Ranges of the axes, with the aspect ratio that gives equal scales."""
    extent = np.diff(bounds_km, axis=1)[:, 0]
    ratio = extent / np.cbrt(np.prod(extent))
    return {
        **{f"scene.{x}axis.range": bounds_km[k].tolist() for k, x in enumerate("xyz")},
        "scene.aspectratio": dict(zip("xyz", ratio.tolist(), strict=True)),
    }


def _view_menu(parts: PageParts) -> dict[str, Any]:
    """Menu of views: everything, or a cube around a place."""

    def cube(along: float, half_km: float) -> dict[str, Any]:
        center = np.array([parts.moon_km + (along - 1.0) * LENGTH_UNIT_KM, 0.0, 0.0])
        return _box(np.column_stack((center - half_km, center + half_km)))

    views = {"everything": _box(parts.bounds_km)}
    views |= {name: cube(*view) for name, view in VIEWS.items()}
    buttons = [
        {"label": f"View: {name}", "method": "relayout", "args": [change]}
        for name, change in views.items()
    ]
    return {"buttons": buttons, "name": "view"}


def _library_menu(library: Sequence[int]) -> dict[str, Any]:
    states = {"Library: shown": True, "Library: by family": "legendonly", "Library: hidden": False}
    buttons = [
        {"label": label, "method": "restyle", "args": [{"visible": state}, list(library)]}
        for label, state in states.items()
    ]
    return {"buttons": buttons, "name": "library"}


def _animation(duration_ms: int) -> dict[str, Any]:
    frame, still = {"duration": duration_ms, "redraw": True}, {"duration": 0}
    return {"mode": "immediate", "frame": frame, "transition": still, "fromcurrent": True}


def _play_buttons() -> dict[str, Any]:
    return {
        "type": "buttons", "direction": "left", "showactive": False, "name": "play",
        "x": 0.0, "xanchor": "left", "y": -0.01, "yanchor": "top", "pad": {"r": 8},
        "buttons": [
            {"label": "Play", "method": "animate", "args": [None, _animation(120)]},
            {"label": "Pause", "method": "animate", "args": [[None], _animation(0)]},
        ],
    }  # fmt: skip


def _slider(hours: ArrayLike) -> dict[str, Any]:
    return {
        "x": 0.0, "xanchor": "left", "len": 1.0, "y": 0.0, "yanchor": "top",
        "currentvalue": {"prefix": "time since the epoch: ", "suffix": " h", "xanchor": "left"},
        "pad": {"t": 0, "b": 0, "l": _BUTTONS_PX},
        "steps": [
            {"label": f"{hour:.1f}", "method": "animate", "args": [[f"{hour:.1f}"], _animation(0)]}
            for hour in hours
        ],
    }  # fmt: skip
