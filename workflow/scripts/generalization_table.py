"""Makes tables/objectives_generalization_{scenario}.csv: generalization of architectures to other
targets."""

from cislunar.runtime.worker_client import in_worker

in_worker()

import pandas as pd

from cislunar.campaign.architectures import ArchitectureInputs, generalization_rows
from cislunar.runtime import progress_log, read_dataset, write_text
from cislunar.runtime.job import job

with job(snakemake.log, snakemake.threads):
    rows = generalization_rows(
        ArchitectureInputs(
            *(read_dataset(snakemake.input[name]) for name in ArchitectureInputs._fields)
        ),
        snakemake.params.settings,
        scenario=snakemake.wildcards.scenario,
        seed=snakemake.params.seed,
        progress=progress_log("sets and classes of targets"),
    )
    write_text(pd.DataFrame(rows).to_csv(index=False), snakemake.output[0])
