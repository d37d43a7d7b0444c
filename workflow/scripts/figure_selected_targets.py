"""Makes figures/fig06_selected_targets and fig06_components: errors and bounds of a few targets."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.campaign.settings.cells import Cell
from cislunar.figures.style import save_figure
from cislunar.figures.tracking import components_figure, selected_targets_figure
from cislunar.runtime import read_dataset
from cislunar.runtime.job import job

with job(snakemake.log):
    (cell,) = snakemake.params.cell
    draw = {"norms": selected_targets_figure, "components": components_figure}
    figure = draw[snakemake.params.errors](Cell(*cell), read_dataset(snakemake.input[0]))
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
