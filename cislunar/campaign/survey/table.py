"""Table of the surveys of a campaign: ``tables/catalog.csv``."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from cislunar.campaign.settings.tree import StatedSurvey, survey_label
from cislunar.evaluation.intervals import Interval, count_interval, share_interval, t_interval
from cislunar.survey import SOURCES

QUANTITIES = (
    "detected", "findable", "right", "right_difference", "wrong", "false", "duplicate",
    "candidates", "linked_share", "completeness", "completeness_all", "completeness_inside",
    "completeness_outside", "completeness_all_inside", "completeness_all_outside", "purity",
    "wrong_share", "nees", "covered", "completeness_maneuvering", "custody", "in_custody",
    "nees_averaged", "covered_averaged", "nees_now", "nees_ballistic", "nees_now_ballistic",
    "median_error_km", "error_known_km",
    "search_cost", "hours_to_catalog", "undetected", "bright", "period_determined",
    "period_half_width", "period_covered", "amplitude_covered", "area_albedo_covered",
)  # fmt: skip
"""Quantities of the table; see `cislunar.survey.CatalogState` and, from `bright` on,
`cislunar.survey.CharacterizationQuality`. `right_difference`: correct orbits
minus those of the same realization of the first survey, if both have the same objects.
`linked_share`: share of the findable objects with an orbit, confirmed or not. `wrong_share`: wrong
and false orbits among the confirmed ones. `in_custody`: number of findable objects in custody.
`search_cost`: increase of `error_known_km` over that of
the same realization of a survey with the same settings that stops searching
(`search.search_days`), as a share of the latter."""

_COUNTS = ("wrong", "false", "duplicate")
"""Quantities that are often zero."""

_SHARES = {
    "linked_share": "findable", "completeness": "findable", "custody": "findable",
    "completeness_all": "objects", "wrong_share": "confirmed", "covered": "right",
    "covered_averaged": "right",
    "period_determined": "bright",
    "period_covered": "determined", "amplitude_covered": "bright", "area_albedo_covered": "bright",
}  # fmt: skip
"""Shares, and what they are of."""

_OBJECTS = ("detected", "findable", "right", "in_custody")
"""Numbers of objects."""

_SIGNED = ("right_difference", "search_cost")

_PLACE = (
    "survey", "scenario", "architecture", "targets", "outside_families", "dynamics", "prior",
    "strategy", "follow_up", "clutter", "label",
)  # fmt: skip

CATALOG_COLUMNS = (
    *_PLACE,
    "day",
    "quantity",
    "mean",
    "low",
    "high",
    "smallest",
    "largest",
    "seeds",
)
"""Columns of the table. `clutter`: mean number of false alarms per exposure of the field of view;
`follow_up`: worth of a nat of information on known orbits; `label`: name in tables and figures."""


def catalog_rows(
    surveys: Mapping[str, StatedSurvey],
    realizations: Mapping[str, Sequence[pd.DataFrame]],
    field_of_view_deg: float,
) -> pd.DataFrame:
    """Rows of the table: means over realizations with 95 % confidence intervals.

    Parameters
    ----------
    surveys : mapping of str to StatedSurvey
    realizations : mapping of str to sequence of DataFrame
        For each survey the rows of each realization
        (`cislunar.campaign.survey.realization_rows`).
    field_of_view_deg : float
        Of the telescopes, for the number of false alarms per exposure.

    Returns
    -------
    DataFrame
        Columns `CATALOG_COLUMNS`. A quantity that no realization has is left out.
    """
    rows, first = [], next(iter(surveys), None)
    moved = any(
        found.get("completeness_maneuvering", pd.Series(dtype=float)).notna().any()
        for own in realizations.values()
        for found in own
    )
    for name, survey in surveys.items():
        place = _described(name, survey, field_of_view_deg)
        found = pd.concat(realizations[name], ignore_index=True)
        for other, stopped in surveys.items():
            if _stops(stopped, survey):
                alone = pd.concat(realizations[other], ignore_index=True)["error_known_km"]
                found["search_cost"] = found["error_known_km"] / alone - 1.0
        if name != first and _objects(survey) == _objects(surveys[first]):
            paired = [
                mine["right"] - usual["right"]
                for mine, usual in zip(realizations[name], realizations[first], strict=False)
            ]
            found["right_difference"] = pd.concat(paired, ignore_index=True)
        found["linked_share"] = found["linked"] / found["findable"].where(found["findable"] > 0)
        found["in_custody"] = (found["custody"].fillna(0.0) * found["findable"]).round()
        confirmed = found["confirmed"].where(found["confirmed"] > 0)
        found["wrong_share"] = (found["wrong"] + found["false"]) / confirmed
        for day, own in found.groupby(found["day"].round(6), sort=True):
            for quantity in QUANTITIES:
                # where no survey has maneuvers it is the same as that of all objects
                if quantity not in own or (quantity.endswith("_ballistic") and not moved):
                    continue
                # without an assumed maneuver there is nothing to average over
                if quantity.endswith("_averaged") and survey.lineage.maneuvers_per_day == 0.0:
                    continue
                values = own[quantity].to_numpy(dtype=float)
                values = values[np.isfinite(values)]
                if values.size == 0:
                    continue
                interval = _interval(quantity, values, own)
                rows.append(
                    {**place, "day": day, "quantity": quantity, "mean": interval.mean,
                     "low": interval.low, "high": interval.high, "smallest": values.min(),
                     "largest": values.max(), "seeds": values.size}
                )  # fmt: skip
    return pd.DataFrame(rows, columns=list(CATALOG_COLUMNS))


def _interval(quantity: str, values: NDArray[np.float64], rows: pd.DataFrame) -> Interval:
    """Mean and interval of a quantity, limited to possible values; of counts and shares no narrower
    than exact, so that none in a few realizations does not seem to be never."""
    if quantity in _COUNTS:
        return count_interval(values)
    if quantity in _SHARES:
        return share_interval(values, max(1, round(float(rows[_SHARES[quantity]].mean()))))
    found = t_interval(values)
    if quantity in _SIGNED:
        return found
    most = 1.0 if quantity == "purity" or quantity.startswith("completeness") else np.inf
    if quantity in _OBJECTS:
        most = float(rows["objects"].max())
    return found._replace(low=max(found.low, 0.0), high=min(found.high, max(most, found.mean)))


def _stops(survey: StatedSurvey, other: StatedSurvey) -> bool:
    """Whether a survey stops searching, and is otherwise the same as another."""
    if survey.search == other.search:
        return False
    search = survey.search.model_copy(update={"search_days": None})
    return survey.model_copy(update={"search": search, "label": other.label}) == other


def _objects(survey: StatedSurvey) -> dict[str, Any]:
    """What the objects of a realization depend on."""
    return survey.model_dump(include={
        "scenario", "targets", "outside_families", "duration_days", "start_days", "entering",
        "deployed", "deployment_m_s", "cell", "ephemeris",
    })  # fmt: skip


def _described(name: str, survey: StatedSurvey, field_of_view_deg: float) -> dict[str, object]:
    """Settings of a survey that the table states."""
    shares = [f"{key.replace('_', ' ')} {share:.2g}"
              for key, share in zip(SOURCES, survey.prior.shares.values(), strict=True)
              if share > 0.0]  # fmt: skip
    side = np.rad2deg(2.0 * np.tan(np.deg2rad(0.5 * field_of_view_deg)))
    return {
        "survey": name,
        "scenario": survey.scenario,
        "architecture": survey.architecture,
        "targets": survey.targets,
        "outside_families": survey.outside_families,
        "dynamics": "ephemeris" if survey.ephemeris else "cr3bp",
        "prior": ", ".join(shares),
        "strategy": survey.search.strategy,
        "follow_up": survey.search.information_worth,
        "clutter": round(float(survey.process.false_alarms_deg2 * side**2), 2),
        "label": survey_label(name, survey.label),
    }
