"""Makes targets/zvs_points.nc: points within the zero-velocity surface of every mission."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.data.inputs import zvs_points_dataset
from cislunar.runtime.job import job
from cislunar.runtime.netcdf import write_dataset

with job(snakemake.log):
    points = zvs_points_dataset(snakemake.input[0], snakemake.params.settings)
    write_dataset(points, snakemake.output[0])
