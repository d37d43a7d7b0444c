"""Autonomous cislunar space domain awareness: the campaign of Paul & Fan and beyond."""

import os
import re
import sys

from snakemake.utils import min_version

min_version("9.0")


report: "workflow/report/start.rst"


configfile: "config/config.yaml"
configfile: "config/variants.yaml"


include: "workflow/rules/common.smk"
include: "workflow/rules/ephemeris.smk"
include: "workflow/rules/orbits.smk"
include: "workflow/rules/targets.smk"
include: "workflow/rules/visibility.smk"
include: "workflow/rules/architecture.smk"
include: "workflow/rules/tables.smk"
include: "workflow/rules/task2.smk"
include: "workflow/rules/study.smk"
include: "workflow/rules/sweeps.smk"
include: "workflow/rules/tracking_figures.smk"
include: "workflow/rules/figures.smk"


# A requested file that no rule makes is refused here with a message of one line. Snakemake knows the
# requested files only after reading this file, so the command line is read.
for option, asked in zip(sys.argv, sys.argv[1:]):
    if not re.search(r"^[^-=][^=]*[.](nc|csv|md|svg|png|pdf|html)$", asked) or os.path.exists(
        asked
    ):
        continue
    if option in ("--report", "--report-html-path", "--archive", "--directory", "-d"):
        continue
    try:
        check_request(
            asked,
            [str(output) for rule in workflow.rules for output in rule.output],
            KNOWN_WILDCARDS,
            any(rule.is_producer(asked) for rule in workflow.rules),
        )
    except CislunarError as error:
        raise SystemExit(f"error: {error}") from None


rule all:
    default_target: True
    input:
        rules.task1.input,
        rules.task2.input,
        rules.paper_vs_ours.output if OF_THE_PAPER else [],
        rules.results_page.output if CELLS and OF_THE_PAPER else [],
        rules.sweeps.input,
        rules.figures.input,
