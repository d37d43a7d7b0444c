"""Makes orbits/observers_{observers}.nc: the orbits of a table of observers."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import write_dataset
from cislunar.campaign.data.own_targets import own_observers_dataset
from cislunar.campaign.data.progress import progress_log

with job(snakemake.log):
    orbits = own_observers_dataset(
        snakemake.input[0], snakemake.params.days, progress_log("observers")
    )
    write_dataset(orbits, snakemake.output[0])
