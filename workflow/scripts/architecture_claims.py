"""Makes tables/claims_architecture.csv: the paper's numbers and claims on the architecture."""

from cislunar.runtime.worker_client import in_worker

in_worker()

import sys
from collections import defaultdict
from pathlib import Path

from cislunar.runtime import read_dataset, write_text
from cislunar.runtime.job import job

sys.path.append(str(Path(snakemake.scriptdir).parents[1]))
from workflow.documents.claims.architecture import comparison_claims, cost_claims, library_claims
from workflow.documents.claims.judges import claims_table

with job(snakemake.log):
    orbits = read_dataset(snakemake.input.orbits)
    architectures = defaultdict(dict)
    for path in map(Path, snakemake.input.architectures):
        architectures[path.parent.name][path.stem] = read_dataset(path)
    claims = library_claims(orbits, read_dataset(snakemake.input.points))
    for scenario, found in architectures.items():
        claims += cost_claims(scenario, found)
    claims += comparison_claims(architectures, orbits)
    write_text(claims_table(claims).to_csv(index=False), snakemake.output[0])
