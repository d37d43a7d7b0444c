"""Surveys that start without a catalog: realizations, their table and figure."""


wildcard_constraints:
    survey=any_of(SURVEYS),


rule survey:
    input:
        architecture=survey_file("architecture/{scenario}/{architecture}.nc"),
        orbits=lambda wildcards: orbits_file(survey_of(wildcards)["architecture"]),
        tracked=lambda wildcards: shared("orbits/tracked", survey_of(wildcards)["scenario"]),
        sun=lambda wildcards: shared("ephemeris/sun", survey_of(wildcards)["scenario"]),
        bodies=lambda wildcards: (
            shared("ephemeris/bodies", survey_of(wildcards)["scenario"])
            if survey_ephemeris(wildcards) or survey_cell(wildcards).get("stations")
            else []
        ),
        flown=lambda wildcards: (
            results("orbits/flown_{scenario}_{architecture}.nc".format(**survey_of(wildcards)))
            if survey_ephemeris(wildcards)
            else []
        ),
        points=survey_file("targets/static_{scenario}.nc"),
        table=lambda wildcards: survey_of(wildcards)["prior_table"] or [],
        mesh=lambda wildcards: cell_files(survey_cell(wildcards)),
    output:
        results("survey/{survey}/{realization}.csv"),
    log:
        log_of("survey/{survey}/{realization}"),
        times=benchmark_of("survey/{survey}_{realization}"),
    conda:
        "../envs/cislunar.yaml"
    resources:
        mem_mb=lambda wildcards: 2500 + 60 * max(0, survey_of(wildcards)["duration_days"] - 7),
    params:
        survey=survey_settings,
        settings=survey_cell,
        propagator=config["propagator"],
        seed=config["seed"],
    message:
        "Survey {wildcards.survey}, realization {wildcards.realization}"
    script:
        "../scripts/survey.py"


# A realization again, with the record of a replay.
use rule survey as survey_record with:
    output:
        results("replay/survey/{survey}/{realization}.nc"),
    log:
        log_of("replay/survey/{survey}/{realization}"),
        times=benchmark_of("survey_record/{survey}_{realization}"),
    message:
        "Recording survey {wildcards.survey}, realization {wildcards.realization}"


rule catalog_table:
    input:
        [
            results(f"survey/{name}/{number}.csv")
            for name, survey in SURVEYS.items()
            for number in range(survey["realizations"])
        ],
    output:
        table_file("catalog"),
    log:
        log_of("tables/catalog"),
        times=benchmark_of("catalog_table"),
    conda:
        "../envs/cislunar.yaml"
    params:
        surveys=SURVEYS,
        field_of_view_deg=TASK2["sensor"]["field_of_view_deg"],
    message:
        "Comparing surveys"
    script:
        "../scripts/catalog_table.py"


use rule result as catalog_figure with:
    input:
        rules.catalog_table.output[0],
    output:
        **figure_files("catalog", "catalog"),
    log:
        log_of("figures/catalog"),
        times=benchmark_of("catalog_figure"),
    params:
        function="figures.survey.catalog_figure",
    message:
        "Drawing the completeness of catalogs"


rule catalog:
    input:
        rules.catalog_table.output,
        rules.catalog_figure.output,
