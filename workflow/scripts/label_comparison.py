"""Makes tables/label_comparison.csv: J of TPE by the labels of the orbits."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from pathlib import Path

import pandas as pd

from cislunar.runtime import read_dataset, write_text
from cislunar.runtime.job import job

with job(snakemake.log):
    rows = []
    for path in map(Path, snakemake.input):
        run = read_dataset(path)
        _, labels = path.stem.split("_", 1)
        labels, number = labels.rsplit("_", 1)
        rows.append(
            {
                "scenario": path.parent.parent.name,
                "labels": labels,
                "run": int(number),
                "J": float(run["J"]),
                "satellites": int(run["satellites"].sum()),
                "evaluations": run.sizes["evaluation"],
            }
        )
    write_text(pd.DataFrame(rows).to_csv(index=False), snakemake.output[0])
