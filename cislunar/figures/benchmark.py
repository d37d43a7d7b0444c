"""Scores of a submission to the benchmark at its scoring epochs."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cislunar.figures import axes as layout
from cislunar.figures import style
from cislunar.figures.axes import Grid

_LEFT, _FOOT, _GAP, _BETWEEN, _HEAD = 0.62, 0.72, 0.75, 0.55, 0.3
_WIDTH_IN, _HEIGHT_IN = 2.75, 1.5

_PANELS = (
    ("share of findable objects (%)", 100.0, False,
     {"completeness": "in the catalog", "custody": "within 10 km"}),
    ("position error (km)", 1.0, True,
     {"position_median_km": "median", "position_95_km": "95th percentile"}),
    ("GOSPA distance (km)", 1.0, True, {"gospa_km": "GOSPA distance"}),
    ("ANEES (1)", 1.0, True, {"anees": "ANEES"}),
)  # fmt: skip
"""Label, factor, whether the axis is logarithmic, and columns with their names."""

_SERIES = (
    style.SeriesStyle("", style.BLUE, style.SOLID, "o"),
    style.SeriesStyle("", style.VERMILION, style.DASHED, "s"),
)


@style.house_style()
def score_figure(table: pd.DataFrame) -> Figure:
    """Draw a score against the time since the first day.

    Parameters
    ----------
    table : DataFrame
        Rows of `cislunar.benchmark.score_submission`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    grid = Grid(2, 2, _WIDTH_IN, _HEIGHT_IN, _LEFT, _FOOT, _GAP, _BETWEEN)
    width, height = grid.size
    figure = style.new_figure(_FOOT + height + _HEAD, _LEFT + width + 0.15)
    dates = pd.to_datetime(table["epoch_utc"])
    day = dates.iloc[0].normalize()
    hours = ((dates - day).dt.total_seconds() / 3600.0).to_numpy()
    for number, (label, factor, log, columns) in enumerate(_PANELS):
        axes = grid.place(figure, *divmod(number, 2))
        values = factor * table[[*columns]].to_numpy(dtype=float)
        for column, (name, series) in enumerate(zip(columns.values(), _SERIES, strict=False)):
            axes.plot(
                hours,
                values[:, column],
                label=name,
                **series.line_kwargs(),
                **series.marker_kwargs(),
            )
        if label.startswith("ANEES"):
            axes.axhline(1.0, color="0.6", linewidth=0.6, zorder=1)
        if np.isfinite(values).any():
            limits = layout.reach(values, log=True) if log else (-4.0, 104.0)
            layout.set_vertical(axes, limits, log=log)
        else:
            layout.note_empty(axes, "nothing to evaluate")
        axes.set_ylabel(label)
        if number >= 2:
            axes.set_xlabel("time (h)")
        if len(columns) > 1:
            axes.legend()
        layout.panel_title(axes, number, "")
    first, last = table.iloc[0], table.iloc[-1]
    layout.note_below(
        figure,
        f"Time since {day:%Y-%m-%d} 00:00 UTC. {last['objects']} objects, of which "
        f"{last['findable']} are findable at the end ({first['findable']} at the first epoch). "
        f"ANEES: 1 for a consistent catalog.",
    )
    return figure
