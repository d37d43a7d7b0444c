"""Makes a result by one function of the library, as `cislunar.campaign.result` describes."""

from cislunar.runtime.worker_client import in_worker

in_worker(snakemake.params.get("kernels", ""), f"cislunar.{snakemake.params.function}")

from cislunar.campaign.result import made_result, write_result
from cislunar.runtime.job import job

with job(snakemake.log, snakemake.threads):
    files = dict(snakemake.input.items()) if snakemake.input.keys() else snakemake.input
    known = {**dict(snakemake.wildcards.items()), "threads": snakemake.threads}
    result = made_result(files, dict(snakemake.params.items()), known)
    write_result(result, snakemake.output)
