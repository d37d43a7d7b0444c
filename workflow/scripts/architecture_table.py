"""Makes tables/architecture.csv and tables/near_optimal.csv: Table 2 of the paper and beyond."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from pathlib import Path

import pandas as pd

from cislunar.campaign.architectures.table2 import architecture_rows, near_optimal_rows
from cislunar.runtime import each, read_dataset, write_text
from cislunar.runtime.job import job

with job(snakemake.log, snakemake.threads):
    orbits = read_dataset(snakemake.input.orbits)
    settings = snakemake.params.settings
    suns = dict(zip(settings, snakemake.input.suns, strict=True))
    targets = dict(zip(settings, snakemake.input.targets, strict=True))
    rows, near = [], []
    for path in map(Path, each(snakemake.input.architectures, "architectures")):
        scenario, optimizer = path.parent.name, path.stem
        architecture = read_dataset(path)
        rows.append(
            architecture_rows(
                scenario,
                optimizer,
                architecture,
                orbits,
                read_dataset(targets[scenario]),
                read_dataset(suns[scenario]),
                settings[scenario],
            )
        )
        if optimizer == "exact":
            near.append(near_optimal_rows(scenario, architecture, orbits))
    write_text(pd.concat(rows).to_csv(index=False), snakemake.output.architecture)
    table = pd.concat(near) if near else pd.DataFrame(columns=["scenario"])
    write_text(table.to_csv(index=False), snakemake.output.near_optimal)
