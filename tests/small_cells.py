"""Inputs and settings of small tracking cells."""

from functools import cache

import xarray as xr
from campaign_folder import read_campaign

from cislunar.campaign.data.inputs import bodies_dataset, sun_dataset
from cislunar.campaign.settings.cell_settings import cell_settings
from cislunar.campaign.settings.reading import merged
from cislunar.campaign.tracking.cell import CellInputs
from cislunar.constants import EPOCH_JD
from cislunar.orbits.families import observer_library


@cache
def cell_inputs(duration_days, bodies=False):
    """Three observers in two slots, and three targets, all on halo orbits; do not change them."""
    halo = observer_library({"Halo_L2_S": 3})
    orbits = xr.Dataset(
        {
            "state": (("row", "component"), halo.state),
            "period": ("row", halo.period),
            "family": ("row", list(halo.family)),
        }
    )
    settings = {
        "epoch_jd": EPOCH_JD,
        "ephemeris": {"kernel": "de421", "step_minutes": 60},
        "visibility": {"duration_days": duration_days},
    }
    more = {"bodies": bodies_dataset(settings)} if bodies else {}
    return CellInputs(
        architecture=xr.Dataset({"orbit": ("slot", [0, 2]), "satellites": ("slot", [2, 1])}),
        orbits=orbits.rename(row="orbit"),
        tracked=orbits.rename(row="target"),
        sun=sun_dataset(settings),
        **more,
    )


def settings_of_cell(task2, **changes):
    """Settings of two hours with bright targets, from a part `task2` of a configuration."""
    base = read_campaign()["task2"]
    base |= {"duration_hours": 2, "record_minutes": 20, **task2}
    settings = merged(cell_settings(base), {"sensor": {"limiting_magnitude": 25}})
    return merged(settings, changes)
