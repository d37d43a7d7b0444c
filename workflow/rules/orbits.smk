rule families:
    output:
        results("orbits/families.nc"),
    log:
        log_of("orbits/families"),
        times=benchmark_of("families"),
    conda:
        "../envs/cislunar.yaml"
    params:
        settings=settings("orbits"),
    message:
        "Generating the candidate observer orbits"
    script:
        "../scripts/families.py"


rule own_observers:
    input:
        lambda wildcards: OBSERVERS[wildcards.observers],
    output:
        results("orbits/observers_{observers}.nc"),
    log:
        log_of("orbits/observers_{observers}"),
        times=benchmark_of("own_observers/{observers}"),
    conda:
        "../envs/cislunar.yaml"
    params:
        days=longest_horizon(STUDY),
    message:
        "Reading the observers in {input}"
    script:
        "../scripts/own_observers.py"


rule tracked_targets:
    output:
        results("orbits/tracked.nc"),
    log:
        log_of("orbits/tracked"),
        times=benchmark_of("tracked_targets"),
    conda:
        "../envs/cislunar.yaml"
    message:
        "Generating the orbits of the moving targets"
    script:
        "../scripts/tracked_targets.py"


rule own_tracked_targets:
    input:
        lambda wildcards: STUDY["scenarios"][wildcards.scenario]["tracked"],
    output:
        results("orbits/tracked_{scenario}.nc"),
    log:
        log_of("orbits/tracked_{scenario}"),
        times=benchmark_of("own_tracked_targets/{scenario}"),
    wildcard_constraints:
        scenario=any_of(name for name, entry in STUDY["scenarios"].items() if "tracked" in entry),
    conda:
        "../envs/cislunar.yaml"
    params:
        epoch=lambda wildcards, input: tracked_epoch(
            scenario_settings(STUDY, wildcards.scenario), input[0]
        ),
    message:
        "Reading the moving targets in {input}"
    script:
        "../scripts/own_tracked_targets.py"


rule refined_orbits:
    input:
        orbits=results("orbits/{orbits}.nc"),
        bodies=rules.bodies.output[0],
    output:
        results("orbits/refined_{orbits}.nc"),
    log:
        log_of("orbits/refined_{orbits}"),
        times=benchmark_of("refined_orbits/{orbits}"),
    wildcard_constraints:
        orbits="families|tracked",
    conda:
        "../envs/cislunar.yaml"
    params:
        settings={
            "dynamics": TASK2["dynamics"],
            "epoch_jd": config["epoch_jd"],
            "duration_days": config["visibility"]["duration_days"],
        },
    message:
        "Refining the orbits of {wildcards.orbits} with Earth, Moon and Sun from the ephemeris"
    script:
        "../scripts/refined_orbits.py"


rule refined_orbits_table:
    input:
        expand(rules.refined_orbits.output, orbits=["families", "tracked"]),
    output:
        table_file("refined_orbits"),
    log:
        log_of("tables/refined_orbits"),
    conda:
        "../envs/cislunar.yaml"
    params:
        uses=["observers", "targets"],
    message:
        "Writing the table of ephemeris-refined orbits"
    script:
        "../scripts/refined_orbits_table.py"
