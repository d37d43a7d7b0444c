"""Makes tables/objectives_elsewhere_{scenario}.csv: information about targets not chosen on."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

import pandas as pd

from cislunar.campaign.architectures.elsewhere import elsewhere_rows
from cislunar.campaign.architectures.goals import World
from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset, write_text
from cislunar.campaign.data.progress import progress_log

with job(snakemake.log, snakemake.threads):
    rows = elsewhere_rows(
        World(*(read_dataset(snakemake.input[name]) for name in World._fields)),
        snakemake.params.settings,
        scenario=snakemake.wildcards.scenario,
        seed=snakemake.params.seed,
        progress=progress_log("sets and classes of targets"),
    )
    write_text(pd.DataFrame(rows).to_csv(index=False), snakemake.output[0])
