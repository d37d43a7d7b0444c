"""Tasking methods compared: information, evaluations, time, and what they do to tracking."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from cislunar.campaign.tracking.realizations import (
    PRACTICAL_UNITS,
    cells_of,
    realizations,
    select,
    values_of,
)
from cislunar.campaign.tracking.statistics import log_interval, t_interval
from cislunar.figures.axes import Array, Grid, legend_below, panel_title, reach, set_vertical
from cislunar.figures.panels import PERCENT, draw_best, draw_means
from cislunar.figures.style import (
    BLACK,
    BLUE,
    DASH_DOT,
    DASHED,
    DOTTED,
    GRAY,
    GREEN,
    ORANGE,
    PAGE_WIDTH_IN,
    SKY,
    SOLID,
    VERMILION,
    SeriesStyle,
    house_style,
    new_figure,
    style_or_gray,
)

METHODS: Mapping[str, SeriesStyle] = {
    "exact": SeriesStyle("exact", GREEN, DASH_DOT, "*"),
    "greedy": SeriesStyle("greedy", ORANGE, DOTTED, "^"),
    "tpe": SeriesStyle("TPE", BLUE, SOLID, "o"),
    "tpe-compiled": SeriesStyle("compiled TPE", SKY, SOLID, "D"),
    "random": SeriesStyle("random", VERMILION, DASHED, "s"),
}
"""How each tasking method is drawn."""

_LEFT, _RIGHT = 0.62, 0.12
_PANEL_IN, _BETWEEN_IN = 1.3, 0.68
_HEAD, _FOOT = 0.36, 0.98


class Outcome(NamedTuple):
    """A statistic of tracking."""

    label: str
    quantity: str
    part: str | None
    factor: float
    log: bool
    within: tuple[float, float] = (-np.inf, np.inf)


OUTCOMES = (
    Outcome("attitude within 3\N{GREEK SMALL LETTER SIGMA},\n% of time", "coverage", "attitude",
            100.0, False, PERCENT),
    Outcome("attitude RMSE,\nmedian, degree", "rmse_median", "attitude",
            PRACTICAL_UNITS["attitude"][1], True),
    Outcome("position RMSE,\nmedian, km", "rmse_median", "position",
            PRACTICAL_UNITS["position"][1], True),
)  # fmt: skip


def method_style(method: str) -> SeriesStyle:
    """How a tasking method is drawn; one without a style of its own is gray."""
    return style_or_gray(METHODS, method)


@house_style()
def tasking_figure(
    compared: xr.Dataset, summary: xr.Dataset, variants: Mapping[str, str]
) -> Figure:
    """Information against evaluations and time, and tracking with each method.

    `variants` are those of `tasking_variants`. From ``task2/tasking_comparison.nc`` and
    ``task2/summary.nc``.
    """
    cells = compared.sizes["cell"]
    tracked = _tracked_cells(realizations(summary), variants)
    rows = 2 + bool(tracked)
    grid = _grid(rows, cells, 0.52)
    figure = new_figure(_HEAD + grid.size[1] + _FOOT)
    for column in range(cells):
        here = compared.isel(cell=column)
        targets, observers = int(here["targets"]), int(np.ravel(compared["observers"])[0])
        title = f"$n_T$ = {targets}, {observers} observers"
        for row, draw in enumerate((_against_evaluations, _against_time)):
            axes = grid.place(figure, row, column)
            draw(axes, here)
            panel_title(axes, row * cells + column, title, fontsize=7.5)
            axes.set_ylabel("information, % of exact" if column == 0 else "")
    if tracked:
        grid = _grid(rows, len(OUTCOMES), 0.92)
        for column, outcome in enumerate(OUTCOMES):
            axes = grid.place(figure, 2, column)
            _tracking(axes, tracked, outcome)
            panel_title(axes, 2 * cells + column, "tracking", fontsize=7.5)
    _legend(figure, compared, tracked)
    return figure


def _grid(rows: int, columns: int, gap: float) -> Grid:
    width = (PAGE_WIDTH_IN - _LEFT - _RIGHT - gap * (columns - 1)) / columns
    return Grid(rows, columns, width, _PANEL_IN, _LEFT, _FOOT, gap, _BETWEEN_IN)


def _against_evaluations(axes: Axes, here: xr.Dataset) -> None:
    """Best information so far of the searches over all epochs and runs, median and range, as a
    share of the exact assignment's; the median of the others as levels."""
    exact = here["direct_information"].sel(direct="exact").values
    usable = exact > 0.0
    levels = []
    for method in here["direct"].values.astype(str):
        share = 100.0 * here["direct_information"].sel(direct=method).values[usable] / exact[usable]
        look = method_style(method)
        levels.append(float(np.median(share)) if share.size else np.nan)
        axes.axhline(levels[-1], color=look.color, linestyle=look.line, linewidth=1.2, zorder=3)
    for method in here["search"].values.astype(str):
        look = method_style(method)
        history = here["history"].sel(search=method).transpose("epoch", ...).values[usable]
        share = 100.0 * history / exact[usable][:, None, None]
        share = share.reshape(-1, share.shape[-1])
        at = np.flatnonzero(np.isfinite(share).any(axis=0))
        if at.size == 0:
            continue
        best = held(share[:, : at[-1] + 1])
        draw_best(axes, np.arange(1, best.shape[1] + 1), best, look, 4)
        levels.append(float(best[:, 0].min()))
    axes.set_ylim(*reach(levels, log=False, share=0.06))
    axes.set(xscale="log", xlabel="evaluations")
    axes.xaxis.labelpad = 1.0
    axes.yaxis.set_major_locator(MaxNLocator(5))


