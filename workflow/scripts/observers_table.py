"""Makes tables/observers.csv: what observers of one's own reach, as in tables/architecture.csv."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from pathlib import Path

import pandas as pd

from cislunar.campaign.architectures.table2 import architecture_rows
from cislunar.runtime import each, read_dataset, write_text
from cislunar.runtime.job import job

with job(snakemake.log, snakemake.threads):
    read, settings = snakemake.input, snakemake.params.settings
    orbits = dict(zip(snakemake.params.observers, map(read_dataset, read.orbits), strict=True))
    suns = dict(zip(read.architectures, map(read_dataset, read.suns), strict=True))
    targets = dict(zip(settings, map(read_dataset, read.targets), strict=True))
    rows = []
    for file in each(read.architectures, "architectures"):
        path = Path(file)
        scenario, name = path.parent.name, path.stem
        places = orbits[name], targets[scenario], suns[file], settings[scenario]
        found = architecture_rows(scenario, name, read_dataset(path), *places)
        labels = found.drop(columns=["paper_family", "paper_satellites"])
        labels.insert(3, "observer", orbits[name]["name"].values)
        rows.append(labels.rename(columns={"optimizer": "architecture"}))
    write_text(pd.concat(rows).to_csv(index=False), snakemake.output[0])
