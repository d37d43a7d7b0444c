"""Autonomous cislunar space domain awareness: the campaign of Paul & Fan and beyond."""

from snakemake.utils import min_version

min_version("9.0")


report: "workflow/report/start.rst"


include: "workflow/rules/config_files.smk"


configfile: "config/config.yaml"
configfile: "config/variants.yaml"


include: "workflow/rules/common.smk"
include: "workflow/rules/result.smk"
include: "workflow/rules/ephemeris.smk"
include: "workflow/rules/orbits.smk"
include: "workflow/rules/targets.smk"
include: "workflow/rules/visibility.smk"
include: "workflow/rules/architecture.smk"
include: "workflow/rules/tables.smk"
include: "workflow/rules/task2.smk"
include: "workflow/rules/study.smk"
include: "workflow/rules/sweeps.smk"
include: "workflow/rules/surveys.smk"
include: "workflow/rules/tracking_figures.smk"
include: "workflow/rules/figures.smk"
include: "workflow/rules/extents.smk"
include: "workflow/rules/requests.smk"


rule all:
    default_target: True
    input:
        rules.paper.input if AS_SHIPPED else rules.everything.input,
