"""What architectures chosen by information keep on targets that they were not chosen on."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from cislunar.architecture.information.certificate import certify_information
from cislunar.architecture.information.objective import InformationObjective
from cislunar.campaign.architectures.goals import World, where
from cislunar.campaign.architectures.moving import Moving, orbit_set
from cislunar.campaign.data.progress import Progress

PLACES = {"max_stability_index": 2.0, "phases": 10}
"""Orbits and phases, as designs have them by default."""

_STEPS = 50
"""Steps of each bound: what is asked here is what was found."""


def classes_of(tracked: xr.Dataset, least: int) -> dict[str, NDArray[np.bool_]]:
    """Classes of at least so many targets, and which targets (target,) are in each.

    A class is the families whose names begin with the same word: `Halo_L1_N` and `Halo_L2_S` are
    of the class `Halo`.
    """
    word = np.array([name.split("_")[0] for name in tracked["family"].values.astype(str)])
    members = {name: word == name for name in dict.fromkeys(word.tolist())}
    return {name: own for name, own in members.items() if own.sum() >= least and not own.all()}


def elsewhere_rows(
    world: World,
    settings: Mapping[str, Any],
    *,
    scenario: str,
    seed: int,
    progress: Progress | None = None,
) -> list[dict[str, Any]]:
    """Rows of ``tables/objectives_elsewhere.csv``; `settings` as of `goals.objective_of`.

    With the key `elsewhere` of `architecture`. The architectures chosen on the targets of the
    campaign are judged by other sets of targets, drawn and placed by seeds of their own, in another
    number of windows, beside those chosen on each of these. For each class of targets,
    architectures chosen without it, on all and on it alone are judged by it. `progress` counts
    sets and classes.
    """
    wanted, places = settings["elsewhere"], where(PLACES, world.orbits, settings)
    library, usual = orbit_set(world.orbits), settings["information"]

    def objective(tracked: xr.Dataset = world.tracked, **changes: Any) -> InformationObjective:
        own = usual | changes
        own["targets"] = min(own["targets"], tracked.sizes["target"])
        moving = Moving(
            tracked, world.sun, {**settings, "information": own}, scenario=scenario, seed=seed
        )
        return InformationObjective(moving.tables("information", library, places.places))

    classes = classes_of(world.tracked, wanted["least"])
    judges = [(own, "") for own in wanted["target_seeds"]] + [(0, name) for name in classes]
    all_of_them = objective()

    def found(number: int, of: InformationObjective) -> NDArray[np.int64]:
        return certify_information(of, number, steps=_STEPS).orbit

    numbers, campaign = wanted["satellites"], "the campaign's"
    rows, known = [], {number: found(number, all_of_them) for number in numbers}
    for done, (judge, name) in enumerate(judges):
        own = world.tracked if name == "" else world.tracked.isel(target=classes[name])
        changes = {"target_seed": judge, "windows": wanted["windows"]} if name == "" else {}
        by = objective(own, **changes)
        chosen = {campaign: known, "these": {number: found(number, by) for number in numbers}}
        if name:
            others = objective(world.tracked.isel(target=~classes[name]))
            chosen["others"] = {number: found(number, others) for number in numbers}
        for on, places_of in chosen.items():
            for number, place in places_of.items():
                told = by.item_values(by.sums(np.sort(place)))
                rows.append({
                    "scenario": scenario,
                    "satellites": number,
                    "targets_by": "class" if name else "seed",
                    "targets_of": name or judge,
                    "targets": by.tables.shape[1],
                    "windows": by.tables.shape[0],
                    "chosen_on": on,
                    "information_nat": float(np.mean(told)),
                    "unseen_share": float(np.mean(told == 0.0)),
                })  # fmt: skip
        if progress is not None:
            progress(done + 1, len(judges))
    return rows
