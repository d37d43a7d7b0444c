"""Generated blocks on the two attitude estimators."""

from itertools import product

import pandas as pd

from cislunar.campaign.tracking.model_errors import NONE
from cislunar.figures.labels import ESTIMATORS, MODEL_ERRORS

from .columns import COLUMNS, Cell, Tables, by_cell, numbers, shown
from .labels import label
from .markdown import DASH, markdown_table
from .results_page import CELL

_PLACE = ("A", "published", 60)
"""Scenario, architecture and tasking interval (min) of the cells shown: the paper's own."""

_SETTINGS = (
    *("accurate", "refit-at-epochs", "single-start", "non-detections"),
    *("window-6h", "joint", "joint-shape", "joint-facets", "joint-turning"),
)
_UNCERTAIN = (
    *("unknown-material", "unknown-material-joint", "unknown-facets"),
    *("unknown-facets-joint-facets", "everything", "everything-joint-turning"),
)
AWARE = ("full-information", "full-information-hour")
_COUNTS = (20, 50, 100, 202)

_SHOWN, _COMPARED, _CHANGED = (COLUMNS[name] for name in ("estimators", "compared", "differences"))
_LARGEST = "Targets with inconsistent rotation (largest)"


def _cells(table: pd.DataFrame) -> dict[tuple, Cell]:
    """Cells of the paper's architecture in scenario A by variant, targets and estimator."""
    cells = by_cell(table, [*CELL, "variant"])
    return {
        (variant, targets, estimator): cell
        for (scenario, name, estimator, targets, minutes, variant), cell in cells.items()
        if (scenario, name, minutes) == _PLACE
    }


def _line(cell: Cell) -> list[str]:
    """The columns of a cell; inconsistent targets with their largest number."""
    line = dict(zip(_SHOWN, numbers(cell, _SHOWN.values()), strict=True))
    if line[_LARGEST] != DASH:
        line[_LARGEST] += f" ({cell[_SHOWN[_LARGEST].measure]['largest']:.0f})"
    return list(line.values())


def _estimators(tables: Tables) -> dict[str, str]:
    """Both estimators by number of targets."""
    cells = _cells(tables["tracking"])
    rows = [
        [targets, name, *_line(cells["", targets, estimator])]
        for targets, (estimator, name) in product(_COUNTS, ESTIMATORS.items())
        if ("", targets, estimator) in cells
    ]
    return {"table": markdown_table(["Targets", "Estimator", *_SHOWN], rows)}


def _headline(tables: Tables) -> dict[str, str]:
    """The paper's filter beside the batch estimator in few numbers."""
    cells = _cells(tables["tracking"])
    rows = []
    for targets in _COUNTS:
        line = [
            shown(cells.get(("", targets, estimator), {}), column)
            for column, estimator in product(_COMPARED.values(), ESTIMATORS)
        ]
        if set(line) != {DASH}:
            rows.append([targets, *line])
    header = [f"{name}, {words}" for name, words in product(_COMPARED, ESTIMATORS.values())]
    return {"table": markdown_table(["Targets", *header], rows)}


def _batch_settings(tables: Tables) -> dict[str, str]:
    """The batch estimator with other settings."""
    cells = _cells(tables["tracking"])
    rows = [
        [label(variant), targets, *_line(cells[variant, targets, "batch"])]
        for variant, targets in product(("", *_SETTINGS), _COUNTS[:-1])
        if (variant, targets, "batch") in cells
    ]
    return {"table": markdown_table(["Setting", "Targets", *_SHOWN], rows)}


def _aware_tasking(tables: Tables) -> dict[str, str]:
    """What tasking by the information on all states changes, with intervals."""
    cells = _cells(tables["readings_tracking"])
    rows = [
        [label(variant), targets, ESTIMATORS[estimator]]
        + [shown(cell, column, "difference") for column in _CHANGED.values()]
        for wanted, either in product(AWARE, ESTIMATORS)
        for (variant, targets, estimator), cell in cells.items()
        if (variant, estimator) == (wanted, either)
    ]
    return {"table": markdown_table(["Tasking", "Targets", "Estimator", *_CHANGED], rows)}


def _model_errors(tables: Tables) -> dict[str, str]:
    """Coverage, inconsistent targets and error by model error, for both estimators."""
    keys = ["error", "targets", "also", "estimator", "variant"]
    cells = {
        at: cell
        for (*place, minutes, error, targets, also, estimator, variant), cell in by_cell(
            tables["model_error"], ["scenario", "architecture", "interval_minutes", *keys]
        ).items()
        if (*place, minutes) == _PLACE
        for at in [(error, targets, also, estimator, variant)]
    }
    rows = []
    for error in dict.fromkeys(at[0] for at in cells):
        for targets in sorted({at[1] for at in cells if at[0] == error}):
            own = {at[2:]: cell for at, cell in cells.items() if at[:2] == (error, targets)}
            plain = {estimator: cell for (also, estimator, _), cell in own.items() if not also}
            more = [
                f"{_share(cell)} (`{variant}`)" for (also, _, variant), cell in own.items() if also
            ]
            line = [_share(plain.get(estimator, {})) for estimator in ESTIMATORS]
            rows.append([_error_label(own), targets, *line, "; ".join(more) or DASH])
    header = ["Model error", "Targets", *ESTIMATORS.values()]
    header.append("batch estimator, more parameters estimated")
    return {"table": markdown_table(header, rows)}


def _error_label(cells: dict[tuple, Cell]) -> str:
    """Kind and size of an error; its name where it has no size."""
    row = next(iter(next(iter(cells.values())).values()))
    if row["kind"] == NONE:
        return "none"
    if pd.isna(row["size"]):
        return label(row["error"])
    unit = "°" if row["size_unit"] == "degree" else f" {row['size_unit']}"
    return f"{MODEL_ERRORS.get(row['kind'], row['kind'])} {row['size']:+.3g}{unit}"


def _share(cell: Cell) -> str:
    """Coverage, inconsistent targets and final error of a cell."""
    means = {quantity: row["mean"] for (quantity, *_), row in cell.items()}
    wanted = ("coverage", "inconsistent_rotation", "final_attitude_error_median")
    if not set(wanted) <= set(means):
        return DASH
    return "{:.3f}, {:.1f}, {:.1f}°".format(*(means[name] for name in wanted))


def _uncertain_bodies(tables: Tables) -> dict[str, str]:
    """Every cell with body parameters drawn about those assumed, in all scenarios."""
    keys = ["architecture", "variant", "scenario", "targets", "estimator"]
    cells = {at[1:]: own for at, own in by_cell(tables["tracking"], keys).items()
             if at[0] == "published" and at[1] in _UNCERTAIN}  # fmt: skip
    rows = [
        [label(variant), scenario, targets, ESTIMATORS[estimator], *_line(cell)]
        for (variant, scenario, targets, estimator), cell in sorted(
            cells.items(), key=lambda item: (_UNCERTAIN.index(item[0][0]), *item[0][1:3])
        )
    ]
    header = ["Truth; estimator", "Scenario", "Targets", "Estimator", *_SHOWN]
    return {"table": markdown_table(header, rows)}


ESTIMATOR_BLOCKS = {
    "estimators": _estimators,
    "estimators-headline": _headline,
    "batch-settings": _batch_settings,
    "aware-tasking": _aware_tasking,
    "model-errors": _model_errors,
    "unknown-bodies": _uncertain_bodies,
}
"""What makes the values of each block, by its name."""
