"""Makes tables/objectives_{scenario}.csv: every architecture under every objective."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from pathlib import Path

import pandas as pd

from cislunar.campaign.architectures.goals import World
from cislunar.campaign.architectures.moving import Moving
from cislunar.campaign.architectures.objectives_table import objective_row, of_front, single
from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset, write_text
from cislunar.campaign.data.progress import each

with job(snakemake.log, snakemake.threads):
    scenario, read = snakemake.wildcards.scenario, snakemake.input
    settings, seed = snakemake.params.settings, snakemake.params.seed
    world = World(*(read_dataset(read[name]) for name in World._fields))
    moving = Moving(world.tracked, world.sun, settings, scenario=scenario, seed=seed)
    flown = [(one, world) for path in map(Path, read.fronts)
             for one in of_front(path.stem, read_dataset(path))]  # fmt: skip
    for path, orbits in zip(map(Path, read.architectures), read.own_orbits, strict=True):
        own = world._replace(orbits=read_dataset(orbits))
        flown.append((single(path.stem, read_dataset(path)), own))
    rows = [
        objective_row(scenario, one, own, settings, moving)
        for one, own in each(flown, "architectures")
    ]
    write_text(pd.DataFrame(rows).to_csv(index=False), snakemake.output[0])
