"""Generated blocks on the two attitude estimators, see `cislunar.campaign.documents`."""

from itertools import product

import pandas as pd

from cislunar.campaign.documents.markdown import DASH, markdown_table
from cislunar.campaign.documents.results_page import LISTED, Tables, quantity_rows
from cislunar.campaign.tracking.model_errors import NONE, TORQUE

NAMES = {"mukf": "filter of the paper", "batch": "batch"}
PLACE = {"scenario": "A", "architecture": "published", "interval_minutes": 60}
"""The cells shown: the paper's own architecture and tasking interval."""

SETTINGS = (
    *("accurate", "refit-at-epochs", "single-start", "non-detections"),
    *("window-6h", "joint", "joint-shape", "joint-facets", "joint-turning"),
)
UNKNOWN = (
    *("unknown-material", "unknown-material-joint", "unknown-facets"),
    *("unknown-facets-joint-facets", "everything", "everything-joint-turning"),
)
AWARE = ("full-information", "full-information-hour")
_TORQUE = "torque, turn in a run"
COMPARED = (20, 50, 100, 202)

_SHOWN = (
    "attitude coverage",
    "rotation inconsistent",
    "final attitude error, deg",
    "final attitude error, 90th pct., deg",
    "attitude error over bound",
    "attitude RMSE, deg",
    "position RMSE, km",
    "share in custody",
)


def _cells(table: pd.DataFrame, **wanted: str) -> pd.DataFrame:
    """Rows of the cells shown, with text instead of missing labels."""
    labels = [key for key in ("variant", "part", "also", "error") if key in table]
    found = table.astype(dict.fromkeys(labels, object)).fillna(dict.fromkeys(labels, ""))
    for key, value in (PLACE | wanted).items():
        found = found[found[key] == value]
    return found


def _shown(cells: pd.DataFrame, name: str) -> str:
    """One quantity of one cell; inconsistent targets with their largest number."""
    rows = quantity_rows(cells, name)
    if rows.empty or pd.isna(rows["mean"].iloc[0]):
        return DASH
    text = f"{rows['mean'].iloc[0]:{LISTED[name][3]}}"
    return f"{text} ({rows['largest'].iloc[0]:.0f})" if name == "rotation inconsistent" else text


def _header(*first: str) -> list[str]:
    return [*first, *(name.replace("inconsistent", "inconsistent (most)") for name in _SHOWN)]


def estimators_block(tables: Tables) -> str:
    """Both estimators by number of targets."""
    cells = _cells(tables["tracking"], variant="").groupby(["targets", "estimator"])
    rows = [
        [*key, *(_shown(cells.get_group(key), name) for name in _SHOWN)]
        for key in product(COMPARED, NAMES)
        if key in cells.groups
    ]
    named = [[count, NAMES[estimator], *line] for count, estimator, *line in rows]
    return markdown_table(_header("targets", "estimator"), named)


_HEADLINE = ("rotation inconsistent", "attitude coverage", "attitude error over bound")


def headline_block(tables: Tables) -> str:
    """The paper's filter against the batch estimator in few numbers."""
    cells = _cells(tables["tracking"], variant="")
    rows = []
    for count in COMPARED:
        own = cells[cells["targets"] == count]
        line = [
            _shown(own[own["estimator"] == estimator], name).split(" (")[0]
            for name, estimator in product(_HEADLINE, NAMES)
        ]
        if set(line) != {DASH}:
            rows.append([count, *line])
    header = [f"{name}, {shown}" for name, shown in product(_HEADLINE, ("filter", "batch"))]
    return markdown_table(["targets", *header], rows)


def batch_settings_block(tables: Tables) -> str:
    """The batch estimator with other settings."""
    cells = _cells(tables["tracking"], estimator="batch").groupby(["variant", "targets"])
    rows = [
        [f"`{key[0]}`" if key[0] else "default", key[1],
         *(_shown(cells.get_group(key), name) for name in _SHOWN)]
        for key in product(("", *SETTINGS), COMPARED[:-1])
        if key in cells.groups
    ]  # fmt: skip
    return markdown_table(_header("variant", "targets"), rows)


