"""Generalization of architectures chosen by information to targets on which they were not
chosen."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from cislunar.architecture.information import InformationObjective, certify_information
from cislunar.campaign.architectures.moving import MovingTargets, orbit_set
from cislunar.campaign.architectures.objectives import ArchitectureInputs, candidate_slots
from cislunar.runtime.progress import Progress, counted

_DEFAULT_SLOTS = {"max_stability_index": 2.0, "phases": 10}
"""Orbits and phases, as designs have them by default."""

_STEPS = 50
"""Steps of each bound, of which only the architecture found is used."""


def _classes_of(tracked: xr.Dataset, least: int) -> dict[str, NDArray[np.bool_]]:
    """Classes of at least `least` targets, and the targets (target,) in each.

    A class is the families whose names begin with the same word: `Halo_L1_N` and `Halo_L2_S` are of
    the class `Halo`.
    """
    word = np.array([name.split("_")[0] for name in tracked["family"].values.astype(str)])
    members = {name: word == name for name in dict.fromkeys(word.tolist())}
    return {name: own for name, own in members.items() if own.sum() >= least and not own.all()}


def generalization_rows(
    inputs: ArchitectureInputs,
    settings: Mapping[str, Any],
    *,
    scenario: str,
    seed: int,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Rows of ``tables/objectives_generalization.csv``; for `settings` see
    `cislunar.campaign.architectures.objectives.objective_of`.

    They also have the key `generalization` of `architecture`. The architectures chosen on the
    campaign's targets are evaluated on other sets of targets, sampled and placed by other seeds, in
    another number of windows, beside architectures chosen on each of these sets. For each class of
    targets, architectures chosen without it, on all targets and on the class alone are evaluated on
    it.
    `progress` counts sets and classes.
    """
    requested, candidates = (
        settings["generalization"],
        candidate_slots(_DEFAULT_SLOTS, inputs.orbits, settings),
    )
    library, usual = orbit_set(inputs.orbits), settings["information"]

    def objective(tracked: xr.Dataset = inputs.tracked, **changes: Any) -> InformationObjective:
        own = usual | changes
        own["targets"] = min(own["targets"], tracked.sizes["target"])
        moving = MovingTargets(
            tracked, inputs.sun, {**settings, "information": own}, scenario=scenario, seed=seed
        )
        return InformationObjective(moving.tables("information", library, candidates.orbit_slots))

    classes = _classes_of(inputs.tracked, requested["least"])
    judges = [(own, "") for own in requested["target_seeds"]] + [(0, name) for name in classes]
    all_of_them = objective()

    def found(number: int, of: InformationObjective) -> NDArray[np.int64]:
        return certify_information(of, number, steps=_STEPS).orbit

    numbers, campaign = requested["satellites"], "the campaign's"
    rows, known = [], {number: found(number, all_of_them) for number in numbers}
    for judge, name in counted(judges, progress):
        own = inputs.tracked if name == "" else inputs.tracked.isel(target=classes[name])
        changes = {"target_seed": judge, "windows": requested["windows"]} if name == "" else {}
        by = objective(own, **changes)
        chosen = {campaign: known, "these": {number: found(number, by) for number in numbers}}
        if name:
            others = objective(inputs.tracked.isel(target=~classes[name]))
            chosen["others"] = {number: found(number, others) for number in numbers}
        for on, slots_by_number in chosen.items():
            for number, chosen_slots in slots_by_number.items():
                information = by.item_values(by.sums(np.sort(chosen_slots)))
                rows.append({
                    "scenario": scenario,
                    "satellites": number,
                    "targets_by": "class" if name else "seed",
                    "targets_of": name or judge,
                    "targets": by.tables.shape[1],
                    "windows": by.tables.shape[0],
                    "chosen_on": on,
                    "information_nat": float(np.mean(information)),
                    "unseen_share": float(np.mean(information == 0.0)),
                })  # fmt: skip
    return pd.DataFrame(rows)
