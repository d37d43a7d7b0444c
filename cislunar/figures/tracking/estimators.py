"""Both estimators beside the Cramer-Rao bound, over both sweeps."""

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from cislunar.campaign.claims.verdicts import usual_interval
from cislunar.campaign.tracking.summary import cell_index
from cislunar.campaign.tracking.tables import PRACTICAL_UNITS
from cislunar.figures.space.scene import Array
from cislunar.figures.style import (
    BLACK,
    BLUE,
    DASHED,
    DOTTED,
    SOLID,
    VERMILION,
    SeriesStyle,
    house_style,
)
from cislunar.figures.tracking.panels import Curve, Panel, Row, sweep_figure

ESTIMATOR_STYLES = {
    "mukf": SeriesStyle("filter of the paper (MUKF)", VERMILION, DASHED, "s"),
    "batch": SeriesStyle("multi-hypothesis batch", BLUE, SOLID, "o"),
}
BOUND_STYLE = SeriesStyle("Cramér-Rao bound", BLACK, DOTTED, "x", filled=False)


def _bound(quantity: str) -> Curve:
    """The bound, which both estimators share: their measurements are all but the same."""
    return Curve(quantity, only="batch", style=BOUND_STYLE)


ROWS = (
    Row("attitude within\n3\N{GREEK SMALL LETTER SIGMA}, % of time",
        (Curve("coverage", "attitude"),), factor=100.0, reference=99.7),
    Row("final attitude error,\nmedian, degree",
        (Curve("final_attitude_error_median"), _bound("bound_attitude_median")), log=True),
    Row("final attitude error,\n90th pct., degree",
        (Curve("final_attitude_error_90"), _bound("bound_attitude_90")), log=True),
    Row("attitude error over\nbound, median", (Curve("bound_ratio_median", "attitude"),),
        log=True, reference=1.0),
    Row("attitude RMSE of the\nrun, median, degree", (Curve("rmse_median", "attitude"),),
        factor=PRACTICAL_UNITS["attitude"][1], log=True),
    Row("rotation diverged,\ntargets", (Curve("diverged_rotation"),)),
    Row("position RMSE,\nmedian, km", (Curve("rmse_median", "position", False),),
        factor=PRACTICAL_UNITS["position"][1], log=True),
)  # fmt: skip


def _estimators(summary: xr.Dataset) -> list[str]:
    """Those with a look of their own, in the order of the summary."""
    found = dict.fromkeys(summary["estimator"].values.astype(str))
    return [name for name in found if name in ESTIMATOR_STYLES]


def _panel(summary: xr.Dataset, title: str, scenario: str, **wanted: int) -> Panel:
    """Cells of the scenario's first architecture, for every estimator."""
    of_scenario = summary["scenario"].values.astype(str) == scenario
    architecture = str(summary["architecture"].values[of_scenario][0])
    cells = {
        name: cell_index(
            summary, scenario=scenario, architecture=architecture, estimator=name, variant="",
            **wanted,
        )
        for name in _estimators(summary)
    }  # fmt: skip
    cells = {name: index for name, index in cells.items() if index.size}
    return Panel(title, cells, f"observers: {architecture}" if cells else "")


@house_style()
def estimators_against_targets_figure(summary: xr.Dataset) -> Figure:
    """Both estimators and the bound against the number of targets, a column for each scenario.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.

    Returns
    -------
    matplotlib.figure.Figure
    """
    usual = usual_interval(summary)
    panels = [
        _panel(summary, f"scenario {name}", name, interval_minutes=usual)
        for name in dict.fromkeys(summary["scenario"].values.astype(str))
    ]
    return _figure(
        summary,
        [panel for panel in panels if panel.cells],
        lambda index: summary["targets"].values[index].astype(float),
        "number of targets $n_T$",
    )


@house_style()
def estimators_against_interval_figure(summary: xr.Dataset) -> Figure:
    """Both estimators and the bound against the tasking interval.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.

    Returns
    -------
    matplotlib.figure.Figure
        A column for each scenario and number of targets of the sweep.
    """
    pairs = zip(summary["scenario"].values.astype(str), summary["targets"].values, strict=True)
    panels = []
    for scenario, targets in sorted(set(pairs)):
        title = f"scenario {scenario}, $n_T$ = {int(targets)}"
        panel = _panel(summary, title, scenario, targets=int(targets))
        swept = {
            name: index
            for name, index in panel.cells.items()
            if np.unique(summary["interval_minutes"].values[index]).size > 1
        }
        if swept:
            panels.append(panel._replace(cells=swept))
    return _figure(
        summary,
        panels,
        lambda index: summary["interval_minutes"].values[index] / 60.0,
        "tasking interval $T_{ST}$, h",
    )


def _figure(
    summary: xr.Dataset, panels: Sequence[Panel], x_of: Callable[[Array], Array], x_label: str
) -> Figure:
    styles = {name: ESTIMATOR_STYLES[name] for name in _estimators(summary)}
    figure = sweep_figure(summary, panels, ROWS, styles, x_of, x_label)
    figure.legend(
        handles=[style.legend_handle() for style in (*styles.values(), BOUND_STYLE)],
        loc="lower center",
        ncols=3 if figure.get_size_inches()[0] > 5.0 else 1,
        bbox_to_anchor=(0.5, 0.1 / figure.get_size_inches()[1]),
        borderaxespad=0.0,
        handlelength=2.8,
    )
    return figure
