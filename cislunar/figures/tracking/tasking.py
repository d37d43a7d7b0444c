"""Comparison of tasking methods: information, evaluations, computing time, and tracking."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from cislunar.campaign.tracking.realizations import cells_of, realizations, select, values_of
from cislunar.evaluation.intervals import log_interval, t_interval
from cislunar.figures import axes as layout
from cislunar.figures import panels, style
from cislunar.figures.axes import Array, Grid
from cislunar.figures.labels import PARTS, TASKING_METHODS, words
from cislunar.figures.panels import PERCENT, Row

METHODS: Mapping[str, style.SeriesStyle] = {
    name: style.SeriesStyle(TASKING_METHODS[name], *drawn)
    for name, drawn in {
        "exact": (style.GREEN, style.DASH_DOT, "*"),
        "greedy": (style.ORANGE, style.DOTTED, "^"),
        "tpe": (style.BLUE, style.SOLID, "o"),
        "tpe-compiled": (style.SKY, style.SOLID, "D"),
        "random": (style.VERMILION, style.DASHED, "s"),
    }.items()
}
"""Styles of the tasking methods."""

_LEFT, _RIGHT = 0.7, 0.12
_PANEL_IN, _BETWEEN_IN = 1.3, 0.68
_HEAD, _FOOT = 0.36, 1.36
_NAMES_IN = 1.1


OUTCOMES = (
    Row("attitude within 3\N{GREEK SMALL LETTER SIGMA}, % of time", ("coverage", "attitude"),
        100.0, within=PERCENT),
    Row("attitude RMSE, median, deg", ("rmse_median", "attitude"), PARTS[0].factor, log=True),
    Row("position RMSE, median, km", ("rmse_median", "position"), PARTS[2].factor, log=True),
)  # fmt: skip


def method_style(method: str) -> style.SeriesStyle:
    """Style of a tasking method."""
    return style.style_or_gray(METHODS, method, TASKING_METHODS.get(method, words(method)))


@style.house_style()
def tasking_figure(
    compared: xr.Dataset, summary: xr.Dataset, variants: Mapping[str, str]
) -> Figure:
    """Draw information against evaluations and time, and tracking with each method.

    The data sets are ``task2/tasking_comparison.nc`` and ``task2/summary.nc``; `variants` are those
    of `tasking_variants`.
    """
    cells = compared.sizes["cell"]
    tracked = _tracked_cells(realizations(summary), variants)
    rows = 2 + bool(tracked)
    grid = _grid(rows, cells, 0.52)
    figure = style.new_figure(_HEAD + grid.size[1] + _FOOT)
    for column in range(cells):
        here = compared.isel(cell=column)
        targets, observers = int(here["targets"]), int(np.ravel(compared["observers"])[0])
        title = f"{targets} targets, {observers} observers"
        for row, draw in enumerate((_against_evaluations, _against_time)):
            axes = grid.place(figure, row, column)
            draw(axes, here)
            layout.panel_title(axes, row * cells + column, title, fontsize=7.5)
            axes.set_ylabel("information,\n% of exact" if column == 0 else "")
    if tracked:
        grid = _grid(rows, len(OUTCOMES), 0.3, _NAMES_IN)
        for column, outcome in enumerate(OUTCOMES):
            axes = grid.place(figure, 2, column)
            _tracking(axes, tracked, outcome)
            axes.tick_params(labelleft=column == 0)
            layout.panel_title(axes, 2 * cells + column, "tracking", fontsize=7.5)
    _legend(figure, compared, tracked)
    return figure


def _grid(rows: int, columns: int, gap: float, left: float = _LEFT) -> Grid:
    width = (style.PAGE_WIDTH_IN - left - _RIGHT - gap * (columns - 1)) / columns
    return Grid(rows, columns, width, _PANEL_IN, left, _FOOT, gap, _BETWEEN_IN)


def _against_evaluations(axes: Axes, here: xr.Dataset) -> None:
    """Draw the best information so far, relative to the exact assignment.

    Of searches the median and the range over all epochs and runs, of other methods the median.
    """
    exact = here["direct_information"].sel(direct="exact").values
    usable = exact > 0.0
    levels = []
    for method in here["direct"].values.astype(str):
        share = 100.0 * here["direct_information"].sel(direct=method).values[usable] / exact[usable]
        series = method_style(method)
        levels.append(float(np.median(share)) if share.size else np.nan)
        axes.axhline(levels[-1], linewidth=1.2, zorder=3, **series.line_kwargs())
    for method in here["search"].values.astype(str):
        series = method_style(method)
        history = here["history"].sel(search=method).transpose("epoch", ...).values[usable]
        share = 100.0 * history / exact[usable][:, None, None]
        share = share.reshape(-1, share.shape[-1])
        at = np.flatnonzero(np.isfinite(share).any(axis=0))
        if at.size == 0:
            continue
        best = running_best(share[:, : at[-1] + 1])
        panels.draw_best(axes, np.arange(1, best.shape[1] + 1), best, series, 4)
        levels.append(float(best[:, 0].min()))
    axes.set_ylim(*layout.reach(levels, log=False, share=0.06))
    axes.set(xscale="log", xlabel="number of evaluations")
    axes.xaxis.labelpad = 1.0
    axes.yaxis.set_major_locator(MaxNLocator(5))


def running_best(history: Array) -> Array:
    """Best value so far, shape (run, evaluation); a run that has ended (NaN) keeps its last."""
    return np.maximum.accumulate(np.where(np.isfinite(history), history, -np.inf), axis=1)


def _against_time(axes: Axes, here: xr.Dataset) -> None:
    """Draw the share of the exact information against the computing time, for every budget."""
    exact = here["direct_information"].sel(direct="exact")
    for method in here["search"].values.astype(str):
        series = method_style(method)
        share = (100.0 * here["information"].sel(search=method) / exact).transpose("budget", ...)
        seconds = here["elapsed"].sel(search=method).transpose("budget", ...)
        budgets = share.sizes["budget"]
        pairs = [(seconds.values[b].ravel(), share.values[b].ravel()) for b in range(budgets)]
        points = np.array([(np.median(t), np.median(v)) for t, v in pairs if np.isfinite(v).all()])
        if points.size:
            axes.plot(*points.T, **series.line_kwargs(), **series.marker_kwargs(4.0))
    for method in here["direct"].values.astype(str):
        series = method_style(method)
        share = float((100.0 * here["direct_information"].sel(direct=method) / exact).median())
        seconds = float(here["direct_elapsed"].sel(direct=method).median())
        axes.plot(seconds, share, zorder=5, **series.point_kwargs(5.5))
    axes.set(xscale="log", xlabel="computing time of one tasking, s")
    axes.xaxis.set_major_locator(LogLocator(numticks=7))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.labelpad = 1.0
    axes.margins(x=0.1, y=0.12)


def _tracked_cells(frame: pd.DataFrame, variants: Mapping[str, str]) -> dict[str, pd.DataFrame]:
    """Cells tracked with each method, for those settings with which several were tried."""
    changed = {method: select(frame, variant=name) for name, method in variants.items() if name}
    found = {method: cells for method, cells in changed.items() if len(cells)}
    if not found:
        return {}
    every = pd.concat(found.values())
    keys = ("scenario", "architecture", "estimator", "interval_minutes")
    usual = select(frame, variant="", **{key: every[key].iloc[0] for key in keys})
    found[variants.get("", "exact")] = usual[usual["targets"].isin(every["targets"])]
    return {name: found[name] for name in sorted(found, key=_rank)}


def _rank(method: str) -> tuple[int, str]:
    known = list(METHODS)
    return (known.index(method) if method in known else len(known), method)


def _counts(tracked: Mapping[str, pd.DataFrame]) -> list[int]:
    """Numbers of targets of the tracked cells."""
    return sorted({n for cells in tracked.values() for n in cells["targets"]})


def _tracking(axes: Axes, tracked: Mapping[str, pd.DataFrame], outcome: Row) -> None:
    """Draw a statistic of tracking with each method, the methods along the vertical axis."""
    counts, drawn = _counts(tracked), []
    interval = log_interval if outcome.log else t_interval
    for place_of, (method, cells) in enumerate(tracked.items()):
        values = outcome.factor * values_of(cells, *outcome.curves).T
        for targets, own in zip(cells_of(cells)["targets"], values, strict=True):
            rank = counts.index(targets)
            series = method_style(method)._replace(filled=rank == 0, line="none")
            at = place_of + 0.22 * (rank - 0.5 * (len(counts) - 1))
            more = {"elinewidth": 0.9, "capsize": 2.0} | series.marker_kwargs(4.5)
            given = panels.estimates(own[None], [interval(own)]), series, outcome.within
            drawn.append(panels.draw_estimates(axes, at, *given, horizontal=True, **more))
    axes.set_yticks(range(len(tracked)), [method_style(method).label for method in tracked])
    axes.set_ylim(len(tracked) - 0.4, -0.6)
    axes.grid(False, axis="y")
    axes.set_xlabel(outcome.label, labelpad=1.0)
    values = np.concatenate(drawn)
    log = outcome.log and np.nanmin(values) > 0.0
    limits = layout.reach(values, log=log, share=0.08 if log else 0.1, least=1.15)
    if log:
        axes.set_xscale("log")
    axes.set_xlim(*limits)
    if log:
        layout.log_ticks(axes.xaxis, *limits)
    else:
        axes.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))


def _legend(figure: Figure, compared: xr.Dataset, tracked: Mapping[str, pd.DataFrame]) -> None:
    """Draw the legend, and a note on the realizations."""
    methods = {str(m) for key in ("direct", "search") for m in compared[key].values} | set(tracked)
    handles: list = [method_style(m).legend_handle() for m in sorted(methods, key=_rank)]
    label = "range over epochs and runs (line: median)"
    handles.append(Patch(facecolor=style.GRAY, alpha=0.35, label=label))
    plain = {"color": style.BLACK, "linestyle": "none", "marker": "o", "markersize": 4.0}
    for rank, count in enumerate(_counts(tracked)):
        face = {} if rank == 0 else {"markerfacecolor": "none"}
        handles.append(Line2D([], [], label=f"tracking of {count} targets", **plain, **face))
    seeds = [np.isfinite(values_of(cells, "coverage", "attitude")).sum(axis=0).max()
             for cells in tracked.values()]  # fmt: skip
    note = panels.realizations_note(seeds, geometric="on logarithmic axes")
    top = layout.note_below(figure, f"Tracking panels. {note}" if note else "")
    layout.legend_below(figure, handles, top, 3, handlelength=2.4, columnspacing=1.2)
