"""Makes targets/zvs_points.nc: points within the zero-velocity surface of every mission."""

from cislunar.campaign.data.inputs import zvs_points_dataset
from cislunar.campaign.data.netcdf import write_dataset
from cislunar.campaign.data.progress import job

with job(snakemake.log[0]):
    points = zvs_points_dataset(snakemake.input[0], snakemake.params.settings)
    write_dataset(points, snakemake.output[0])
