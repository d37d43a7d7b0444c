"""Makes tables/claims_architecture.csv: the paper's numbers and claims on the architecture."""

from collections import defaultdict
from pathlib import Path

from cislunar.campaign.claims.architecture import comparison_claims, cost_claims, library_claims
from cislunar.campaign.claims.judges import claims_table
from cislunar.campaign.data.netcdf import read_dataset, write_text
from cislunar.campaign.data.progress import job

with job(snakemake.log[0]):
    orbits = read_dataset(snakemake.input.orbits)
    architectures = defaultdict(dict)
    for path in map(Path, snakemake.input.architectures):
        architectures[path.parent.name][path.stem] = read_dataset(path)
    claims = library_claims(orbits, read_dataset(snakemake.input.points))
    for scenario, found in architectures.items():
        claims += cost_claims(scenario, found)
    claims += comparison_claims(architectures, orbits)
    write_text(claims_table(claims).to_csv(index=False), snakemake.output[0])
