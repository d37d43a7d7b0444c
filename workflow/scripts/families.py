"""Makes orbits/families.nc: the candidate observer orbits of all families."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.data.inputs import families_dataset
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import write_dataset
from cislunar.runtime.progress import progress_log

with job(snakemake.log):
    orbits = families_dataset(snakemake.params.settings, progress_log("families"))
    write_dataset(orbits, snakemake.output[0])
