"""Figures of the search: J against the number of satellites and of evaluations."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, PercentFormatter

from cislunar.architecture.published import PUBLISHED_COST
from cislunar.figures import style
from cislunar.figures.axes import Array, Grid, note_empty, panel_title, widened
from cislunar.figures.panels import draw_best

_COLUMNS = 3
"""Scenarios side by side."""

_OTHER_RUNS = {"linestyle": "none", "marker": "o", "markersize": 3.0, "alpha": 0.55,
               "markeredgewidth": 0}  # fmt: skip
_BEST = {"color": style.BLACK, "linewidth": 1.2, "zorder": 2}
_DAYS = {"color": style.BLACK, "linewidth": 0.8, "linestyle": ":"}
_PAPER_MARKER = {"tpe": "o", "random": "s"}
_LEFT_IN, _RIGHT_IN, _GAP_IN = 0.72, 0.07, 0.5


def _layout(number: int, height_in: float, row_in: float, foot_in: float) -> tuple[Grid, Figure]:
    """Panels for a number of scenarios, and their figure, narrow for a single one."""
    columns = min(number, _COLUMNS)
    rows = -(-number // columns)
    width = style.PAGE_WIDTH_IN if columns > 1 else 0.62 * style.PAGE_WIDTH_IN
    each = (width - _LEFT_IN - _RIGHT_IN - _GAP_IN * (columns - 1)) / columns
    between = row_in - height_in
    grid = Grid(rows, columns, each, height_in, _LEFT_IN, foot_in + 0.42, _GAP_IN, between)
    return grid, style.new_figure(foot_in + row_in * rows, width)


@style.house_style()
def satellite_front_figure(
    fronts: Mapping[str, xr.Dataset],
    architectures: Mapping[str, Mapping[str, xr.Dataset]],
    coverage: pd.DataFrame,
) -> Figure:
    """Draw the best J and its coverage by prescribed number of satellites, by scenario.

    The data are ``architecture/{scenario}/front.nc`` by scenario, ``{optimizer}.nc`` by scenario
    and optimizer, and ``tables/architecture.csv``.
    """
    tall = 1.9
    below, figure = _layout(len(fronts), tall, 4.75, 0.5)
    above = below._replace(foot=below.foot + tall + 0.3)
    for index, (scenario, front) in enumerate(fronts.items()):
        row, column = divmod(index, below.columns)
        upper, lower = (grid.place(figure, row, column) for grid in (above, below))
        panel_title(upper, index, f"Scenario {scenario}")
        total = front["total"].values
        upper.plot(total, front["J"].values, **_BEST)
        lower.plot(total, front["union_coverage"].values, **_BEST)
        lower.plot(total, front["target_days"].values, **_DAYS)
        _mark_optimizers(upper, lower, architectures[scenario], _of(coverage, scenario))
        if not np.any(front["J"].values):
            note_empty(upper, "J = 0: no target is ever visible")
        for method, (value, count) in PUBLISHED_COST.get(scenario, {}).items():
            upper.plot(count, value, **_paper_kwargs(method))
        if any(np.any(np.asarray(line.get_ydata()) > 0.0) for line in upper.lines):
            upper.set_yscale("log")
        lower.set_ylim(0.0, 1.0)
        lower.yaxis.set_major_formatter(PercentFormatter(xmax=1.0, symbol=""))
        reach = (upper.get_xlim(), lower.get_xlim())
        for axes in (upper, lower):
            axes.set_xlim(widened(min(r[0] for r in reach), max(r[1] for r in reach)))
            axes.xaxis.set_major_locator(MaxNLocator(nbins=6, integer=True, steps=[1, 2, 5, 10]))
        upper.tick_params(labelbottom=False)
        lower.set_xlabel("number of satellites")
        if column == 0:
            upper.set_ylabel("figure of merit J,\ndimensionless")
            lower.set_ylabel("target-hours visible to\nany satellite, %")
    _legend(figure, _front_handles(architectures, fronts))
    return figure


def _of(coverage: pd.DataFrame, scenario: str) -> pd.DataFrame:
    """One row for each optimizer of a scenario, indexed by optimizer."""
    rows = coverage[coverage["scenario"].astype(str) == scenario]
    return rows.drop_duplicates("optimizer").set_index("optimizer")


def _mark_optimizers(upper: Axes, lower: Axes, found: Mapping, coverage: pd.DataFrame) -> None:
    """Draw the architecture of each optimizer, and with faint markers those of its other runs."""
    for optimizer, architecture in found.items():
        series = style.optimizer_style(optimizer)
        if "run_J" in architecture:
            at, value = architecture["run_satellites"].values, architecture["run_J"].values
            faint = _OTHER_RUNS | {"marker": series.marker}
            upper.plot(at, value, color=series.color, zorder=3, **faint)
        count = int(architecture["satellites"].sum())
        dot = series.point_kwargs(5.0) | {"zorder": 4}
        upper.plot(count, float(architecture["J"]), **dot)
        if optimizer in coverage.index:
            lower.plot(count, float(coverage.loc[optimizer, "union_coverage"]), **dot)


def _paper_kwargs(method: str) -> dict:
    return {
        "linestyle": "none", "marker": _PAPER_MARKER.get(method, "v"), "markersize": 6.5,
        "markerfacecolor": "none", "markeredgecolor": style.BLACK, "markeredgewidth": 1.1,
        "zorder": 5,
    }  # fmt: skip


def _present(architectures: Mapping[str, Mapping]) -> list[str]:
    """Optimizers of any scenario, in order of appearance."""
    return list(dict.fromkeys(name for found in architectures.values() for name in found))


def _paper_methods(scenarios: Sequence[str]) -> list[str]:
    """Methods for which the paper states J in these scenarios."""
    return list(dict.fromkeys(m for s in scenarios for m in PUBLISHED_COST.get(s, {})))


def _front_handles(architectures: Mapping, fronts: Mapping) -> list[Line2D]:
    handles = [
        Line2D([], [], label="maximum J found", **_BEST),
        Line2D([], [], label="target-days in place of target-hours", **_DAYS),
    ]
    for name in _present(architectures):
        handles.append(style.optimizer_style(name).legend_handle(line=False))
    if any("run_J" in each for found in architectures.values() for each in found.values()):
        label = "other runs of the search"
        handles.append(Line2D([], [], label=label, color=style.GRAY, **_OTHER_RUNS))
    for method in _paper_methods(list(fronts)):
        label = _printed(method)
        handles.append(Line2D([], [], label=label, **_paper_kwargs(method)))
    return handles


def _legend(figure: Figure, handles: Sequence) -> None:
    columns = 2 if figure.get_size_inches()[0] < style.PAGE_WIDTH_IN else 3
    figure.legend(handles=list(handles), loc="lower center", ncols=columns, handlelength=2.6)


@style.house_style()
def convergence_figure(
    runs: Mapping[str, Mapping[str, Mapping[str, xr.Dataset]]],
    architectures: Mapping[str, Mapping[str, xr.Dataset]],
) -> Figure:
    """Draw the best J so far against the evaluations of every optimizer, a panel per scenario.

    Several runs of a search are drawn by their median and range; a run that has stopped keeps its
    last value. Triangles mark where the early stop ends a run. The data are
    ``architecture/{scenario}/runs/*.nc`` by scenario, method and run, and ``{optimizer}.nc`` by
    scenario and optimizer.
    """
    row_in = 2.95
    grid, figure = _layout(len(architectures), row_in - 0.7, row_in, 0.62)
    for index, (scenario, found) in enumerate(architectures.items()):
        row, column = divmod(index, grid.columns)
        axes = grid.place(figure, row, column)
        panel_title(axes, index, f"Scenario {scenario}")
        for optimizer, architecture in found.items():
            if optimizer in runs.get(scenario, {}):
                stops = architecture["run_evaluations"].values
                _spread(axes, optimizer, [*runs[scenario][optimizer].values()], stops)
            elif optimizer == "published":
                level = style.optimizer_style(optimizer).line_kwargs()
                axes.axhline(float(architecture["J"]), linewidth=1.2, zorder=2, **level)
            else:
                _climb(axes, optimizer, architecture)
        if not any(float(each["J"]) for each in found.values()):
            note_empty(axes, "J = 0: no target is ever visible")
        for method, (value, _) in PUBLISHED_COST.get(scenario, {}).items():
            axes.axhline(value, zorder=1, **_paper_line(method))
        axes.set(xscale="log", yscale="log", xlabel="number of evaluations of J")
        if column == 0:
            axes.set_ylabel("best J so far,\ndimensionless")
    _legend(figure, _convergence_handles(runs, architectures))
    return figure


def _paper_line(method: str) -> dict:
    dashes = "-" if method == "tpe" else "--"
    return {"color": style.GRAY, "linewidth": 0.9, "linestyle": dashes}


def _printed(method: str) -> str:
    return f"value printed in the paper, {style.optimizer_style(method).label}"


def best_so_far(histories: Sequence[Array]) -> Array:
    """Best J so far of every run, shape (run, evaluation), from the J of its evaluations.

    A run that has ended keeps its last value; zero (a repeated orbit) counts as no value.
    """
    longest = max(len(history) for history in histories)
    best = np.full((len(histories), longest), np.nan)
    for row, history in zip(best, histories, strict=True):
        running = np.maximum.accumulate(history)
        row[: len(running)] = np.where(running > 0.0, running, np.nan)
        row[len(running) :] = row[len(running) - 1]
    return best


def _thinned(length: int) -> Array:
    """Evaluations, counted from zero, that are drawn on a logarithmic axis."""
    steps = np.unique(np.geomspace(1, length, 600).round().astype(int)) if length > 1 else [1]
    return np.asarray(steps) - 1


def _spread(axes: Axes, optimizer: str, found: Sequence[xr.Dataset], stops) -> None:
    """Draw median and range of the runs of a search, with their early stops."""
    series = style.optimizer_style(optimizer)
    best = best_so_far([run["J_history"].values for run in found])
    at = _thinned(best.shape[1])
    some = at[np.all(np.isfinite(best[:, at]), axis=0)]
    draw_best(axes, some + 1, best[:, some], series, 3)
    for row, stop in zip(best, stops, strict=True):
        axes.plot(stop, row[stop - 1], **_stop_kwargs(series.color))


def _stop_kwargs(color: str) -> dict:
    return {
        "linestyle": "none", "marker": "v", "markersize": 3.6, "color": color,
        "markeredgecolor": style.BLACK, "markeredgewidth": 0.3, "zorder": 4,
    }  # fmt: skip


def _climb(axes: Axes, optimizer: str, architecture: xr.Dataset) -> None:
    """Draw the history of one search, and the bound proven for it."""
    series = style.optimizer_style(optimizer)
    best = best_so_far([architecture["J_history"].values])[0]
    at = _thinned(len(best))
    axes.plot(at + 1, best[at], zorder=3, drawstyle="steps-post", **series.line_kwargs())
    axes.plot(len(best), float(architecture["J"]), zorder=5, **series.point_kwargs(5.0))
    if "bound" in architecture:
        axes.axhline(float(architecture["bound"]), color=style.BLACK, linewidth=0.8, zorder=1)


def _convergence_handles(runs: Mapping, architectures: Mapping) -> Iterator:
    """Legend entries of optimizers, bands, early stops, bounds and values of the paper."""
    for name in _present(architectures):
        series = style.optimizer_style(name)
        yield Line2D([], [], label=series.label, **series.line_kwargs())
    if any(runs.values()):
        yield Patch(facecolor=style.GRAY, alpha=0.35, label="range over runs (line: median)")
        yield Line2D([], [], label="early stop of a run", **_stop_kwargs(style.GRAY))
    if any("bound" in found for each in architectures.values() for found in each.values()):
        yield Line2D([], [], color=style.BLACK, linewidth=0.8, label="proven upper bound")
    for method in _paper_methods(list(architectures)):
        yield Line2D([], [], label=_printed(method), **_paper_line(method))
