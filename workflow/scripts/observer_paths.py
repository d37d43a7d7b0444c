"""Makes orbits/paths.nc: where observers are among Earth, Moon and Sun as they are."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset, write_dataset
from cislunar.campaign.data.progress import progress_log
from cislunar.campaign.data.refined_orbits import paths_dataset

with job(snakemake.log):
    paths = paths_dataset(
        read_dataset(snakemake.input.orbits),
        read_dataset(snakemake.input.bodies),
        snakemake.params.settings,
        snakemake.params.max_satellites,
        progress_log("orbits"),
    )
    write_dataset(paths, snakemake.output[0])
