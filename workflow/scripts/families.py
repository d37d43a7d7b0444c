"""Makes orbits/families.nc: the candidate observer orbits of all families."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from cislunar.campaign.data.inputs import families_dataset
from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import write_dataset
from cislunar.campaign.data.progress import progress_log

with job(snakemake.log):
    orbits = families_dataset(snakemake.params.settings, progress_log("families"))
    write_dataset(orbits, snakemake.output[0])
