"""The tracking cells that figures show, from the configuration.

They are the cells that the paper shows, as far as the configuration has them, and similar cells
otherwise. Nothing here needs matplotlib or the compiled library, so that a workflow can read
them at once.
"""

from collections.abc import Mapping
from typing import Any

from cislunar.campaign.settings.cells import Cell, grid_cells, unpooled_variant, variant_cells

PREFERRED_ARCHITECTURE = "tpe"
"""Architecture of the paper's tracking figures."""

PAPER_COUNTS = (20, 30, 50, 100)
"""Numbers of targets in the paper's figure 5."""


def figure_architectures(task2: Mapping[str, Any]) -> list[str]:
    """Architectures with figures of single cells, the preferred one first."""
    return sorted(task2["architectures"], key=lambda name: name != PREFERRED_ARCHITECTURE)


def _cells(task2: Mapping[str, Any], architecture: str) -> list[Cell]:
    """Cells of an architecture in the sweeps, with the first estimator."""
    estimator = task2["estimators"][0]
    return [
        cell
        for cell in grid_cells(task2)
        if cell.architecture == architecture and cell.estimator == estimator
    ]


def _by_targets(task2: Mapping[str, Any], architecture: str) -> list[Cell]:
    """Cells by rising number of targets in the first scenario."""
    usual = int(task2["interval_minutes"])
    cells = [c for c in _cells(task2, architecture) if c.interval_minutes == usual]
    scenario = next((s for s in task2["target_counts"] if any(c.scenario == s for c in cells)), "")
    counts = set(task2["target_counts"].get(scenario, ()))
    found = [c for c in cells if c.scenario == scenario and c.targets in counts]
    return sorted(found, key=lambda cell: cell.targets)


def target_count_cells(task2: Mapping[str, Any], architecture: str) -> list[Cell]:
    """Cells of the heat maps by rising number of targets.

    They are the paper's; if there are none, the three with the fewest targets and the one with the
    most. `task2` is the configuration key.
    """
    cells = _by_targets(task2, architecture)
    return [c for c in cells if c.targets in PAPER_COUNTS] or [*cells[:3], *cells[3:][-1:]]


def selected_cell(task2: Mapping[str, Any], architecture: str) -> list[Cell]:
    """The cell whose targets are shown, if any: that with the fewest targets, first scenario."""
    return _by_targets(task2, architecture)[:1]


def _by_interval(task2: Mapping[str, Any], architecture: str) -> dict[str, dict[int, list[Cell]]]:
    """Cells of the interval sweep by scenario, number of targets and rising interval."""
    minutes = set(task2["intervals"]["minutes"])
    found: dict[str, dict[int, list[Cell]]] = {}
    for scenario, counts in task2["intervals"]["target_counts"].items():
        for n in sorted(counts):
            cells = [
                cell
                for cell in _cells(task2, architecture)
                if (cell.scenario, cell.targets) == (scenario, n)
                and cell.interval_minutes in minutes
            ]
            if cells:
                ordered = sorted(cells, key=lambda cell: cell.interval_minutes)
                found.setdefault(scenario, {})[n] = ordered
    return found


def interval_cells(task2: Mapping[str, Any], architecture: str) -> list[Cell]:
    """Cells of the heat maps by interval: those with the fewest targets of each scenario."""
    groups = _by_interval(task2, architecture).values()
    return [cell for found in groups for cell in found[min(found)]]


def high_load_cells(task2: Mapping[str, Any], architecture: str) -> list[Cell]:
    """Cells of the interval sweep with many targets for the observers, by rising interval.

    They have the most targets of the first scenario with several numbers of targets, or of the
    first scenario if none has several.
    """
    found = _by_interval(task2, architecture)
    several = [cells for cells in found.values() if len(cells) > 1]
    chosen = (several or list(found.values()))[:1]
    return [cell for cells in chosen for cell in cells[max(cells)]]


def tasking_variants(task2: Mapping[str, Any]) -> dict[str, str]:
    """Tasking method by variant with cells (empty: the usual settings).

    `task2` is the configuration key.
    """
    changed = {
        cell.variant: task2["variants"]["cells"][cell.variant]["change"]["tasking"]["method"]
        for cell in variant_cells(task2)
        if "method" in task2["variants"]["cells"][cell.variant]["change"].get("tasking", {})
    }
    return {"": task2["tasking"]["method"]} | changed


def learned_cell(task2: Mapping[str, Any]) -> list[Cell]:
    """The cell that shows what is learned about body parameters, if any cell estimates them.

    It is the first with the most kinds of estimated parameters, and among those with the most kinds
    that are drawn at random.
    """
    entries = task2["variants"]["cells"]

    def kinds(cell: Cell) -> tuple[int, int]:
        change = entries[cell.variant]["change"]
        estimated = change.get("batch", {}).get("estimated_parameters", {})
        drawn = change.get("truth", {}).get("parameter_sigma", {})
        return sum(map(bool, estimated.values())), sum(map(bool, drawn.values()))

    found = [cell for cell in variant_cells(task2) if cell.estimator == "batch"]
    found = [cell for cell in found if kinds(cell)[0]]
    return [max(found, key=kinds)] if found else []


def characterized_cells(task2: Mapping[str, Any]) -> dict[str, list[Cell]]:
    """The variants in which models of bodies are chosen, a group of cells for each, all days
    together; by a name that has scenario, architecture, variant and number of targets."""
    found: dict[str, list[Cell]] = {}
    for cell in variant_cells(task2):
        change = task2["variants"]["cells"][cell.variant]["change"]
        effort = change.get("batch", {}).get("model_selection", {}).get("effort", 0)
        if cell.estimator != "batch" or effort == 0:
            continue
        variant, _ = unpooled_variant(cell.variant, task2["variants"]["pooled"])
        name = f"{cell.scenario}_{cell.architecture}_{variant}_nt{cell.targets}"
        found.setdefault(name, []).append(cell)
    return found
