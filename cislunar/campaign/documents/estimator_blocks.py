"""Generated blocks on the two attitude estimators, see `cislunar.campaign.documents`."""

from collections.abc import Sequence

import pandas as pd

from cislunar.campaign.documents.markdown import markdown_table
from cislunar.campaign.documents.results_page import DASH, TRACKED, Tables, quantity_rows
from cislunar.campaign.settings.model_error import NONE, TORQUE

NAMES = {"mukf": "filter of the paper", "batch": "batch"}
PLACE = {"scenario": "A", "architecture": "published", "interval_minutes": 60}
"""The cells shown: the paper's own architecture and tasking interval."""

SETTINGS = (
    *("accurate", "refit-at-epochs", "single-start", "non-detections"),
    *("window-6h", "wide", "fading"),
)
AWARE = ("full-information", "full-information-hour")
_TORQUE = "torque, turn in a run"
COMPARED = (20, 50, 100, 202)

_SHOWN = (
    "attitude coverage",
    "rotation diverged",
    "final attitude error, deg",
    "final attitude error, 90th pct., deg",
    "attitude error over bound",
    "attitude RMSE, deg",
    "position RMSE, km",
)


def _cells(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of the cells shown, with text instead of missing labels."""
    found = table.fillna({"variant": "", "part": ""})
    for key, value in PLACE.items():
        found = found[found[key] == value]
    return found


def _line(cells: pd.DataFrame) -> list[str]:
    """The shown quantities of one cell; divergences with their largest number."""
    line = []
    for name in _SHOWN:
        rows = quantity_rows(cells, name)
        if rows.empty or pd.isna(rows["mean"].iloc[0]):
            line.append(DASH)
            continue
        text = f"{rows['mean'].iloc[0]:{TRACKED[name][3]}}"
        if name == "rotation diverged":
            text += f" ({rows['largest'].iloc[0]:.0f})"
        line.append(text)
    return line


def _header(*first: str) -> list[str]:
    return [*first, *(name.replace("diverged", "diverged (most)") for name in _SHOWN)]


def estimators_block(tables: Tables) -> str:
    """Both estimators by number of targets."""
    cells = _cells(tables["tracking"])
    cells = cells[cells["variant"] == ""]
    rows = []
    for count in COMPARED:
        for name, shown in NAMES.items():
            own = cells[(cells["targets"] == count) & (cells["estimator"] == name)]
            if not own.empty:
                rows.append([count, shown, *_line(own)])
    return markdown_table(_header("targets", "estimator"), rows)


_HEADLINE = ("rotation diverged", "attitude coverage", "attitude error over bound")


def headline_block(tables: Tables) -> str:
    """The paper's filter against the batch estimator in few numbers."""
    cells = _cells(tables["tracking"])
    cells = cells[cells["variant"] == ""]
    rows = []
    for count in COMPARED:
        line = []
        for name in _HEADLINE:
            for estimator in NAMES:
                own = cells[(cells["targets"] == count) & (cells["estimator"] == estimator)]
                found = quantity_rows(own, name)["mean"]
                line.append(f"{found.iloc[0]:{TRACKED[name][3]}}" if found.size else DASH)
        if any(value != DASH for value in line):
            rows.append([count, *line])
    header = [f"{name}, {shown}" for name in _HEADLINE for shown in ("filter", "batch")]
    return markdown_table(["targets", *header], rows)


def batch_settings_block(tables: Tables) -> str:
    """The batch estimator with other settings."""
    cells = _cells(tables["tracking"])
    cells = cells[cells["estimator"] == "batch"]
    rows = []
    for variant in ("", *SETTINGS):
        for count in COMPARED[:-1]:
            own = cells[(cells["variant"] == variant) & (cells["targets"] == count)]
            if not own.empty:
                rows.append([f"`{variant}`" if variant else "default", count, *_line(own)])
    return markdown_table(_header("variant", "targets"), rows)


def aware_tasking_block(tables: Tables) -> str:
    """What tasking by the information on all states changes, with intervals."""
    cells = _cells(tables["readings_tracking"])
    columns = [name for name in TRACKED if name in _SHOWN and name != "attitude error over bound"]
    rows = []
    for variant in AWARE:
        for (count, estimator), own in cells[cells["variant"] == variant].groupby(
            ["targets", "estimator"], sort=False
        ):
            rows.append(
                [f"`{variant}`", count, NAMES.get(estimator, estimator)]
                + [_difference(own, name) for name in columns]
            )
    return markdown_table(["variant", "targets", "estimator", *columns], rows)


def _difference(cells: pd.DataFrame, name: str) -> str:
    rows = quantity_rows(cells, name)
    if rows.empty or pd.isna(rows["difference"].iloc[0]):
        return DASH
    row = rows.iloc[0]
    form = TRACKED[name][3].replace(".", "+.")
    return f"{row['difference']:{form}} [{row['low']:{form}}, {row['high']:{form}}]"


def model_errors_block(tables: Tables) -> str:
    """Coverage and divergences by model error, for both estimators and with a remedy."""
    table = _cells(tables["model_error"]).fillna({"also": ""})
    rows = []
    errors = table[["kind", "size", "size_unit"]].drop_duplicates()
    for kind, size, unit in errors.itertuples(index=False):
        own = table[(table["kind"] == kind) & (table["size"] == size) & (table["also"] == "")]
        cured = table[(table["kind"] == kind) & (table["size"] == size) & (table["also"] != "")]
        told = _TORQUE if kind == TORQUE else kind.replace("_", " ").replace(".", ", ")
        named = "none" if kind == NONE else f"{told} {size:+.3g} {unit}"
        for count in sorted(set(own["targets"]) | set(cured["targets"])):
            here = own[own["targets"] == count]
            line = [_share(here[here["estimator"] == name]) for name in NAMES]
            remedies = [
                f"{_share(each)} (`{name}`)"
                for name, each in cured[cured["targets"] == count].groupby("variant", sort=False)
            ]
            rows.append([named, count, *line, "; ".join(remedies) or DASH])
    header = ["error of the model", "targets", *NAMES.values(), "batch with a remedy"]
    return markdown_table(header, rows)


def _share(cells: pd.DataFrame) -> str:
    """Coverage, divergences and final error of a cell."""
    values = []
    shown: Sequence[tuple[str, str]] = (
        ("coverage", ".3f"),
        ("diverged_rotation", ".1f"),
        ("final_attitude_error_median", ".1f"),
    )
    for quantity, form in shown:
        found = cells.loc[cells["quantity"] == quantity, "mean"]
        if found.empty:
            return DASH
        values.append(f"{found.iloc[0]:{form}}")
    return f"{values[0]}, {values[1]}, {values[2]}°"


ESTIMATOR_BLOCKS = {
    "estimators": estimators_block,
    "estimators-headline": headline_block,
    "batch-settings": batch_settings_block,
    "aware-tasking": aware_tasking_block,
    "model-errors": model_errors_block,
}
"""What makes each block, by its name."""
