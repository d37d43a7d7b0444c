"""Which tracking cells the figures show, from the configuration.

The paper shows a few of its cells; those that the configuration has are taken, and the nearest
thing to them where it has none. Nothing here needs matplotlib or the compiled library, so that a
workflow can ask at once.
"""

from collections.abc import Mapping
from typing import Any

from cislunar.campaign.settings.cells import Cell, grid_cells, variant_cells

PREFERRED_ARCHITECTURE = "tpe"
"""The paper tracks with the architectures of its own optimizer."""

PAPER_COUNTS = (20, 30, 50, 100)
"""Numbers of targets in the paper's figure 5."""


def figure_architectures(task2: Mapping[str, Any]) -> list[str]:
    """Architectures that figures of single cells are drawn for, the preferred one first."""
    return sorted(task2["architectures"], key=lambda name: name != PREFERRED_ARCHITECTURE)


def _cells(task2: Mapping[str, Any], architecture: str) -> list[Cell]:
    """Cells of the sweeps of an architecture with the first estimator."""
    estimator = task2["estimators"][0]
    return [
        cell
        for cell in grid_cells(task2)
        if cell.architecture == architecture and cell.estimator == estimator
    ]


def _by_targets(task2: Mapping[str, Any], architecture: str) -> list[Cell]:
    """Sweep over the number of targets in the first scenario, in rising order."""
    cells = [c for c in _cells(task2, architecture) if c.interval_minutes == _usual(task2)]
    scenario = next((s for s in task2["target_counts"] if any(c.scenario == s for c in cells)), "")
    counts = set(task2["target_counts"].get(scenario, ()))
    found = [c for c in cells if c.scenario == scenario and c.targets in counts]
    return sorted(found, key=lambda cell: cell.targets)


def _usual(task2: Mapping[str, Any]) -> int:
    return int(task2["interval_minutes"])


def target_count_cells(task2: Mapping[str, Any], architecture: str) -> list[list[Cell]]:
    """Cells of the heat maps in one group, rising in the number of targets; none gives no group.

    The paper's; without any of them, up to three of the fewest and the most. `task2` is the
    configuration key.
    """
    cells = _by_targets(task2, architecture)
    chosen = [c for c in cells if c.targets in PAPER_COUNTS] or [*cells[:3], *cells[3:][-1:]]
    return [chosen] if chosen else []


def selected_cell(task2: Mapping[str, Any], architecture: str) -> list[Cell]:
    """The cell whose targets are shown, if any: the fewest targets of the first scenario."""
    return _by_targets(task2, architecture)[:1]


def _by_interval(task2: Mapping[str, Any], architecture: str) -> dict[str, dict[int, list[Cell]]]:
    """Cells of the interval sweep, by scenario and number of targets, in rising order."""
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


def interval_cells(task2: Mapping[str, Any], architecture: str) -> list[list[Cell]]:
    """Cells of the heat maps by interval: of each scenario those with its fewest targets."""
    return [found[min(found)] for found in _by_interval(task2, architecture).values()]


def high_load_cells(task2: Mapping[str, Any], architecture: str) -> list[Cell]:
    """Cells of the interval sweep with many targets for the observers, rising in the interval.

    Of the first scenario with several numbers of targets (of the first scenario, if none has),
    those with the most.
    """
    found = _by_interval(task2, architecture)
    several = [cells for cells in found.values() if len(cells) > 1]
    chosen = (several or list(found.values()))[:1]
    return [cell for cells in chosen for cell in cells[max(cells)]]


def tasking_variants(task2: Mapping[str, Any]) -> dict[str, str]:
    """Method by variant (empty: the usual settings) of how targets are assigned.

    Only those with cells; `task2` is the configuration key.
    """
    changed = {
        cell.variant: task2["variants"]["cells"][cell.variant]["change"]["tasking"]["method"]
        for cell in variant_cells(task2)
        if "method" in task2["variants"]["cells"][cell.variant]["change"].get("tasking", {})
    }
    return {"": task2["tasking"]["method"]} | changed


def learned_cell(task2: Mapping[str, Any]) -> list[Cell]:
    """The cell that shows what is learned of bodies, if any has unknowns: the one with the most.

    The first of those, with most drawn at random.
    """
    entries = task2["variants"]["cells"]

    def unknowns(cell: Cell) -> tuple[int, int]:
        change = entries[cell.variant]["change"]
        estimated = change.get("batch", {}).get("unknowns", {})
        drawn = change.get("truth", {}).get("spread", {})
        return sum(map(bool, estimated.values())), sum(map(bool, drawn.values()))

    found = [cell for cell in variant_cells(task2) if cell.estimator == "batch"]
    found = [cell for cell in found if unknowns(cell)[0]]
    return [max(found, key=unknowns)] if found else []
