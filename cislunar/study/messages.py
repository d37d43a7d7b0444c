"""A study or a cell of a campaign in the formats of `cislunar.exchange`, and as a replay."""

import re
from typing import Any

import pandas as pd
import xarray as xr

from cislunar.campaign.tracking import (
    cell_arcs,
    cell_attitudes,
    cell_maneuvers,
    cell_observations,
    cell_observer_arcs,
    is_ephemeris,
    observer_names,
)
from cislunar.constants import DATE_SYSTEM
from cislunar.errors import ConfigurationError
from cislunar.exchange import (
    COMMENTS,
    EPHEMERIS_COMMENTS,
    GEOMETRIC_DIRECTIONS,
    ades_text,
    aem_text,
    observer_codes,
    ocm_text,
    oem_text,
    segments_csv,
    tdm_text,
)
from cislunar.runtime.settings_words import shown

CREATED = "2000-01-01T00:00:00"
"""CREATION_DATE unless another one is given, so that the same data set gives the same file."""

_ENDINGS = {".aem": ("estimated", "true")} | dict.fromkeys(
    (".oem", ".csv", ".ocm"), ("estimated", "true", "observers")
)
"""Formats of states or attitudes, and whose they can be."""


def cell_messages(
    cell: xr.Dataset,
    sun: xr.Dataset,
    ending: str,
    which: str = "estimated",
    *,
    seed: int = 0,
    center: str = "EARTH",
    created: str = CREATED,
    time_system: str = DATE_SYSTEM,
    table: pd.DataFrame | None = None,
) -> dict[str, str]:
    """Texts of the files of a data set in a format.

    Parameters
    ----------
    cell, sun : xarray.Dataset
        A cell made with the records that the format needs, and its ``ephemeris/sun.nc``.
    ending : {".oem", ".csv", ".ocm", ".aem", ".tdm", ".psv", ".html"}
        Format by the ending of its files: OEM, table of states, an OCM per object, AEM, TDM, ADES,
        or replay.
    which : {"estimated", "true", "observers"}
        Whose states or attitudes.
    seed : int
        Index of the realization.
    center : str
        Origin of states in the ICRF, one of `cislunar.exchange.CENTERS`.
    created : str
        CREATION_DATE, ISO 8601, UTC.
    time_system : {"UTC", "TAI", "TT", "TDB"}
        Time scale of dates; ADES is always in UTC.
    table : DataFrame, optional
        Real observations of the study; those of the simulation if omitted.

    Returns
    -------
    dict of str to str
        Texts by what their files' names have after the stem: nothing, or with OCM the object.

    Raises
    ------
    ConfigurationError
        If the cell lacks a record or the realization, or an argument is unknown.
    """
    check_seed(cell, seed)
    if which not in _ENDINGS.get(ending, (which,)):
        *others, last = map(repr, _ENDINGS[ending])
        raise ConfigurationError(f"which = {shown(which)} must be {', '.join(others)} or {last}")
    if ending == ".html":
        from cislunar.figures.replay import cell_page

        return {"": cell_page(cell, sun, seed=seed)}
    dynamics = EPHEMERIS_COMMENTS if is_ephemeris(cell) else COMMENTS
    message: dict[str, Any] = {"created": created, "time_system": time_system}
    if ending in (".tdm", ".psv"):
        comments: tuple[str, ...] = ()
        if table is None:
            table = cell_observations(cell, sun, seed=seed).assign(remarks=GEOMETRIC_DIRECTIONS)
            comments = (*dynamics, GEOMETRIC_DIRECTIONS)
        if ending == ".psv":
            return {"": ades_text(_with_codes(table, observer_names(cell)))}
        return {"": tdm_text(table, **message, comments=comments)}
    message["comments"] = dynamics
    if ending == ".aem":
        return {"": aem_text(cell_attitudes(cell, sun, which, seed=seed), **message)}
    if which == "observers":
        arcs = cell_observer_arcs(cell, sun, center=center)
    else:
        arcs = cell_arcs(cell, sun, which, seed=seed, center=center)
    if ending == ".oem":
        return {"": oem_text(arcs, **message)}
    if ending == ".csv":
        return {"": segments_csv(arcs, time_system=time_system)}
    maneuvers = {} if which == "observers" else cell_maneuvers(cell, sun, which, seed=seed)
    found: dict[str, str] = {}
    for number, each in enumerate(arcs, 1):
        ending = f"_{re.sub(r'[^-.A-Za-z0-9]', '_', each.name)}"
        while ending in found:  # of a name that differs only by other signs
            ending += f"_{number}"
        found[ending] = ocm_text(each, maneuvers.get(each.name, ()), **message)
    return found


def _with_codes(table: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    """Observations with the codes of ADES for observers, whose names become a remark."""
    codes, given = observer_codes(names), table["stn"].astype(str)
    remarks_of = table["remarks"].fillna("") if "remarks" in table else [""] * len(table)
    remarks = [
        "; ".join(filter(None, [f"observer {own}" if codes.get(own, own) != own else "", also]))
        for own, also in zip(given, remarks_of, strict=True)
    ]
    signs = [each.replace("|", "/") for each in remarks]  # which separates columns
    return table.assign(stn=[codes.get(own, own) for own in given], remarks=signs)


def check_seed(cell: xr.Dataset, seed: int) -> None:
    """Raise a `ConfigurationError` for the index of a realization that a cell does not have."""
    if not isinstance(seed, int) or not 0 <= seed < cell.sizes["seed"]:
        raise ConfigurationError(
            f"seed = {shown(seed)}: the realizations are 0 .. {cell.sizes['seed'] - 1}"
        )
