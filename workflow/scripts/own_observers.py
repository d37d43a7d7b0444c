"""Makes orbits/observers_{observers}.nc: the orbits of a table of observers."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.data.own_targets import own_observers_dataset
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import write_dataset
from cislunar.runtime.progress import progress_log

with job(snakemake.log):
    orbits = own_observers_dataset(
        snakemake.input[0], snakemake.params.days, progress_log("observers")
    )
    write_dataset(orbits, snakemake.output[0])
