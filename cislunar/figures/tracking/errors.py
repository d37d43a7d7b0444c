"""Estimation errors of single targets with their 3-sigma and Cramer-Rao bounds, over time: by
component, and as norms in degrees and kilometers."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, StepPatch
from matplotlib.ticker import FixedLocator, MaxNLocator

from cislunar.campaign.settings.cells import Cell
from cislunar.errors import ConfigurationError
from cislunar.evaluation.custody import rotation_vectors_deg
from cislunar.evaluation.metrics import BOUND_SIGMAS, INCONSISTENT, NEVER_OBSERVED, TRACKED
from cislunar.figures import axes as layout
from cislunar.figures import labels, style
from cislunar.figures.axes import Array
from cislunar.figures.labels import PARTS

SELECTED = 4
"""Number of targets that are drawn of a cell."""

MEASURED = "#6E6E6E"
"""Color of the bar along the times with a measurement."""

_SECONDS_PER_HOUR = 3600.0
_PANEL_IN = 0.6
_LABEL_IN = 0.076
"""Least distance between two labels of a vertical axis."""
_LINEAR_PART = 0.65
"""Length of the linear part of an axis on either side of zero, in decades."""
SCALE_NOTE = "Vertical axes are linear between the gray lines and logarithmic beyond them."


class ErrorStyle(NamedTuple):
    """Style of the error of one run; without a band, its bounds are lines only."""

    line: str
    band: str | None
    dashes: str | tuple = style.SOLID


LEAST = {"color": style.VERMILION, "linewidth": 0.8, "linestyle": style.DASHED}
"""Style of the Cramer-Rao bound: dashed, so that coinciding bounds of a filter show between."""

SINGLE = ErrorStyle(style.BLACK, style.SKY)


def selected_targets(cell: xr.Dataset) -> dict[int, str]:
    """Indices of a few targets that show what happens in a cell, with the reason for each.

    They are the tracked targets with the best and the median final attitude error, one of
    inconsistent rotation (with tracked translation, if there is one) and one never observed; the
    rest are the tracked targets with the poorest attitudes.
    """
    status = labels.shown(cell, "status")
    translation = labels.shown(cell, "status_translation")
    final = labels.shown(cell, "final_attitude_error")
    tracked = np.flatnonzero(status == TRACKED)
    tracked = tracked[np.argsort(final[tracked], kind="stable")]
    chosen: dict[int, str] = {}
    if tracked.size:
        chosen[int(tracked[0])] = "best attitude"
        chosen.setdefault(int(tracked[(tracked.size - 1) // 2]), "median attitude")
    inconsistent = np.flatnonzero(status == INCONSISTENT)
    if inconsistent.size:
        order = np.argsort(translation[inconsistent] == INCONSISTENT, kind="stable")
        lost = "all" if translation[inconsistent[order[0]]] == INCONSISTENT else "rotation"
        chosen[int(inconsistent[order[0]])] = f"{lost} inconsistent"
    unseen = np.flatnonzero(status == NEVER_OBSERVED)
    if unseen.size:
        chosen[int(unseen[0])] = "never observed"
    rest = [int(index) for index in tracked[::-1] if int(index) not in chosen]
    for index in rest[: max(0, SELECTED - len(chosen))]:
        chosen[index] = "poorest attitude" if index == int(tracked[-1]) else "poor attitude"
    return dict(list(chosen.items())[:SELECTED])


def representative_target(first: xr.Dataset, second: xr.Dataset) -> int | None:
    """The target with the median ratio of attitude errors among those tracked in both cells.

    None if there is none. The cells have the same targets.
    """
    both = (labels.shown(first, "status") == TRACKED) & (labels.shown(second, "status") == TRACKED)
    candidates = np.flatnonzero(both)
    if candidates.size == 0:
        return None
    attitude = PARTS[0].columns
    errors = [
        np.sqrt((labels.shown(cell, "rmse")[candidates, attitude] ** 2).sum(axis=1))
        for cell in (first, second)
    ]
    order = np.argsort(errors[1] / errors[0], kind="stable")
    return int(candidates[order[(candidates.size - 1) // 2]])


class Scale(NamedTuple):
    """Vertical axis of a part of the state, linear about zero and logarithmic beyond `linear`."""

    linear: float
    reach: float

    def apply(self, axes: Axes) -> None:
        """Set the axis: plain numbers at zero and at the decades that fit."""
        axes.set_yscale("symlog", linthresh=self.linear, linscale=0.9 * _LINEAR_PART)
        axes.set_ylim(-self.reach, self.reach)
        height_in = axes.get_position().height * axes.get_figure().get_size_inches()[1]
        lowest = int(np.floor(np.log10(self.linear) + 1e-9))
        top = int(np.floor(np.log10(0.75 * self.reach)))
        unit = 0.5 * height_in / (_LINEAR_PART + np.log10(self.reach / self.linear))
        every = max(1, int(np.ceil(_LABEL_IN / unit)))
        first = (_LINEAR_PART + lowest - np.log10(self.linear)) * unit
        labeled = list(range(top, lowest - 1, -every))
        if len(labeled) > 1 and first + (labeled[-1] - lowest) * unit < _LABEL_IN:
            labeled = labeled[:-1]
        ends = np.array([10.0**k for k in labeled[::-1]])
        ticks = [*-ends[::-1], 0.0, *ends]
        names = [f"{tick:g}".replace("-", "\N{MINUS SIGN}") for tick in ticks]
        layout.fixed_ticks(axes.yaxis, ticks, names)
        decades = 10.0 ** np.arange(lowest, top + 1)
        axes.yaxis.set_minor_locator(FixedLocator([*-decades, *decades]))
        for side in (-self.linear, self.linear):
            axes.axhline(side, color="#BBBBBB", linewidth=0.4, zorder=1)


def part_scale(errors: Sequence[Array], sigmas: Sequence[Array]) -> Scale:
    """Axis that holds errors and deviations (time, component), narrow ones in its linear range.

    The linear range ends at a power of ten.
    """
    bounds = BOUND_SIGMAS * np.concatenate([each.ravel() for each in sigmas])
    values = np.abs(np.concatenate([each.ravel() for each in errors]))
    bounds, values = bounds[np.isfinite(bounds)], values[np.isfinite(values)]
    reach = 1.8 * (max(np.max(bounds, initial=0.0), np.max(values, initial=0.0)) or 1.0)
    narrow = np.percentile(bounds, 5.0) if bounds.size else reach
    power = np.ceil(np.log10(narrow)) if narrow > 0.0 else -np.inf
    power = min(power, np.floor(np.log10(0.3 * reach)))
    return Scale(float(10.0 ** max(power, np.log10(reach) - 6.0)), float(reach))


def draw_error(
    axes: Axes, hours: Array, error: Array, sigma: Array, series: ErrorStyle = SINGLE
) -> None:
    """Draw one component of the error of a target, over its bounds."""
    bound = BOUND_SIGMAS * sigma
    if series.band is not None:
        axes.fill_between(hours, -bound, bound, color=series.band, alpha=0.4, linewidth=0, zorder=2)
    for side in (-bound, bound):
        axes.plot(hours, side, color=series.line, linewidth=0.6, linestyle=series.dashes, zorder=3)
    axes.plot(hours, error, color=series.line, linewidth=0.9, linestyle=series.dashes, zorder=4)


def mark_measurements(axes: Axes, cell: xr.Dataset, target: int) -> None:
    """Draw a bar along the times at which a measurement of a target was used."""
    names = cell["outcome"].attrs["flag_meanings"].split()
    used = labels.shown(cell, "outcome")[:, target] == names.index("used")
    ends = np.concatenate([[0.0], cell["step"].values / _SECONDS_PER_HOUR])
    # `Axes.stairs` would search thousands of steps for their extent, which the limits below set
    bar = StepPatch(
        0.07 * used, ends, fill=True, color=MEASURED, linewidth=0, zorder=5,
        transform=axes.get_xaxis_transform(),
    )  # fmt: skip
    axes.add_artist(bar)
    axes.set_xlim(0.0, ends[-1])


def time_axis(axes: Axes, *, labeled: bool) -> None:
    """Set a horizontal axis in hours, with labels if it is that of the lowest panel."""
    axes.xaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 3, 6, 10], integer=True))
    axes.tick_params(length=2, pad=1.5, labelsize=6.2, which="major", labelbottom=labeled)
    axes.tick_params(length=1.2, which="minor")
    axes.grid(False)
    if labeled:
        axes.set_xlabel("time, h", labelpad=1.5)


def label_errors(axes: Axes, part: labels.Part, left: float, fontsize: float = 7.0) -> None:
    """Label the vertical axis of the error of a part of the state, `left` of the panel."""
    axes.set_ylabel(f"{part.name} error,\n{part.unit}", fontsize=fontsize)
    axes.yaxis.set_label_coords(left, 0.5)


def _practical(values: Array) -> Array:
    """Components (..., 12) in practical units, as those of a small error."""
    return values * np.repeat([part.factor for part in PARTS], 3)


def histories(cell: xr.Dataset, target: int) -> tuple[Array, Array, Array]:
    """Hours, errors and standard deviations of a target from the first record on, practical units.

    An error of the attitude is its rotation vector, in degrees. A `ConfigurationError` if the cell
    was made without the history that figures show.
    """
    if "error" not in cell:
        raise ConfigurationError(
            "the cell contains no errors: add errors to 'task2.histories' and make it again"
        )
    some = cell.isel(seed=labels.REALIZATION, target=target)
    error = some["error"].values.astype(float)
    practical, attitude = _practical(error), error[:, PARTS[0].columns]
    practical[:, PARTS[0].columns] = rotation_vectors_deg(attitude)
    hours = cell["time"].values / _SECONDS_PER_HOUR
    return hours, practical, _practical(some["sigma"].values.astype(float))


def least_errors(cell: xr.Dataset, target: int) -> Array:
    """Cramer-Rao bound of a target in practical units, shape (time, component).

    Without times if the cell has none.
    """
    if "bound" not in cell:
        return np.empty((0, 12))
    own = cell["bound"].isel(seed=labels.REALIZATION, target=target)
    return _practical(own.values.astype(float))


def heading(data: xr.Dataset, target: int, number: int, why: str) -> str:
    """Title of a column: its letter, the reason for the target, and the target."""
    return f"{style.panel_letter(number)} {why}\n{labels.target_text(data, target)}"


@style.house_style()
def components_figure(cell: Cell, data: xr.Dataset) -> Figure:
    """Draw errors and bounds of a few targets: a column for each, a row for each component."""
    chosen = selected_targets(data)
    left_in, right_in, gap_in, head_in, foot_in = 0.78, 0.2, 0.14, 0.8, 0.78
    rows_in = 12 * _PANEL_IN + 11 * 0.06 + 3 * 0.08
    figure = style.new_figure(head_in + rows_in + foot_in)
    width, height = figure.get_size_inches()
    each = (style.PAGE_WIDTH_IN - left_in - right_in - gap_in * (SELECTED - 1)) / SELECTED
    layout.title_above(figure, cell_title(cell, data))
    found = {target: histories(data, target) for target in chosen}
    least = {target: least_errors(data, target) for target in chosen}
    ranges = [
        part_scale([e[:, part.columns] for _, e, _ in found.values()],
                   [s[:, part.columns] for _, _, s in found.values()]
                   + [b[:, part.columns] for b in least.values()])
        for part in PARTS
    ]  # fmt: skip
    for column, (target, why) in enumerate(chosen.items()):
        left = left_in + column * (each + gap_in)
        above = (left / width, 1.0 - (head_in - 0.07) / height)
        text = heading(data, target, column, why)
        figure.text(*above, text, fontsize=7.0, va="bottom", linespacing=1.3)
        hours, error, sigma = found[target]
        for component in range(12):
            part, axis = divmod(component, 3)
            bottom = height - head_in - (component + 1) * _PANEL_IN - component * 0.06 - part * 0.08
            axes = layout.place(figure, left, bottom, each, _PANEL_IN)
            mark_measurements(axes, data, target)
            draw_error(axes, hours, error[:, component], sigma[:, component])
            if least[target].size:
                for side in (-BOUND_SIGMAS, BOUND_SIGMAS):
                    axes.plot(hours, side * least[target][:, component], **LEAST, zorder=3.5)
            ranges[part].apply(axes)
            time_axis(axes, labeled=component == 11)
            axes.tick_params(labelleft=column == 0)
            if column == 0 and axis == 1:
                label_errors(axes, PARTS[part], -0.26)
            if column == len(chosen) - 1:
                beside = {"transform": axes.transAxes, "va": "center", "fontsize": 7}
                axes.text(1.04, 0.5, labels.AXES[axis], **beside)
    within = "within \N{PLUS-MINUS SIGN}3\N{GREEK SMALL LETTER SIGMA}"
    top = layout.note_below(figure, SCALE_NOTE)
    targets_legend(figure, "error, truth minus estimate", within, bound="bound" in data, foot=top)
    return figure


def cell_title(cell: Cell, data: xr.Dataset) -> str:
    """Title of a figure of targets of one cell."""
    return (
        f"{labels.observers_text(cell, data)},\n{cell.targets} targets, tasking every "
        f"{labels.interval_text(cell.interval_minutes)}; {labels.realization_text(data)}"
    )


def targets_legend(
    figure: Figure, error: str, within: str, *, bound: bool, foot: float = 0.07
) -> None:
    """Draw the legend of what is drawn of every target, in one row `foot` above the lower edge."""
    handles = [
        Line2D([], [], color=style.BLACK, linewidth=0.9, label=error),
        Patch(facecolor=style.SKY, alpha=0.4, edgecolor=style.BLACK, linewidth=0.5, label=within),
        Patch(facecolor=MEASURED, label="measurements used"),
    ]  # fmt: skip
    if bound:
        label = "3 \N{MULTIPLICATION SIGN} Cramér-Rao bound"
        handles.insert(2, Line2D([], [], **LEAST, label=label))
    layout.legend_below(figure, handles, foot)


_LEFT, _RIGHT, _GAP, _BETWEEN = 0.78, 0.12, 0.14, 0.12
_NORM_IN, _HEAD, _FOOT = 1.15, 0.8, 0.66


def selected_targets_figure(cell: Cell, data: xr.Dataset) -> Figure:
    """Draw error norms of a few targets: a column for each, a row for each part of the state."""
    return error_norms_figure(cell_title(cell, data), data, selected_targets(data))


@style.house_style()
def error_norms_figure(title: str, data: xr.Dataset, chosen: Mapping[int, str]) -> Figure:
    """Draw error norms of targets, given by their indices with a reason for each."""
    width_in = (style.PAGE_WIDTH_IN - _LEFT - _RIGHT - _GAP * (SELECTED - 1)) / SELECTED
    grid = layout.Grid(len(PARTS), SELECTED, width_in, _NORM_IN, _LEFT, _FOOT, _GAP, _BETWEEN)
    figure = style.new_figure(_HEAD + grid.size[1] + _FOOT)
    layout.title_above(figure, title)
    for row, part in enumerate(PARTS):
        drawn, shown_values = [], [np.empty(0)]
        for column, (target, why) in enumerate(chosen.items()):
            axes = grid.place(figure, row, column)
            hours, error, sigma = histories(data, target)
            bounds = (BOUND_SIGMAS * each for each in (sigma, least_errors(data, target)))
            norms = (np.linalg.norm(each[:, part.columns], axis=1) for each in (error, *bounds))
            shown_values += _draw_norms(axes, hours, *norms)
            mark_measurements(axes, data, target)
            time_axis(axes, labeled=row == len(PARTS) - 1)
            axes.tick_params(labelleft=column == 0)
            if row == 0:
                text = heading(data, target, column, why)
                axes.set_title(text, fontsize=7.0, loc="left", linespacing=1.3)
            if column == 0:
                label_errors(axes, part, -0.27)
            drawn.append(axes)
        limits = layout.reach(np.concatenate(shown_values), log=True, share=0.12)
        for axes in drawn:
            layout.set_vertical(axes, limits, log=True)
            axes.grid(True, axis="y")
    within = "3\N{GREEK SMALL LETTER SIGMA} bound, root sum of squares"
    targets_legend(figure, "norm of the error", within, bound="bound" in data)
    return figure


def _draw_norms(
    axes: Axes, hours: Array, error: Array, deviation: Array, least: Array
) -> list[Array]:
    """Draw the norm of the error and its bounds; all values are returned."""
    axes.fill_between(hours, 1e-30, deviation, color=style.SKY, alpha=0.4, linewidth=0, zorder=2)
    axes.plot(hours, deviation, color=style.BLACK, linewidth=0.6, zorder=3)
    axes.plot(hours, error, color=style.BLACK, linewidth=0.9, zorder=4)
    if least.size:
        axes.plot(hours, least, **LEAST, zorder=3.5)
    return [error, deviation, least]
