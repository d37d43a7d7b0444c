"""What every stage needs: the checked configuration, the results folder, the wildcards."""

import os

from snakemake.exceptions import WorkflowError

from cislunar.campaign.configuration import check_campaign, load_schema
from cislunar.errors import CislunarError

try:
    check_campaign(config, load_schema(workflow.source_path("../schemas/config.schema.yaml")))
except CislunarError as error:
    raise WorkflowError(f"{error}\n(see config/README.md)") from None

RESULTS = config["results"].rstrip("/")
SCENARIOS = list(config["scenarios"])
ARCHITECTURE = config["architecture"]
OPTIMIZERS = ARCHITECTURE["optimizers"]
SEARCHES = ["tpe", "random", "atpe"]
RUNS = range(ARCHITECTURE["runs"])


wildcard_constraints:
    scenario="|".join(SCENARIOS),
    method="|".join(SEARCHES),
    labels="family_position|index|stability_rank|categorical",
    run=r"\d+",
    architecture="[A-Za-z][A-Za-z0-9-]*",
    estimator="|".join(config["task2"]["estimators"]),
    n=r"[1-9]\d*",
    minutes=r"[1-9]\d*",
    variant="[a-z][a-z0-9-]*",


def settings(*keys):
    """The slice of the configuration a rule depends on."""
    return {key: config[key] for key in keys}


def results(path):
    """A path in the results folder."""
    return f"{RESULTS}/{path}"


def log_of(path):
    """The log file of a result."""
    return f"{RESULTS}/logs/{path}.log"


def benchmark_of(path):
    """The file with a job's time and memory."""
    return f"{RESULTS}/benchmarks/{path}.tsv"


def optimizers_of(scenario):
    """The optimizers of a scenario; the paper publishes architectures for its own alone."""
    return [o for o in OPTIMIZERS if o != "published" or scenario in ("A", "B", "C")]
