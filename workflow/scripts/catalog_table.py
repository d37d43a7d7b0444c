"""Makes tables/catalog.csv: the surveys of a study, over their realizations."""

from cislunar.runtime.worker_client import in_worker

in_worker()

import pandas as pd

from cislunar.campaign.settings import StatedSurvey, typed
from cislunar.campaign.survey.table import catalog_rows
from cislunar.runtime import write_text
from cislunar.runtime.job import job

with job(snakemake.log, snakemake.threads):
    params, paths = snakemake.params, iter(snakemake.input)
    surveys = {name: typed(each, StatedSurvey, f"surveys.{name}")
               for name, each in params.surveys.items()}  # fmt: skip
    found = {name: [pd.read_csv(next(paths)) for _ in range(each.realizations)]
             for name, each in surveys.items()}  # fmt: skip
    rows = catalog_rows(surveys, found, params.field_of_view_deg)
    write_text(rows.to_csv(index=False), snakemake.output[0])
