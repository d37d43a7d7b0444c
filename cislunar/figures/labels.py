"""What the figures of tracking call things: components with their units, cells, targets."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from cislunar.campaign.settings.cells import Cell
from cislunar.figures.style import optimizer_style

REALIZATION = 0
"""Realization shown where the paper shows its single run."""

AXES = ("x", "y", "z")


class Part(NamedTuple):
    """Three components of the state: the name on an axis, abbreviated and in two lines where long.

    `unit` is the paper's for its errors.
    """

    name: str
    short: str
    stacked: str
    unit: str
    columns: slice


PARTS = (
    Part("attitude", "attitude", "attitude", "GRP, nondim.", slice(0, 3)),
    Part("angular velocity", "ang. velocity", "angular\nvelocity", "rad/s", slice(3, 6)),
    Part("position", "position", "position", "nondim.", slice(6, 9)),
    Part("velocity", "velocity", "velocity", "nondim.", slice(9, 12)),
)
"""In the order of the components of a cell's data set."""

_FAMILIES = {
    "Halo_L1_N": "L1 halo N",
    "Halo_L1_S": "L1 halo S",
    "Halo_L2_N": "L2 halo N",
    "Halo_L2_S": "L2 halo S",
    "NRHO_4:1": "4:1 NRHO",
    "NRHO_9:2": "9:2 NRHO",
    "Resonant_3:1": "3:1 resonant",
    "Resonant_3:1b": "3:1 resonant (b)",
}


def interval_text(minutes: int) -> str:
    """A tasking interval, in hours where it is some."""
    return f"{minutes // 60} h" if minutes % 60 == 0 else f"{minutes} min"


def family_text(family: str) -> str:
    """Orbit class of a target, as in a title."""
    if family.startswith("Polar_"):
        return f"polar, {family.removeprefix('Polar_').split('_')[0]}"
    return _FAMILIES.get(family, family.replace("_", " "))


def target_text(cell: xr.Dataset, index: int) -> str:
    """Name of a target of a cell: orbit class and identity."""
    return f"{family_text(str(cell['family'].values[index]))} {int(cell['target_id'][index])}"


def architecture_text(cell: Cell) -> str:
    """Whose observers track."""
    return f"architecture: {optimizer_style(cell.architecture).label}"


def observers_text(cell: Cell, data: xr.Dataset) -> str:
    """Scenario of a cell and its number of observers."""
    return f"scenario {cell.scenario}, {data.sizes['observer']} observers"


def realization_text(data: xr.Dataset) -> str:
    """The realization shown, as one of how many."""
    return f"realization {REALIZATION + 1} of {data.sizes['seed']}"


def capitalized(text: str) -> str:
    """With a capital letter first, the rest as it is."""
    return text[:1].upper() + text[1:]


def shown(data: xr.Dataset, name: str) -> np.ndarray:
    """A variable of the realization that is shown."""
    return data[name].isel(seed=REALIZATION).values
