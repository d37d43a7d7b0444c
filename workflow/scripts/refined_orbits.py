"""Makes orbits/refined_{orbits}.nc: orbits refined into paths among the bodies as they are."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset, write_dataset
from cislunar.campaign.data.progress import progress_log
from cislunar.campaign.data.refined_orbits import refined_dataset

with job(snakemake.log):
    refined = refined_dataset(
        read_dataset(snakemake.input.orbits),
        read_dataset(snakemake.input.bodies),
        snakemake.params.settings,
        progress_log("orbits"),
    )
    write_dataset(refined, snakemake.output[0])
