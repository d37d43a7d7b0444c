"""Detection and latency against the change of velocity, and custody against the time after it."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cislunar.figures import axes as layout
from cislunar.figures import style

_USUAL = {
    "observers": 20,
    "estimator": "mukf",
    "dynamics": "cr3bp",
    "clutter": 0.0,
    "delay_minutes": 0.0,
    "days": 1.5,
}
_SERIES = {
    ("paper", 100): style.SeriesStyle(
        "(a), (b): tasking every hour, 100 targets", style.VERMILION, style.SOLID, "s"
    ),
    ("recommended", 100): style.SeriesStyle(
        "(a), (b): slots of 20 min, 100 targets", style.BLUE, style.SOLID, "o"
    ),
    ("recommended", 50): style.SeriesStyle(
        "(a), (b): slots of 20 min, 50 targets", style.GREEN, style.SOLID, "D"
    ),
}
_CLASSES = ((0.2, 0.5), (1.0, 10.0), (10.0, 100.0), (100.0, 500.0))
_COLORS = (style.ORANGE, style.SKY, style.BLACK, style.PURPLE)
_RESPONSES = {"none": (style.DOTTED, "x"), "recovery": (style.SOLID, "o")}

_WIDTH, _HEIGHT, _LEFT, _GAP, _FOOT, _HEAD = 1.75, 1.7, 0.75, 0.72, 1.3, 0.3


@style.house_style()
def maneuver_figure(table: pd.DataFrame) -> Figure:
    """Draw detection, latency and custody of ``tables/maneuvers.csv``."""
    for key, value in _USUAL.items():
        table = table[table[key] == value]
    width = _LEFT + 3 * _WIDTH + 2 * _GAP + 0.1
    figure = style.new_figure(_HEAD + _HEIGHT + _FOOT, width)
    drawn = []
    for number, title in enumerate(("detection", "latency", "custody")):
        left = _LEFT + number * (_WIDTH + _GAP)
        axes = layout.place(figure, left, _FOOT, _WIDTH, _HEIGHT)
        layout.panel_title(axes, number, title)
        drawn.append(axes)
    own = table[table["response"] == "recovery"]
    handles = [each.legend_handle() for each in _SERIES.values()]
    for (mode, targets), series in _SERIES.items():
        some = own[(own["mode"] == mode) & (own["targets"] == targets)]
        _against_size(drawn[0], some[some["quantity"] == "detected"], series, 100.0)
        _against_size(drawn[1], some[some["quantity"] == "latency_h"], series, 1.0)
    drawn[0].set_ylabel("maneuvers detected\nwithin 24 h, %")
    drawn[0].set_ylim(-3.0, 103.0)
    drawn[1].set_ylabel("median time from maneuver\nto alarm, h")
    drawn[1].set_ylim(bottom=0.0)
    for axes in drawn[:2]:
        axes.set_xscale("log")
        axes.set_xlabel("change of velocity, m/s")
    slots = table[(table["mode"] == "recommended") & (table["targets"] == 100)]
    for limits, color in zip(_CLASSES, _COLORS, strict=True):
        for response, (line, marker) in _RESPONSES.items():
            text = f"(c): {limits[0]:g} to {limits[1]:g} m/s"
            text += ", maneuver estimated" if response == "recovery" else ", detected only"
            series = style.SeriesStyle(text, color, line, marker)
            some = slots[(slots["response"] == response) & (slots["smallest_m_s"] == limits[0])]
            if len(some):
                _against_time(drawn[2], some, series)
                handles.append(series.legend_handle())
    drawn[2].set_ylabel("targets in custody, %")
    drawn[2].set_xlabel("time after the maneuver, h")
    drawn[2].set_ylim(-3.0, 103.0)
    note = "(c): slots of 20 min, 100 targets. Bars: exact 95 % binomial intervals."
    top = layout.note_below(figure, note)
    layout.legend_below(figure, handles, top, 3)
    return figure


def _draw(axes: Axes, at: np.ndarray, rows: pd.DataFrame, series, factor: float) -> None:
    value, low, high = (factor * rows[name].to_numpy(float) for name in ("value", "low", "high"))
    axes.errorbar(
        at,
        value,
        yerr=np.nan_to_num(np.maximum([value - low, high - value], 0.0)),
        color=series.color,
        linestyle=series.line,
        marker=series.marker,
        markersize=3.0,
        linewidth=0.9,
        elinewidth=0.6,
    )


def _against_size(axes: Axes, rows: pd.DataFrame, series, factor: float) -> None:
    middle = np.sqrt(rows["smallest_m_s"].to_numpy() * rows["largest_m_s"].to_numpy())
    _draw(axes, middle, rows, series, factor)


def _against_time(axes: Axes, rows: pd.DataFrame, series) -> None:
    found = rows["quantity"].str.fullmatch(r"custody_[0-9.]+_h")
    rows = rows[found]
    hours = rows["quantity"].str.extract(r"custody_([0-9.]+)_h")[0].to_numpy(float)
    order = np.argsort(hours, kind="stable")
    _draw(axes, hours[order], rows.iloc[order], series, 100.0)
