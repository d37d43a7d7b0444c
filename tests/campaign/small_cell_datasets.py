"""Settings and data sets of small cells of the paper's filter."""

from campaign_folder import read_campaign

from cislunar.campaign.settings.cell_settings import cell_settings
from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.settings.reading import merged
from cislunar.campaign.settings.scenarios import scenario_settings
from cislunar.campaign.tracking.cell import CellInputs
from cislunar.campaign.tracking.dataset import cell_dataset


def small_settings(**changes):
    config = read_campaign()
    settings = cell_settings(scenario_settings(config, "A")["task2"])
    base = {"seeds": 2, "duration_hours": 3, "sensor": {"limiting_magnitude": 22}}
    return merged(merged(settings, base), changes)


def small_cell(sources, targets=4, minutes=60, variant="", **changes):
    cell = Cell("A", "tpe", "mukf", targets, minutes, variant)
    inputs = CellInputs(**sources)
    return cell_dataset(cell, inputs, small_settings(**changes), propagator="dop853", seed=3)
