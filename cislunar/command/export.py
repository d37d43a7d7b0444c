"""``cislunar export``: states, attitudes and observations of a cell or survey in standard
formats."""

import datetime
import json
from pathlib import Path

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
_CENTER = "EARTH"


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
    default=_CENTER,
    show_default=True,
    help="Origin of states, by the CENTER_NAME of CCSDS messages.",
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
    """Write a cell, or the record of a survey, in a standard format.

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
      cislunar export results/survey/replay/survey/everything/0.nc --output replay.html
    """
    from cislunar.exchange import CENTERS
    from cislunar.runtime.netcdf import read_dataset, write_text
    from cislunar.runtime.progress import logger
    from cislunar.study.messages import cell_messages

    path, suffix = Path(output), Path(output).suffix.lower()
    if suffix not in _STATES | _OTHERS:
        raise ConfigurationError(
            f"--output {output}: the ending must be one of {', '.join(_STATES | _OTHERS)}"
        )
    if data == "observers" and suffix not in _STATES:
        raise ConfigurationError(
            f"--data observers: {suffix} has no states; choose one of {', '.join(_STATES)}"
        )
    if data == "truth" and suffix not in (*_STATES, ".aem"):
        raise ConfigurationError(
            f"--data truth: {suffix} has no choice of states or attitudes; omit the option"
        )
    if center not in CENTERS:
        raise ConfigurationError(
            f"--center {center}: is unknown; choose one of {', '.join(CENTERS)}"
        )
    if center != _CENTER and suffix not in _STATES:
        raise ConfigurationError(
            f"--center {center}: {suffix} has no states; choose one of {', '.join(_STATES)}"
        )
    found = read_dataset(cell)
    if not {"target_id", "target_name"} & {*found.variables} or "settings" not in found.attrs:
        raise InputFileError(
            f"{cell}: is no tracking cell, study or record of a survey; give such a file"
        )
    if suffix in (".tdm", ".psv") and "observation_used" in found:
        raise InputFileError(
            f"{cell}: has no simulated observations, but those that were given; use their file"
        )
    if realization >= found.sizes["seed"]:
        raise ConfigurationError(
            f"--realization {realization}: the cell has {found.sizes['seed']}, counted from 0"
        )
    scenario = json.loads(found.attrs["settings"]).get("scenario", "")
    place = ephemeris or _ephemeris_of(Path(cell), scenario)
    sun = read_dataset(place)
    if not {"et", "moon_rotation"} <= {*sun.variables}:
        raise InputFileError(
            f"{place}: has no epoch and axes; give its ephemeris/sun.nc (--ephemeris)"
        )
    messages = cell_messages(
        found,
        sun,
        suffix,
        {"estimates": "estimated", "truth": "true"}.get(data, data),
        seed=realization,
        center=center,
        created=datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%S"),
        time_system=time_system,
    )
    for name, text in messages.items():
        file = path.with_name(f"{path.stem}{name}{path.suffix}")
        write_text(text, file)
        logger.info("%s", file)
