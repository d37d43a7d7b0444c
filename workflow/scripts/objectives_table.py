"""Makes tables/objectives_{scenario}.csv: every architecture under every objective."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from pathlib import Path

import pandas as pd

from cislunar.campaign.architectures import front_architectures, objective_row, single_architecture
from cislunar.campaign.architectures.moving import MovingTargets
from cislunar.campaign.architectures.objectives import ArchitectureInputs
from cislunar.runtime import each, read_dataset, write_text
from cislunar.runtime.job import job

with job(snakemake.log, snakemake.threads):
    scenario, read = snakemake.wildcards.scenario, snakemake.input
    settings, seed = snakemake.params.settings, snakemake.params.seed
    inputs = ArchitectureInputs(*(read_dataset(read[name]) for name in ArchitectureInputs._fields))
    moving = MovingTargets(inputs.tracked, inputs.sun, settings, scenario=scenario, seed=seed)
    flown = [(one, inputs) for path in map(Path, read.fronts)
             for one in front_architectures(path.stem, read_dataset(path))]  # fmt: skip
    for path, orbits in zip(map(Path, read.architectures), read.own_orbits, strict=True):
        own = inputs._replace(orbits=read_dataset(orbits))
        flown.append((single_architecture(path.stem, read_dataset(path)), own))
    rows = [
        objective_row(scenario, one, own, settings, moving)
        for one, own in each(flown, "architectures")
    ]
    write_text(pd.DataFrame(rows).to_csv(index=False), snakemake.output[0])
