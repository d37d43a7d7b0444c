use rule result as search_run with:
    input:
        visibility=rules.visibility.output[0],
        orbits=rules.families.output[0],
    output:
        results("architecture/{scenario}/runs/{method}_{labels}_{run}.nc"),
    log:
        log_of("architecture/{scenario}/{method}_{labels}_{run}"),
        times=benchmark_of("search_run/{method}/{scenario}_{labels}_{run}"),
    priority: 10
    params:
        function="campaign.architectures.search_run_dataset",
        kernels="cislunar.campaign.kernels:KERNEL_SETS:search",
        run=lambda wildcards: int(wildcards.run),
        slots=ARCHITECTURE["slots"],
        max_evaluations=ARCHITECTURE["max_evaluations"],
        early_stop=ARCHITECTURE["early_stop"],
        sampler=ARCHITECTURE["sampler"],
        seed=config["seed"],
    message:
        "Searching with {wildcards.method}, run {wildcards.run} (scenario {wildcards.scenario})"


use rule result as best_run with:
    input:
        runs=expand(
            results("architecture/{{scenario}}/runs/{{method}}_{labels}_{run}.nc"),
            labels=ARCHITECTURE["labels"],
            run=RUNS,
        ),
        visibility=rules.visibility.output[0],
        orbits=rules.families.output[0],
    output:
        results("architecture/{scenario}/{method}.nc"),
    log:
        log_of("architecture/{scenario}/{method}"),
    params:
        function="campaign.architectures.best_run_dataset",
        early_stop=ARCHITECTURE["early_stop"],
    message:
        "Selecting the best of the {wildcards.method} runs (scenario {wildcards.scenario})"


use rule result as exact with:
    input:
        visibility=rules.visibility.output[0],
        orbits=rules.families.output[0],
    output:
        results("architecture/{scenario}/exact.nc"),
    log:
        log_of("architecture/{scenario}/exact"),
        times=benchmark_of("exact/{scenario}"),
    threads: ALL_CORES
    params:
        function="campaign.architectures.exact_dataset",
        slots=ARCHITECTURE["slots"],
        restarts=ARCHITECTURE["restarts"],
        certificate=ARCHITECTURE["certificate"],
        seed=config["seed"],
    message:
        "Bounding J over all architectures (scenario {wildcards.scenario})"


use rule result as published with:
    input:
        visibility=rules.visibility.output[0],
        orbits=rules.families.output[0],
    output:
        results("architecture/{scenario}/published.nc"),
    log:
        log_of("architecture/{scenario}/published"),
        times=benchmark_of("published/{scenario}"),
    params:
        function="campaign.architectures.published_dataset",
        restarts=ARCHITECTURE["restarts"],
        seed=config["seed"],
    message:
        "Selecting members of the published families (scenario {wildcards.scenario})"


use rule result as own_architecture with:
    input:
        visibility=rules.observer_visibility.output[0],
        orbits=rules.own_observers.output[0],
    output:
        results("architecture/{scenario}/{observers}.nc"),
    log:
        log_of("architecture/{scenario}/{observers}"),
        times=benchmark_of("own_architecture/{scenario}_{observers}"),
    params:
        function="campaign.architectures.own_dataset",
        name=lambda wildcards: wildcards.observers,
    message:
        "Evaluating the observers {wildcards.observers} (scenario {wildcards.scenario})"


use rule result as front with:
    input:
        visibility=rules.visibility.output[0],
        orbits=rules.families.output[0],
        targets=rules.static_targets.output[0],
        sun=sky(),
    output:
        results("architecture/{scenario}/front.nc"),
    log:
        log_of("architecture/{scenario}/front"),
        times=benchmark_of("front/{scenario}"),
    priority: 5
    params:
        function="campaign.architectures.front_dataset",
        progress="numbers of satellites",
        slots=ARCHITECTURE["slots"],
        front=ARCHITECTURE["front"],
        settings=settings_of("epoch_jd", "propagator", "visibility"),
        seed=config["seed"],
    message:
        "Searching the best J for each number of satellites (scenario {wildcards.scenario})"


use rule result as design with:
    input:
        lambda wildcards: objective_mesh(wildcards, DESIGNS[wildcards.design]),
        orbits=rules.families.output[0],
        targets=rules.static_targets.output[0],
        tracked=shared("orbits/tracked"),
        sun=shared("ephemeris/sun"),
    output:
        results("architecture/{scenario}/{design}.nc"),
    log:
        log_of("architecture/{scenario}/{design}"),
        times=benchmark_of("design/{scenario}_{design}"),
    resources:
        mem_mb=2000,
    params:
        function="campaign.architectures.design_dataset",
        inputs="campaign.architectures.ArchitectureInputs",
        name=lambda wildcards: wildcards.design,
        progress="orbits",
        design=lambda wildcards: DESIGNS[wildcards.design],
        settings=lambda wildcards: objective_settings(wildcards, DESIGNS[wildcards.design]),
        seed=config["seed"],
    message:
        "Searching for the design {wildcards.design} (scenario {wildcards.scenario})"


use rule result as objective_front with:
    input:
        lambda wildcards: objective_mesh(wildcards, FRONTS[wildcards.front]),
        orbits=rules.families.output[0],
        targets=rules.static_targets.output[0],
        tracked=shared("orbits/tracked"),
        sun=shared("ephemeris/sun"),
    output:
        results("architecture/{scenario}/fronts/{front}.nc"),
    log:
        log_of("architecture/{scenario}/fronts/{front}"),
        times=benchmark_of("objective_front/{scenario}_{front}"),
    priority: 5
    resources:
        mem_mb=2000,
    params:
        function="campaign.architectures.objective_front_dataset",
        inputs="campaign.architectures.ArchitectureInputs",
        name=lambda wildcards: wildcards.front,
        progress="orbits",
        front=lambda wildcards: FRONTS[wildcards.front],
        settings=lambda wildcards: objective_settings(wildcards, FRONTS[wildcards.front]),
        seed=config["seed"],
    message:
        "Searching the front {wildcards.front} by number of satellites (scenario {wildcards.scenario})"