def held(history: Array) -> Array:
    """Best value so far, shape (run, evaluation); a run that has ended (NaN) keeps its last."""
    return np.maximum.accumulate(np.where(np.isfinite(history), history, -np.inf), axis=1)


def _against_time(axes: Axes, here: xr.Dataset) -> None:
    """Share of the exact information against the time of the computation, budget by budget."""
    exact = here["direct_information"].sel(direct="exact")
    for method in here["search"].values.astype(str):
        look = method_style(method)
        share = (100.0 * here["information"].sel(search=method) / exact).transpose("budget", ...)
        seconds = here["elapsed"].sel(search=method).transpose("budget", ...)
        budgets = share.sizes["budget"]
        pairs = [(seconds.values[b].ravel(), share.values[b].ravel()) for b in range(budgets)]
        points = np.array([(np.median(t), np.median(v)) for t, v in pairs if np.isfinite(v).all()])
        if points.size:
            axes.plot(*points.T, color=look.color, linestyle=look.line, **look.marker_kwargs(4.0))
    for method in here["direct"].values.astype(str):
        look = method_style(method)
        share = float((100.0 * here["direct_information"].sel(direct=method) / exact).median())
        seconds = float(here["direct_elapsed"].sel(direct=method).median())
        kwargs = look.marker_kwargs(5.5)
        axes.plot(seconds, share, color=look.color, linestyle="none", zorder=5, **kwargs)
    axes.set(xscale="log", xlabel="time of one tasking, s")
    axes.xaxis.set_major_locator(LogLocator(numticks=7))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.labelpad = 1.0
    axes.margins(x=0.1, y=0.12)


def _tracked_cells(frame: pd.DataFrame, variants: Mapping[str, str]) -> dict[str, pd.DataFrame]:
    """Cells tracked with each method, those of the usual settings where another was tried."""
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


def _tracking(axes: Axes, tracked: Mapping[str, pd.DataFrame], outcome: Outcome) -> None:
    """A statistic of tracking with each method, mean and interval over seeds."""
    counts, singles = _counts(tracked), []
    for place_of, (method, cells) in enumerate(tracked.items()):
        look = method_style(method)
        found = outcome.factor * values_of(cells, outcome.quantity, outcome.part).T
        for targets, values in zip(cells_of(cells)["targets"], found, strict=True):
            rank = counts.index(targets)
            singles.append(values)
            bounds = (log_interval if outcome.log else t_interval)(values)[:3]
            look = look._replace(filled=rank == 0, line="none")
            at = place_of + 0.22 * (rank - 0.5 * (len(counts) - 1))
            size = {"elinewidth": 0.9, "capsize": 2.0} | look.marker_kwargs(4.5)
            draw_means(axes, at, bounds, look, outcome.within, **size)
    names = [method_style(method).label.replace(" ", "\n") for method in tracked]
    axes.set_xticks(range(len(tracked)), names, fontsize=5.6)
    axes.set_xlim(-0.6, len(tracked) - 0.4)
    axes.grid(False, axis="x")
    axes.set_xlabel("tasking method", labelpad=1.0)
    axes.set_ylabel(outcome.label)
    values = np.concatenate(singles)
    log = outcome.log and np.nanmin(values) > 0.0
    limits = reach(values, log=log, share=0.0 if log else 0.1, least=1.3)
    set_vertical(axes, limits, log=log)
    if not log:
        axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))


def _legend(figure: Figure, compared: xr.Dataset, tracked: Mapping[str, pd.DataFrame]) -> None:
    methods = {str(m) for key in ("direct", "search") for m in compared[key].values} | set(tracked)
    handles: list = [method_style(m).legend_handle() for m in sorted(methods, key=_rank)]
    handles.append(
        Patch(facecolor=GRAY, alpha=0.35, label="range over epochs and runs (line: median)")
    )
    plain = {"color": BLACK, "linestyle": "none", "marker": "o", "markersize": 4.0}
    for rank, count in enumerate(_counts(tracked)):
        face = {} if rank == 0 else {"markerfacecolor": "none"}
        handles.append(Line2D([], [], label=f"$n_T$ = {count}", **plain, **face))
    legend_below(figure, handles, 0.06, 4, handlelength=2.4, columnspacing=1.2)
