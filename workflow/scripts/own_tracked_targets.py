"""Makes orbits/tracked_{scenario}.nc: moving targets from a table, a catalogue or an OEM."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import write_dataset
from cislunar.campaign.data.own_targets import own_tracked_dataset

with job(snakemake.log):
    write_dataset(
        own_tracked_dataset(snakemake.input[0], snakemake.params.epoch), snakemake.output[0]
    )
