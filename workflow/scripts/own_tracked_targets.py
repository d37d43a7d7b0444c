"""Makes orbits/tracked_{scenario}.nc: moving targets from a table, a catalogue or an OEM."""

from cislunar.campaign.data.netcdf import write_dataset
from cislunar.campaign.data.own_targets import own_tracked_dataset
from cislunar.campaign.data.progress import job

with job(snakemake.log[0]):
    write_dataset(
        own_tracked_dataset(snakemake.input[0], snakemake.params.epoch), snakemake.output[0]
    )
