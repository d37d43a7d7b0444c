"""Estimation errors of single targets with their 3-sigma and Cramer-Rao bounds, over time."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, MaxNLocator

from cislunar.campaign.settings.cells import Cell
from cislunar.errors import ConfigurationError
from cislunar.evaluation.metrics import BOUND_SIGMAS, INCONSISTENT, NEVER_OBSERVED, TRACKED
from cislunar.figures.axes import Array, Grid, fixed_ticks, legend_below, place, title_above
from cislunar.figures.labels import (
    AXES,
    PARTS,
    REALIZATION,
    architecture_text,
    capitalized,
    interval_text,
    observers_text,
    realization_text,
    shown,
    target_text,
)
from cislunar.figures.style import (
    BLACK,
    DASHED,
    PAGE_WIDTH_IN,
    SKY,
    SOLID,
    VERMILION,
    house_style,
    new_figure,
    panel_letter,
)

SELECTED = 4
"""Targets shown of a cell."""

MEASURED = "#6E6E6E"
"""Bar along the times with a measurement."""

_SECONDS_PER_HOUR = 3600.0
_PANEL_IN = 0.6


class Look(NamedTuple):
    """How the error of one run is drawn; without a band, its bounds are lines alone."""

    line: str
    band: str | None
    dashes: str | tuple = SOLID


LEAST = {"color": VERMILION, "linewidth": 0.8, "linestyle": DASHED}
"""Dashed, so that bounds of a filter that coincide with it show between the dashes."""

SINGLE = Look(BLACK, SKY)


def selected_targets(cell: xr.Dataset, number: int = SELECTED) -> dict[int, str]:
    """Index of a few targets that show what happens in a cell, to why each is shown.

    The best and the median tracked target by the final attitude error, one of inconsistent
    rotation (with tracked translation, if there is one), one never observed; the rest are the
    poorest of the tracked ones.
    """
    status = shown(cell, "status")
    translation = shown(cell, "status_translation")
    final = shown(cell, "final_attitude_error")
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
    for index in rest[: max(0, number - len(chosen))]:
        chosen[index] = "poorest attitude" if index == int(tracked[-1]) else "poor attitude"
    return dict(list(chosen.items())[:number])


def representative_target(first: xr.Dataset, second: xr.Dataset) -> int | None:
    """The target whose ratio of attitude errors is the median of those tracked in both cells.

    None if there is none. The cells have the same targets.
    """
    both = (shown(first, "status") == TRACKED) & (shown(second, "status") == TRACKED)
    candidates = np.flatnonzero(both)
    if candidates.size == 0:
        return None
    attitude = PARTS[0].columns
    errors = [
        np.sqrt((shown(cell, "rmse")[candidates, attitude] ** 2).sum(axis=1))
        for cell in (first, second)
    ]
    order = np.argsort(errors[1] / errors[0], kind="stable")
    return int(candidates[order[(candidates.size - 1) // 2]])


class Scale(NamedTuple):
    """Vertical axis of a part of the state, linear about zero and logarithmic beyond."""

    linear: float
    reach: float

    def apply(self, axes: Axes) -> None:
        """Set the axis: ticks at zero and at the outermost decades."""
        axes.set_yscale("symlog", linthresh=self.linear, linscale=0.6)
        axes.set_ylim(-self.reach, self.reach)
        top = int(np.floor(np.log10(0.6 * self.reach)))
        decades = 10.0 ** np.arange(int(np.ceil(np.log10(self.linear))), top)
        power = rf"10^{{{top}}}"
        names = [f"$-{power}$", "0", f"${power}$"]
        fixed_ticks(axes.yaxis, [-(10.0**top), 0.0, 10.0**top], names)
        axes.yaxis.set_minor_locator(FixedLocator([*-decades, *decades]))


def part_scale(errors: Sequence[Array], sigmas: Sequence[Array]) -> Scale:
    """Axis that holds errors and deviations (time, component), narrow ones in its linear range."""
    bounds = BOUND_SIGMAS * np.concatenate([each.ravel() for each in sigmas])
    values = np.abs(np.concatenate([each.ravel() for each in errors]))
    bounds, values = bounds[np.isfinite(bounds)], values[np.isfinite(values)]
    reach = max(np.max(bounds, initial=0.0), np.max(values, initial=0.0)) or 1.0
    narrow = np.percentile(bounds, 5.0) if bounds.size else reach
    return Scale(float(min(narrow, 0.3 * reach)), float(1.8 * reach))


def _draw_error(axes: Axes, hours: Array, error: Array, sigma: Array, look: Look = SINGLE) -> None:
    """One component of the error of a target, over its bounds."""
    bound = BOUND_SIGMAS * sigma
    if look.band is not None:
        axes.fill_between(hours, -bound, bound, color=look.band, alpha=0.4, linewidth=0, zorder=2)
    for side in (-bound, bound):
        axes.plot(hours, side, color=look.line, linewidth=0.6, linestyle=look.dashes, zorder=3)
    axes.plot(hours, error, color=look.line, linewidth=0.9, linestyle=look.dashes, zorder=4)


def _draw_least(axes: Axes, hours: Array, least: Array) -> None:
    """Three times the Cramer-Rao bound of one component, either side of zero."""
    for side in (-BOUND_SIGMAS, BOUND_SIGMAS):
        axes.plot(hours, side * least, **LEAST, zorder=3.5)


def mark_measurements(axes: Axes, cell: xr.Dataset, target: int) -> None:
    """A bar along the times at which a measurement of a target was used."""
    names = cell["fate"].attrs["flag_meanings"].split()
    used = shown(cell, "fate")[:, target] == names.index("used")
    ends = np.concatenate([[0.0], cell["step"].values / _SECONDS_PER_HOUR])
    axes.stairs(
        0.07 * used, ends, fill=True, color=MEASURED, linewidth=0, zorder=5,
        transform=axes.get_xaxis_transform(),
    )  # fmt: skip
    axes.set_xlim(0.0, ends[-1])


def time_axis(axes: Axes, *, labeled: bool) -> None:
    """Hours, labelled below the lowest panel alone."""
    axes.xaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 3, 6, 10], integer=True))
    axes.tick_params(length=2, pad=1.5, labelsize=6.5, which="major", labelbottom=labeled)
    axes.tick_params(length=1.2, which="minor")
    axes.grid(False)
    if labeled:
        axes.set_xlabel("time, h", labelpad=1.5)


def histories(cell: xr.Dataset, target: int) -> tuple[Array, Array, Array]:
    """Hours, errors and standard deviations of a target, starting where records start.

    A `ConfigurationError` if the cell was made without the history that figures show.
    """
    if "error" not in cell:
        raise ConfigurationError(
            "the cell holds no errors: add errors to 'task2.histories' and make it again"
        )
    some = cell.isel(seed=REALIZATION, target=target)
    return (
        cell["time"].values / _SECONDS_PER_HOUR,
        some["error"].values.astype(float),
        some["sigma"].values.astype(float),
    )


def least_errors(cell: xr.Dataset, target: int) -> Array:
    """Cramer-Rao bound of a target, shape (time, component); no times if the cell has none."""
    if "bound" not in cell:
        return np.empty((0, 12))
    return cell["bound"].isel(seed=REALIZATION, target=target).values.astype(float)


def heading(data: xr.Dataset, target: int, number: int, why: str) -> str:
    """Title of a column: its letter, why its target is shown, and the target."""
    return f"{panel_letter(number)} {why}\n{target_text(data, target)}"


@house_style()
def components_figure(cell: Cell, data: xr.Dataset) -> Figure:
    """Errors and bounds of a few targets: a column for each, a row for each component."""
    chosen = selected_targets(data)
    left_in, right_in, gap_in, head_in, foot_in = 0.78, 0.2, 0.14, 0.8, 0.66
    rows_in = 12 * _PANEL_IN + 11 * 0.06 + 3 * 0.08
    figure = new_figure(head_in + rows_in + foot_in)
    width, height = figure.get_size_inches()
    each = (PAGE_WIDTH_IN - left_in - right_in - gap_in * (SELECTED - 1)) / SELECTED
    title_above(figure, cell_title(cell, data))
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
            axes = place(figure, left, bottom, each, _PANEL_IN)
            mark_measurements(axes, data, target)
            _draw_error(axes, hours, error[:, component], sigma[:, component])
            if least[target].size:
                _draw_least(axes, hours, least[target][:, component])
            ranges[part].apply(axes)
            time_axis(axes, labeled=component == 11)
            axes.tick_params(labelleft=column == 0)
            if column == 0 and axis == 1:
                axes.set_ylabel(f"{PARTS[part].name} error,\n{PARTS[part].unit}", fontsize=7.0)
                axes.yaxis.set_label_coords(-0.26, 0.5)
            if column == len(chosen) - 1:
                axes.text(1.04, 0.5, AXES[axis], transform=axes.transAxes, va="center", fontsize=7)
    within = "within \N{PLUS-MINUS SIGN}3\N{GREEK SMALL LETTER SIGMA}"
    targets_legend(figure, "error, truth less estimate", within, bound="bound" in data)
    return figure


def cell_title(cell: Cell, data: xr.Dataset) -> str:
    """Title of a figure of targets of one cell."""
    return (
        f"{capitalized(observers_text(cell, data))} ({architecture_text(cell)}),\n$n_T$ = "
        f"{cell.targets}, tasking every {interval_text(cell.interval_minutes)}; "
        f"{realization_text(data)}"
    )


def targets_legend(figure: Figure, error: str, within: str, *, bound: bool) -> None:
    """What is drawn of every target, in one row below."""
    handles = [
        Line2D([], [], color=BLACK, linewidth=0.9, label=error),
        Patch(facecolor=SKY, alpha=0.4, edgecolor=BLACK, linewidth=0.5,
              label=within),
        Patch(facecolor=MEASURED, label="measurements used"),
    ]  # fmt: skip
    if bound:
        label = "3 \N{MULTIPLICATION SIGN} Cramér-Rao bound"
        handles.insert(2, Line2D([], [], **LEAST, label=label))
    legend_below(figure, handles, 0.07)


class Compared(NamedTuple):
    """A target in one of two cells: what tells the cell from the other, its data set, its look."""

    label: str
    data: xr.Dataset
    look: Look


def draw_comparison(
    figure: Figure, compared: Sequence[Compared], target: int, box: Mapping[str, float]
) -> None:
    """Errors of a target in two cells: a row for each part of the state, a column for each axis.

    `box` is `left`, `bottom`, `width` and `height` of all panels, inches.
    """
    gap, between = 0.2, 0.1
    each, tall = (box["width"] - 2 * gap) / 3, (box["height"] - 3 * between) / 4
    grid = Grid(4, 3, each, tall, box["left"], box["bottom"], gap, between)
    found = [histories(item.data, target) for item in compared]
    for row, part in enumerate(PARTS):
        scale = part_scale(
            [e[:, part.columns] for _, e, _ in found], [s[:, part.columns] for _, _, s in found]
        )
        for axis in range(3):
            axes = grid.place(figure, row, axis)
            component = part.columns.start + axis
            for item, (hours, error, sigma) in zip(compared, found, strict=True):
                _draw_error(axes, hours, error[:, component], sigma[:, component], item.look)
                axes.set_xlim(0.0, hours[-1])
            scale.apply(axes)
            time_axis(axes, labeled=row == 3)
            axes.tick_params(labelleft=axis == 0)
            if row == 0:
                axes.set_title(AXES[axis], fontsize=7.5, pad=2.5)
            if axis == 0:
                axes.set_ylabel(f"{part.name} error,\n{part.unit}", fontsize=6.5)
                axes.yaxis.set_label_coords(-0.17, 0.5)
