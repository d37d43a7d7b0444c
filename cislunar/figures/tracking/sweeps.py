"""Both sweeps as a whole: statistics over the targets with confidence intervals over seeds."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cislunar.campaign.claims.verdicts import usual_interval
from cislunar.campaign.tracking.summary import cell_index
from cislunar.campaign.tracking.tables import PRACTICAL_UNITS
from cislunar.figures.space.scene import Array
from cislunar.figures.style import BLACK, GRAY, house_style, optimizer_style
from cislunar.figures.tracking.panels import Curve, Panel, Row, sweep_figure

ROWS = (
    Row(
        "within 3\N{GREEK SMALL LETTER SIGMA}, % of time",
        (Curve("coverage", "attitude"), Curve("coverage", "position", False)),
        factor=100.0,
    ),
    Row(
        "median ANEES,\ndimensionless",
        (Curve("anees_median", "attitude"), Curve("anees_median", "position", False)),
        log=True,
        reference=1.0,
    ),
    Row(
        "attitude RMSE,\nGRP, nondim.",
        (Curve("rmse_median", "attitude"),),
        log=True,
        second=("degree", PRACTICAL_UNITS["attitude"][1]),
    ),
    Row(
        "position RMSE,\nnondim.",
        (Curve("rmse_median", "position", False),),
        log=True,
        second=("km", PRACTICAL_UNITS["position"][1]),
    ),
    Row("final attitude\nerror, degree", (Curve("final_attitude_error_median"),), log=True),
    Row("never observed,\ntargets", (Curve("never_observed"),)),
    Row(
        "diverged, % of\nobserved targets",
        (Curve("diverged_rotation_share"), Curve("diverged_translation_share", None, False)),
        factor=100.0,
    ),
)


def _architectures(summary: xr.Dataset) -> list[str]:
    return list(dict.fromkeys(summary["architecture"].values.astype(str)))


def _panel(summary: xr.Dataset, title: str, **wanted: Any) -> Panel:
    """Cells with the usual settings, for every architecture that has some."""
    estimator = str(summary["estimator"].values[0])
    found = {
        name: cell_index(summary, architecture=name, estimator=estimator, variant="", **wanted)
        for name in _architectures(summary)
    }
    return Panel(title, {name: index for name, index in found.items() if index.size})


@house_style()
def against_targets_figure(summary: xr.Dataset) -> Figure:
    """Every statistic against the number of targets, a column for each scenario.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.

    Returns
    -------
    matplotlib.figure.Figure
    """
    usual = usual_interval(summary)
    scenarios = list(dict.fromkeys(summary["scenario"].values.astype(str)))
    panels = [
        _panel(summary, f"scenario {name}", scenario=name, interval_minutes=usual)
        for name in scenarios
    ]
    return _sweep_figure(
        summary,
        [panel for panel in panels if panel.cells],
        lambda index: summary["targets"].values[index].astype(float),
        "number of targets $n_T$",
    )


@house_style()
def against_interval_figure(summary: xr.Dataset) -> Figure:
    """Every statistic against the tasking interval, a column for each scenario and target count.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.

    Returns
    -------
    matplotlib.figure.Figure
    """
    pairs = zip(summary["scenario"].values.astype(str), summary["targets"].values, strict=True)
    panels = []
    for scenario, targets in sorted(set(pairs)):
        title = f"scenario {scenario}, $n_T$ = {int(targets)}"
        panel = _panel(summary, title, scenario=scenario, targets=targets)
        swept = {
            name: index
            for name, index in panel.cells.items()
            if np.unique(summary["interval_minutes"].values[index]).size > 1
        }
        if swept:
            panels.append(Panel(title, swept))
    return _sweep_figure(
        summary,
        panels,
        lambda index: summary["interval_minutes"].values[index] / 60.0,
        "tasking interval $T_{ST}$, h",
    )


def _sweep_figure(
    summary: xr.Dataset,
    panels: Sequence[Panel],
    x_of: Callable[[Array], Array],
    x_label: str,
) -> Figure:
    """All rows by all columns, with legend."""
    names = [n for n in _architectures(summary) if any(n in panel.cells for panel in panels)]
    styles = {name: optimizer_style(name) for name in names}
    noted = [panel._replace(note=_observers(summary, panel)) for panel in panels]
    figure = sweep_figure(summary, noted, ROWS, styles, x_of, x_label)
    _legend(figure, names)
    return figure


def _observers(summary: xr.Dataset, panel: Panel) -> str:
    """Observers of every architecture of a panel."""
    counts = [
        f"{optimizer_style(name).label.split()[0]} {int(summary['observers'].values[index[0]])}"
        for name, index in panel.cells.items()
    ]
    return f"observers: {', '.join(counts)}"


def _legend(figure: Figure, architectures: Sequence[str]) -> None:
    handles = [optimizer_style(name).legend_handle() for name in architectures]
    plain = {"color": BLACK, "linestyle": "none", "marker": "o", "markersize": 4.0}
    handles += [
        Line2D([], [], label="filled: attitude, rotation, all", **plain),
        Line2D([], [], label="hollow: position, translation", markerfacecolor="none", **plain),
        Line2D([], [], color=GRAY, linewidth=0.8, label="consistent filter (ANEES 1)"),
    ]
    width, height = figure.get_size_inches()
    narrow = {"fontsize": 5.6, "handlelength": 2.2, "columnspacing": 1.2} if width < 4.5 else {}
    figure.legend(
        handles=handles,
        loc="lower center",
        ncols=3 if width > 6.0 else 2,
        bbox_to_anchor=(0.5, 0.06 / height),
        borderaxespad=0.0,
        **{"handlelength": 2.8} | narrow,
    )
