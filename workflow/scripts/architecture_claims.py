"""Makes tables/claims_architecture.csv: the paper's numbers and claims on the architecture."""

from cislunar.campaign.operation.handing_over import in_worker

in_worker()

from collections import defaultdict
from pathlib import Path

from cislunar.campaign.claims.architecture import comparison_claims, cost_claims, library_claims
from cislunar.campaign.claims.judges import claims_table
from cislunar.campaign.data.job import job
from cislunar.campaign.data.netcdf import read_dataset, write_text

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
