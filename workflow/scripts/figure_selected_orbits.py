"""Makes figures/fig03_tpe_orbits, fig04_random_orbits and fig09_exact_orbits: observer orbits."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from cislunar.figures.space.architectures import selected_orbits_figure
from cislunar.figures.style import save_figure
from cislunar.runtime import read_dataset
from cislunar.runtime.job import job

with job(snakemake.log):
    scenarios = snakemake.params.scenarios
    architectures = map(read_dataset, snakemake.input.architectures)
    targets = (read_dataset(path).sizes["target"] for path in snakemake.input.targets)
    figure = selected_orbits_figure(
        read_dataset(snakemake.input.orbits),
        dict(zip(scenarios, architectures, strict=True)),
        dict(zip(scenarios, targets, strict=True)),
    )
    save_figure(figure, snakemake.output.png, snakemake.output.pdf)