def aware_tasking_block(tables: Tables) -> str:
    """What tasking by the information on all states changes, with intervals."""
    cells = _cells(tables["readings_tracking"])
    columns = [name for name in LISTED if name in _SHOWN and name != "attitude error over bound"]
    rows = [
        [f"`{variant}`", count, NAMES.get(estimator, estimator)]
        + [_difference(own, name) for name in columns]
        for variant in AWARE
        for (count, estimator), own in cells[cells["variant"] == variant].groupby(
            ["targets", "estimator"], sort=False
        )
    ]
    return markdown_table(["variant", "targets", "estimator", *columns], rows)


def _difference(cells: pd.DataFrame, name: str) -> str:
    rows = quantity_rows(cells, name)
    if rows.empty or pd.isna(rows["difference"].iloc[0]):
        return DASH
    row = rows.iloc[0]
    form = LISTED[name][3].replace(".", "+.")
    return f"{row['difference']:{form}} [{row['low']:{form}}, {row['high']:{form}}]"


def model_errors_block(tables: Tables) -> str:
    """Coverage and inconsistent targets by model error, for both estimators and set otherwise."""
    rows = []
    table = _cells(tables["model_error"])
    for _, of_error in table.groupby(["error"], sort=False):
        named = _told(of_error.iloc[0])
        for count, own in of_error.groupby("targets"):
            plain, other = own[own["also"] == ""], own[own["also"] != ""]
            line = [_share(plain[plain["estimator"] == name]) for name in NAMES]
            others = [
                f"{_share(each)} (`{name}`)" for name, each in other.groupby("variant", sort=False)
            ]
            rows.append([named, count, *line, "; ".join(others) or DASH])
    header = ["error of the model", "targets", *NAMES.values(), "batch, estimating more"]
    return markdown_table(header, rows)


def _told(row: pd.Series) -> str:
    """Kind and size of an error; its name where it has no size."""
    if row["kind"] == NONE:
        return "none"
    if pd.isna(row["size"]):
        return f"`{row['error']}`"
    told = _TORQUE if row["kind"] == TORQUE else row["kind"].replace("_", " ").replace(".", ", ")
    return f"{told} {row['size']:+.3g} {row['size_unit']}"


def unknown_bodies_block(tables: Tables) -> str:
    """Bodies nobody has measured: every cell of a truth that is drawn, in all scenarios."""
    table = tables["tracking"].fillna({"variant": "", "part": ""})
    rows = []
    for variant in UNKNOWN:
        cells = table[(table["variant"] == variant) & (table["architecture"] == "published")]
        for (scenario, count, estimator), own in cells.groupby(
            ["scenario", "targets", "estimator"], sort=False
        ):
            line = [_shown(own, name) for name in _SHOWN]
            rows.append([f"`{variant}`", scenario, count, NAMES.get(estimator, estimator), *line])
    rows.sort(key=lambda row: (UNKNOWN.index(row[0].strip("`")), row[1], row[2]))
    return markdown_table(_header("variant", "scenario", "targets", "estimator"), rows)


def _share(cells: pd.DataFrame) -> str:
    """Coverage, inconsistent targets and final error of a cell."""
    means = cells.set_index("quantity")["mean"]
    shown = ("coverage", "inconsistent_rotation", "final_attitude_error_median")
    if not set(shown) <= set(means.index):
        return DASH
    return "{:.3f}, {:.1f}, {:.1f}°".format(*means[list(shown)])


ESTIMATOR_BLOCKS = {
    "estimators": estimators_block,
    "estimators-headline": headline_block,
    "batch-settings": batch_settings_block,
    "aware-tasking": aware_tasking_block,
    "model-errors": model_errors_block,
    "unknown-bodies": unknown_bodies_block,
}
"""What makes each block, by its name."""
