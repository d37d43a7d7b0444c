"""Errors, schedule and light curves of a single run whose targets and observers have names."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cislunar.figures import axes as layout
from cislunar.figures import labels, style
from cislunar.figures.tracking import errors

_COLORS = (style.BLUE, style.VERMILION, style.GREEN, style.PURPLE, style.ORANGE, style.SKY)
_MARKERS = "os^DvP"
_MOST_PANELS = 12
_SECONDS_PER_HOUR = 3600.0


def run_errors_figure(data: xr.Dataset, target: int | None = None) -> Figure:
    """Draw norms of errors with their 3-sigma and Cramér-Rao bounds over time.

    Parameters
    ----------
    data : xarray.Dataset
        Data set of a cell.
    target : int, optional
        Index of the target; by default a few of them, with the reason for each.
    """
    chosen = errors.selected_targets(data) if target is None else {target: "target"}
    title = f"{_title(data)}; {labels.realization_text(data)}"
    return errors.error_norms_figure(title, data, chosen)


@style.house_style()
def schedule_figure(data: xr.Dataset, observers: Sequence[str]) -> Figure:
    """Draw the target of each observer over time.

    Parameters
    ----------
    data : xarray.Dataset
        Data set of a cell.
    observers : sequence of str
        Names of the observers.
    """
    names = [labels.target_text(data, j) for j in range(data.sizes["target"])]
    rows_in = max(1.2, 0.16 * len(names))
    figure = style.new_figure(0.5 + rows_in + 0.75)
    left = min(2.2, 0.35 + 0.065 * max(map(len, names)))
    axes = layout.place(figure, left, 0.7, style.PAGE_WIDTH_IN - left - 0.15, rows_in)
    layout.title_above(figure, f"{_title(data)}; {labels.realization_text(data)}")
    given = data["assignment"].isel(seed=labels.REALIZATION)
    starts = data["epoch"].values[:, None]
    if "slot" in given.dims:
        starts = starts + data["slot"].values[None, :]
    end = float(data["step"].values[-1])
    begins = starts.ravel()
    # a slot ends with the next one, or with the run
    ends = np.append(begins[1:], end)
    by_observer = given.transpose("observer", ...).values.reshape(len(observers), -1)
    shift = 0.6 / len(observers)
    for number, target in enumerate(by_observer):
        busy = target >= 0
        at = target[busy] + shift * (number - 0.5 * (len(observers) - 1))
        spans = begins[busy] / _SECONDS_PER_HOUR, ends[busy] / _SECONDS_PER_HOUR
        color = _COLORS[number % len(_COLORS)]
        axes.hlines(at, *spans, color=color, linewidth=min(4.0, 0.7 * 11.5 * shift))
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlim(0.0, end / _SECONDS_PER_HOUR)
    axes.set_xlabel("time since the epoch, h")
    handles = [
        Line2D([], [], color=_COLORS[k % len(_COLORS)], linewidth=3.0, label=labels.plain(name))
        for k, name in enumerate(observers)
    ]
    layout.legend_below(figure, handles, 0.07, min(len(handles), 6))
    return figure


@style.house_style()
def light_curve_figure(
    data: xr.Dataset, observers: Sequence[str], target: int | None = None
) -> Figure:
    """Draw the measured magnitudes of targets over time, by observer.

    Parameters
    ----------
    data : xarray.Dataset
        Data set of a cell with its measurements (`task2.record`).
    observers : sequence of str
        Names of the observers.
    target : int, optional
        Index of the target; by default those with most measurements, at most 12.
    """
    kept = (data["observation_seed"].values == labels.REALIZATION) & np.isfinite(
        data["observation_magnitude"].values
    )
    of = data["observation_target"].values[kept]
    hours = data["step"].values[data["observation_step"].values[kept]] / _SECONDS_PER_HOUR
    magnitude = data["observation_magnitude"].values[kept]
    by = data["observation_observer"].values[kept]
    counts = np.bincount(of, minlength=data.sizes["target"])
    most = np.argsort(-counts, kind="stable")[:_MOST_PANELS]
    chosen = [target] if target is not None else sorted(j for j in most.tolist() if counts[j])
    columns = min(3, max(1, len(chosen)))
    rows = max(1, -(-len(chosen) // columns))
    left, gap = 0.58, 0.42
    width = (style.PAGE_WIDTH_IN - left - 0.15 - (columns - 1) * gap) / columns
    grid = layout.Grid(rows, columns, width, 1.1, left, 0.72, gap, 0.36)
    figure = style.new_figure(grid.foot + grid.size[1] + 0.55)
    fewer = target is None and len(chosen) < np.count_nonzero(counts)
    which = f"; the {len(chosen)} targets with most measurements" if fewer else ""
    layout.title_above(figure, f"{_title(data)}; {labels.realization_text(data)}{which}")
    end = float(data["step"].values[-1]) / _SECONDS_PER_HOUR
    for number, j in enumerate(chosen):
        axes = grid.place(figure, *divmod(number, columns))
        for k in range(len(observers)):
            some = (of == j) & (by == k)
            axes.plot(hours[some], magnitude[some], **_points(k, 1.6), markeredgewidth=0)
        if not counts[j]:
            layout.note_empty(axes, "no measurement")
        axes.set_xlim(0.0, end)
        axes.invert_yaxis()
        axes.set_title(labels.target_text(data, j), loc="left", fontsize=7.0, pad=2.0)
        if number % columns == 0:
            axes.set_ylabel("magnitude, mag")
        if number + columns >= len(chosen):
            axes.set_xlabel("time since the epoch, h")
    if not chosen:
        layout.note_empty(grid.place(figure, 0, 0), "no target was detected")
    _observers_legend(figure, observers)
    return figure


@style.house_style()
def residuals_figure(
    data: xr.Dataset, observers: Sequence[str], target: int | None = None
) -> Figure:
    """Draw measured less estimated right ascension, declination and magnitude over time.

    Parameters
    ----------
    data : xarray.Dataset
        Residuals of observations (`cislunar.study.estimation`).
    observers : sequence of str
        Names of the observers.
    target : int, optional
        Index of the target; all by default.
    """
    of = data["observation_target"].values
    kept = np.full(of.size, True) if target is None else of == target
    hours = data["observation_elapsed"].values / _SECONDS_PER_HOUR
    by = data["observation_observer"].values
    rows = (
        ("residual_right_ascension", "right ascension,\narcsec"),
        ("residual_declination", "declination,\narcsec"),
        ("residual_magnitude", "magnitude, mag"),
    )
    grid = layout.Grid(3, 1, style.PAGE_WIDTH_IN - 0.95, 1.15, 0.8, 0.75, 0.0, 0.14)
    figure = style.new_figure(grid.foot + grid.size[1] + 0.4)
    own = None if target is None else str(data["target_name"].values[target])
    whose = "all targets" if own is None else labels.plain(own)
    layout.title_above(figure, f"Measured less estimated values of {whose}")
    for row, (name, label) in enumerate(rows):
        axes = grid.place(figure, row, 0)
        for k in range(len(observers)):
            some = kept & (by == k)
            axes.plot(hours[some], data[name].values[some], **_points(k, 2.0), markeredgewidth=0)
        axes.axhline(0.0, color=style.GRAY, linewidth=0.6, zorder=1)
        axes.set_ylabel(label)
        axes.tick_params(labelbottom=row == 2)
    axes.set_xlabel("time since the epoch, h")
    _observers_legend(figure, observers)
    return figure


def _points(observer: int, size: float) -> dict:
    """Keywords of the markers of an observer for ``plot``."""
    marker, color = _MARKERS[observer % len(_MARKERS)], _COLORS[observer % len(_COLORS)]
    return {"linestyle": "none", "marker": marker, "color": color, "markersize": size}


def _observers_legend(figure: Figure, observers: Sequence[str]) -> None:
    handles = [
        Line2D([], [], label=labels.plain(name), **_points(k, 3.0))
        for k, name in enumerate(observers)
    ]
    layout.legend_below(figure, handles, 0.07, min(len(handles), 6))


def _title(data: xr.Dataset) -> str:
    targets, observers = data.sizes["target"], data.sizes["observer"]
    return (
        f"{targets} target{'s' * (targets > 1)} tracked by {observers} "
        f"observer{'s' * (observers > 1)}"
    )
