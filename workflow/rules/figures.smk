PAPER_TARGETS = 2000
LIBRARY_SCENARIO = min(
    SCENARIOS,
    key=lambda name: abs(config["scenarios"][name].get("targets", 0) - PAPER_TARGETS),
)
RUN_METHODS = [method for method in OPTIMIZERS if method in SEARCHES]


rule orbit_library_figure:
    input:
        orbits=rules.families.output[0],
        targets=results(f"targets/static_{LIBRARY_SCENARIO}.nc"),
    output:
        png=report(
            results("figures/fig02_orbit_library.png"),
            caption="../report/figure_orbit_library.rst",
            category="Figures",
        ),
        pdf=results("figures/fig02_orbit_library.pdf"),
    log:
        log_of("figures/orbit_library"),
        times=benchmark_of("orbit_library_figure"),
    conda:
        "../envs/cislunar.yaml"
    params:
        figure="space.orbit_library_figure",
    message:
        "Drawing the orbit library with its targets"
    script:
        "../scripts/figure.py"


rule facet_geometry_figure:
    output:
        png=report(
            results("figures/fig01_facet_geometry.png"),
            caption="../report/figure_facet_geometry.rst",
            category="Figures",
        ),
        pdf=results("figures/fig01_facet_geometry.pdf"),
    log:
        log_of("figures/facet_geometry"),
        times=benchmark_of("facet_geometry_figure"),
    conda:
        "../envs/cislunar.yaml"
    params:
        figure="space.facet_geometry_figure",
    message:
        "Drawing the reflection geometry of a facet"
    script:
        "../scripts/figure.py"


rule tpe_orbits_figure:
    input:
        orbits=rules.families.output[0],
        targets=expand(results("targets/static_{scenario}.nc"), scenario=SCENARIOS),
        architectures=expand(results("architecture/{scenario}/tpe.nc"), scenario=SCENARIOS),
    output:
        png=report(
            results("figures/fig03_tpe_orbits.png"),
            caption="../report/figure_tpe_orbits.rst",
            category="Figures",
        ),
        pdf=results("figures/fig03_tpe_orbits.pdf"),
    log:
        log_of("figures/tpe_orbits"),
        times=benchmark_of("tpe_orbits_figure"),
    conda:
        "../envs/cislunar.yaml"
    params:
        scenarios=SCENARIOS,
    message:
        "Drawing the orbits chosen by TPE"
    script:
        "../scripts/figure_selected_orbits.py"


use rule tpe_orbits_figure as random_orbits_figure with:
    input:
        orbits=rules.families.output[0],
        targets=expand(results("targets/static_{scenario}.nc"), scenario=SCENARIOS),
        architectures=expand(results("architecture/{scenario}/random.nc"), scenario=SCENARIOS),
    output:
        png=report(
            results("figures/fig04_random_orbits.png"),
            caption="../report/figure_random_orbits.rst",
            category="Figures",
        ),
        pdf=results("figures/fig04_random_orbits.pdf"),
    log:
        log_of("figures/random_orbits"),
        times=benchmark_of("random_orbits_figure"),
    message:
        "Drawing the orbits chosen by random search"


use rule tpe_orbits_figure as exact_orbits_figure with:
    input:
        orbits=rules.families.output[0],
        targets=expand(results("targets/static_{scenario}.nc"), scenario=SCENARIOS),
        architectures=expand(results("architecture/{scenario}/exact.nc"), scenario=SCENARIOS),
    output:
        png=report(
            results("figures/fig09_exact_orbits.png"),
            caption="../report/figure_exact_orbits.rst",
            category="Figures",
        ),
        pdf=results("figures/fig09_exact_orbits.pdf"),
    log:
        log_of("figures/exact_orbits"),
        times=benchmark_of("exact_orbits_figure"),
    message:
        "Drawing the orbits of the best architectures known"


