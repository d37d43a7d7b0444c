"""Makes survey/{survey}/{realization}.csv: quality of the catalog of one realization, or
replay/survey/{survey}/{realization}.nc: its record for a replay."""

from cislunar.runtime.worker_client import in_worker

in_worker()

from functools import partial

from cislunar.campaign.settings import StatedSurvey, typed
from cislunar.campaign.survey.realization import realization_rows, survey_realization
from cislunar.campaign.tracking.cell import read_inputs
from cislunar.runtime import progress_log, read_dataset, write_dataset, write_text
from cislunar.runtime.job import job

with job(snakemake.log, snakemake.threads):
    read, params, name = snakemake.input, snakemake.params, snakemake.wildcards.survey
    output = snakemake.output[0]
    recorded = partial(write_dataset, path=output) if output.endswith(".nc") else None
    result = survey_realization(
        name,
        typed(params.survey, StatedSurvey, f"surveys.{name}"),
        int(snakemake.wildcards.realization),
        read_inputs(read),
        read_dataset(read.points)["position"].values,
        params.settings,
        propagator=params.propagator,
        seed=params.seed,
        progress=progress_log("blocks of the survey and light curves"),
        recorded=recorded,
    )
    if recorded is None:
        write_text(realization_rows(result).to_csv(index=False), output)
