"""Makes tables/results.md: each claim of the paper and this library's result, as text."""

from cislunar.runtime.worker_client import in_worker

in_worker()

import sys
from pathlib import Path

import pandas as pd

from cislunar.runtime import read_dataset, write_text
from cislunar.runtime.job import job

sys.path.append(str(Path(snakemake.scriptdir).parents[1]))
from workflow.documents.results_page import results_page, verdicts_svg

with job(snakemake.log):
    tables = {
        "paper_vs_ours": pd.read_csv(snakemake.input.paper_vs_ours, dtype=str),
        "architecture": pd.read_csv(snakemake.input.architecture),
        "tracking": pd.read_csv(snakemake.input.tracking),
    }
    datasets = map(read_dataset, snakemake.input.datasets)
    write_text(results_page(tables, datasets, snakemake.params.config), snakemake.output.page)
    write_text(verdicts_svg(tables["paper_vs_ours"]), snakemake.output.verdicts)