rule satellite_front_figure:
    input:
        fronts=expand(results("architecture/{scenario}/front.nc"), scenario=SCENARIOS),
        architectures=architecture_files("architecture/{scenario}/{optimizer}.nc"),
        coverage=rules.architecture_table.output.architecture,
    output:
        png=report(
            results("figures/fig10_satellite_front.png"),
            caption="../report/figure_satellite_front.rst",
            category="Figures",
        ),
        pdf=results("figures/fig10_satellite_front.pdf"),
    log:
        log_of("figures/satellite_front"),
        times=benchmark_of("satellite_front_figure"),
    conda:
        "../envs/cislunar.yaml"
    message:
        "Drawing J and coverage by number of satellites"
    script:
        "../scripts/figure_satellite_front.py"


rule objectives_figure:
    input:
        tables=expand(results("tables/objectives_{scenario}.csv"), scenario=JUDGED),
        tracking=[rules.tracking_tables.output.tracking] if CELLS else [],
    output:
        png=report(
            results("figures/objectives.png"),
            caption="../report/figure_objectives.rst",
            category="Figures",
        ),
        pdf=results("figures/objectives.pdf"),
    log:
        log_of("figures/objectives"),
        times=benchmark_of("objectives_figure"),
    conda:
        "../envs/cislunar.yaml"
    params:
        scenarios=JUDGED,
    message:
        "Drawing the fronts by objective"
    script:
        "../scripts/figure_objectives.py"


rule convergence_figure:
    input:
        runs=expand(
            results("architecture/{scenario}/runs/{method}_{labels}_{run}.nc"),
            scenario=SCENARIOS,
            method=RUN_METHODS,
            labels=ARCHITECTURE["labels"],
            run=RUNS,
        ),
        architectures=architecture_files("architecture/{scenario}/{optimizer}.nc"),
    output:
        png=report(
            results("figures/fig11_convergence.png"),
            caption="../report/figure_convergence.rst",
            category="Figures",
        ),
        pdf=results("figures/fig11_convergence.pdf"),
    log:
        log_of("figures/convergence"),
        times=benchmark_of("convergence_figure"),
    conda:
        "../envs/cislunar.yaml"
    message:
        "Drawing the convergence of the optimizers"
    script:
        "../scripts/figure_convergence.py"


rule family_map_figure:
    input:
        orbits=rules.families.output[0],
    output:
        png=report(
            results("figures/fig12_family_map.png"),
            caption="../report/figure_family_map.rst",
            category="Figures",
        ),
        pdf=results("figures/fig12_family_map.pdf"),
    log:
        log_of("figures/family_map"),
        times=benchmark_of("family_map_figure"),
    conda:
        "../envs/cislunar.yaml"
    params:
        figure="space.family_map_figure",
    message:
        "Drawing the map of the family members"
    script:
        "../scripts/figure.py"


rule orbits_page:
    input:
        orbits=rules.families.output[0],
        tracked=shared("orbits/tracked", SCENARIOS[0]),
        targets=expand(results("targets/static_{scenario}.nc"), scenario=SCENARIOS),
        architectures=architecture_files("architecture/{scenario}/{optimizer}.nc"),
    output:
        report(
            results("figures/orbits_3d.html"),
            caption="../report/figure_orbits_3d.rst",
            category="Figures",
        ),
    log:
        log_of("figures/orbits_page"),
        times=benchmark_of("orbits_page"),
    conda:
        "../envs/cislunar.yaml"
    params:
        scenarios=SCENARIOS,
    message:
        "Writing the interactive page of orbits"
    script:
        "../scripts/figure_orbits_page.py"


OF_CANDIDATES = [
    *rules.satellite_front_figure.output,
    *rules.convergence_figure.output,
    *rules.family_map_figure.output,
    *rules.orbits_page.output,
]


# Figures 1 to 8.
rule paper_figures:
    input:
        rules.facet_geometry_figure.output,
        rules.orbit_library_figure.output if OPTIMIZERS else [],
        rules.tpe_orbits_figure.output if "tpe" in OPTIMIZERS else [],
        rules.random_orbits_figure.output if "random" in OPTIMIZERS else [],
        rules.paper_tracking_figures.input,


rule figures:
    input:
        rules.paper_figures.input,
        OF_CANDIDATES if OPTIMIZERS else [],
        rules.exact_orbits_figure.output if "exact" in OPTIMIZERS else [],
        rules.objectives_figure.output if JUDGED else [],
        rules.tracking_figures.input,
