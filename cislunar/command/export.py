"""``cislunar export``: states, attitudes and observations of a cell or survey in standard
formats."""

import datetime
import json
import re
from pathlib import Path
from typing import Any

import click

from cislunar.command.base import Command
from cislunar.command.table import EXPORT_TIME_SYSTEM
from cislunar.errors import ConfigurationError, InputFileError

_STATES = {
    ".oem": "Orbit Ephemeris Message",
    ".csv": "table of states",
    ".ocm": "message per object",
}
_OTHERS = {
    ".aem": "Attitude Ephemeris Message",
    ".tdm": "Tracking Data Message of observations",
    ".psv": "observations in the format ADES",
    ".html": "interactive page that replays the cell or survey",
}


def _ephemeris_of(path: Path, scenario: str) -> Path:
    """``ephemeris/sun.nc`` of a cell, or of its scenario, in the results folder above it."""
    for folder in path.absolute().parents:
        for name in (f"sun_{scenario}.nc", "sun.nc"):
            if (found := folder / "ephemeris" / name).is_file():
                return found
    raise InputFileError(
        f"{path}: no ephemeris/sun.nc in the folders above it; give --ephemeris FILE"
    )


@click.command(cls=Command)
@click.argument("cell", metavar="CELL")
@click.option(
    "--output",
    required=True,
    metavar="FILE",
    help="File to write; its ending selects the format: "
    + ", ".join(f"{each} ({text})" for each, text in (_STATES | _OTHERS).items())
    + ". With .ocm, the name of the object is added to the name of each file.",
)
@click.option(
    "--data",
    type=click.Choice(["estimates", "truth", "observers"]),
    default="estimates",
    show_default=True,
    help="Whose states or attitudes: targets as estimated or true, or the observers.",
)
@click.option(
    "--realization", type=click.IntRange(min=0), default=0, show_default=True, help="Its number."
)
@click.option(
    "--center",
    type=click.Choice(["EARTH", "MOON", "EARTH BARYCENTER"]),
    default="EARTH",
    show_default=True,
    help="Origin of states.",
)
@click.option(
    "--ephemeris",
    metavar="FILE",
    help="Its ephemeris/sun.nc [default: searched in the folders above the cell].",
)
@EXPORT_TIME_SYSTEM
def export(
    cell: str,
    output: str,
    data: str,
    realization: int,
    center: str,
    ephemeris: str | None,
    time_system: str,
) -> None:
    """Write a cell of the campaign, or the record of a survey, in a standard format.

    States are in km and km/s, ICRF axes, and the files state frame, center and time scale. The cell
    must have been made with the records that the format needs (`task2.record`): estimates or truth
    for states and attitudes, measurements for observations and observers; estimates, covariance and
    measurements for a replay, and truth if it is to be shown.

    \b
    Examples:
      cislunar export results/task2/A/tpe/mukf/nt20_dt60.nc --output estimates.oem
      cislunar export results/task2/A/tpe/mukf/nt20_dt60.nc --output observations.tdm
      cislunar export results/task2/A/tpe/mukf/nt20_dt60.nc --data truth --output truth.aem
      cislunar export results/replay/A/published/mukf/nt20_dt60.nc --output replay.html
      cislunar export results/replay/survey/everything/0.nc --output replay.html
    """
    from cislunar.runtime.netcdf import read_dataset, write_text
    from cislunar.runtime.progress import logger

    path, suffix = Path(output), Path(output).suffix.lower()
    if suffix not in _STATES | _OTHERS:
        raise ConfigurationError(
            f"--output {output}: the ending must be one of {', '.join(_STATES | _OTHERS)}"
        )
    if data == "observers" and suffix not in _STATES:
        raise ConfigurationError(
            f"--data observers: {suffix} has no states; choose one of {', '.join(_STATES)}"
        )
    found = read_dataset(cell)
    if "target_id" not in found or "settings" not in found.attrs:
        raise InputFileError(f"{cell}: is no cell of tracking; give a file of results/task2")
    if realization >= found.sizes["seed"]:
        raise ConfigurationError(
            f"--realization {realization}: the cell has {found.sizes['seed']}, counted from 0"
        )
    scenario = json.loads(found.attrs["settings"]).get("scenario", "")
    sun = read_dataset(ephemeris or _ephemeris_of(Path(cell), scenario))
    texts = _texts(found, sun, path, data, realization, center, time_system)
    for name, text in texts.items():
        write_text(text, name)
        logger.info("%s", name)


def _texts(
    cell: Any, sun: Any, path: Path, data: str, seed: int, center: str, time_system: str
) -> dict[Path, str]:
    """Files and their texts."""
    from cislunar.campaign.tracking import (
        cell_arcs,
        cell_attitudes,
        cell_maneuvers,
        cell_observations,
        cell_observer_arcs,
        is_ephemeris,
    )
    from cislunar.exchange import (
        COMMENTS,
        EPHEMERIS_COMMENTS,
        GEOMETRIC,
        ades_text,
        aem_text,
        ocm_text,
        oem_text,
        segments_csv,
        tdm_text,
    )

    suffix = path.suffix.lower()
    if suffix == ".html":
        from cislunar.figures.replay import cell_replay, replay_page

        return {path: replay_page(cell_replay(cell, sun, seed=seed))}
    dynamics = EPHEMERIS_COMMENTS if is_ephemeris(cell) else COMMENTS
    now = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%S")
    message = {"created": now, "time_system": time_system, "comments": dynamics}
    which = "true" if data == "truth" else "estimated"
    if suffix == ".aem":
        return {path: aem_text(cell_attitudes(cell, sun, which, seed=seed), **message)}
    if suffix in (".tdm", ".psv"):
        table = cell_observations(cell, sun, seed=seed)
        if suffix == ".psv":
            return {path: ades_text(table.assign(remarks=GEOMETRIC))}
        message["comments"] = (*dynamics, GEOMETRIC)
        return {path: tdm_text(table, **message)}
    arcs = (
        cell_observer_arcs(cell, sun, center=center)
        if data == "observers"
        else cell_arcs(cell, sun, which, seed=seed, center=center)
    )
    if suffix == ".oem":
        return {path: oem_text(arcs, **message)}
    if suffix == ".csv":
        return {path: segments_csv(arcs, time_system=time_system)}
    maneuvers = cell_maneuvers(cell, sun, which, seed=seed)
    return {
        path.with_name(
            f"{path.stem}_{re.sub(r'[^-.A-Za-z0-9]', '_', each.name)}{path.suffix}"
        ): ocm_text(each, maneuvers.get(each.name, ()), **message)
        for each in arcs
    }
