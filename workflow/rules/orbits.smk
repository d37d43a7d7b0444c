use rule result as families with:
    output:
        results("orbits/families.nc"),
    log:
        log_of("orbits/families"),
        times=benchmark_of("families"),
    params:
        function="campaign.data.families_dataset",
        progress="families",
        settings=settings("orbits"),
    message:
        "Generating the candidate observer orbits"


use rule result as own_observers with:
    input:
        path=lambda wildcards: OBSERVERS[wildcards.observers],
    output:
        results("orbits/observers_{observers}.nc"),
    log:
        log_of("orbits/observers_{observers}"),
        times=benchmark_of("own_observers/{observers}"),
    params:
        function="campaign.data.own_observers_dataset",
        progress="observers",
        days=longest_horizon(STUDY),
    message:
        "Reading the observers in {input}"


use rule result as tracked_targets with:
    output:
        results("orbits/tracked.nc"),
    log:
        log_of("orbits/tracked"),
        times=benchmark_of("tracked_targets"),
    params:
        function="campaign.tracking.tracked_dataset",
        progress="targets",
    message:
        "Generating the orbits of the moving targets"


use rule result as own_tracked_targets with:
    input:
        path=lambda wildcards: STUDY["scenarios"][wildcards.scenario]["tracked"],
    output:
        results("orbits/tracked_{scenario}.nc"),
    log:
        log_of("orbits/tracked_{scenario}"),
        times=benchmark_of("own_tracked_targets/{scenario}"),
    wildcard_constraints:
        scenario=any_of(name for name, entry in STUDY["scenarios"].items() if "tracked" in entry),
    params:
        function="campaign.data.own_tracked_dataset",
        epoch=lambda wildcards, input: tracked_epoch(
            scenario_settings(STUDY, wildcards.scenario), input[0]
        ),
    message:
        "Reading the moving targets in {input}"


use rule result as refined_orbits with:
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
    params:
        function="campaign.data.refined_dataset",
        progress="orbits",
        settings={
            "dynamics": TASK2["dynamics"],
            "epoch_jd": config["epoch_jd"],
            "duration_days": config["visibility"]["duration_days"],
        },
    message:
        "Refining the orbits of {wildcards.orbits} with Earth, Moon and Sun from the ephemeris"


use rule result as refined_orbits_table with:
    input:
        observers=results("orbits/refined_families.nc"),
        targets=results("orbits/refined_tracked.nc"),
    output:
        table_file("refined_orbits"),
    log:
        log_of("tables/refined_orbits"),
    params:
        function="campaign.data.refined_rows",
    message:
        "Writing the table of ephemeris-refined orbits"
