PAPER_TARGETS = 2000
LIBRARY_SCENARIO = min(
    SCENARIOS,
    key=lambda name: abs(config["scenarios"][name].get("targets", 0) - PAPER_TARGETS),
)
SEARCH_RUNS = {
    "scenario": SCENARIOS,
    "method": [method for method in OPTIMIZERS if method in SEARCHES],
    "labels": ARCHITECTURE["labels"],
    "run": RUNS,
}


use rule result as facet_geometry_figure with:
    output:
        **figure_files("fig01_facet_geometry", "facet_geometry"),
    log:
        log_of("figures/facet_geometry"),
        times=benchmark_of("facet_geometry_figure"),
    params:
        function="figures.space.facet_geometry_figure",
    message:
        "Drawing the reflection geometry of a facet"


use rule facet_geometry_figure as orbit_library_figure with:
    input:
        orbits=rules.families.output[0],
        targets=results(f"targets/static_{LIBRARY_SCENARIO}.nc"),
    output:
        **figure_files("fig02_orbit_library", "orbit_library"),
    log:
        log_of("figures/orbit_library"),
        times=benchmark_of("orbit_library_figure"),
    params:
        function="figures.space.orbit_library_figure",
    message:
        "Drawing the orbit library with its targets"


use rule facet_geometry_figure as tpe_orbits_figure with:
    input:
        orbits=rules.families.output[0],
        targets=expand(results("targets/static_{scenario}.nc"), scenario=SCENARIOS),
        architectures=expand(results("architecture/{scenario}/tpe.nc"), scenario=SCENARIOS),
    output:
        **figure_files("fig03_tpe_orbits", "tpe_orbits"),
    log:
        log_of("figures/tpe_orbits"),
        times=benchmark_of("tpe_orbits_figure"),
    params:
        function="figures.space.selected_orbits_figure",
        labeled={"architectures": SCENARIOS, "targets": SCENARIOS},
    message:
        "Drawing the orbits chosen by TPE"


use rule tpe_orbits_figure as random_orbits_figure with:
    input:
        orbits=rules.families.output[0],
        targets=expand(results("targets/static_{scenario}.nc"), scenario=SCENARIOS),
        architectures=expand(results("architecture/{scenario}/random.nc"), scenario=SCENARIOS),
    output:
        **figure_files("fig04_random_orbits", "random_orbits"),
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
        **figure_files("fig09_exact_orbits", "exact_orbits"),
    log:
        log_of("figures/exact_orbits"),
        times=benchmark_of("exact_orbits_figure"),
    message:
        "Drawing the orbits of the best architectures known"


use rule facet_geometry_figure as satellite_front_figure with:
    input:
        fronts=expand(results("architecture/{scenario}/front.nc"), scenario=SCENARIOS),
        architectures=ARCHITECTURE_FILES,
        coverage=rules.architecture_table.output.architecture,
    output:
        **figure_files("fig10_satellite_front", "satellite_front"),
    log:
        log_of("figures/satellite_front"),
        times=benchmark_of("satellite_front_figure"),
    params:
        function="figures.search.satellite_front_figure",
        labeled={"fronts": SCENARIOS, "architectures": ARCHITECTURES},
    message:
        "Drawing J and coverage by number of satellites"


use rule facet_geometry_figure as objectives_figure with:
    input:
        **({"tracking": rules.tracking_tables.output.tracking} if CELLS else {}),
        tables=expand(results("tables/objectives_{scenario}.csv"), scenario=JUDGED),
    output:
        **figure_files("objectives", "objectives"),
    log:
        log_of("figures/objectives"),
        times=benchmark_of("objectives_figure"),
    params:
        function="figures.search.objectives_figure",
        labeled={"tables": JUDGED},
    message:
        "Drawing the fronts by objective"


use rule facet_geometry_figure as convergence_figure with:
    input:
        runs=expand(
            results("architecture/{scenario}/runs/{method}_{labels}_{run}.nc"), **SEARCH_RUNS
        ),
        architectures=ARCHITECTURE_FILES,
    output:
        **figure_files("fig11_convergence", "convergence"),
    log:
        log_of("figures/convergence"),
        times=benchmark_of("convergence_figure"),
    params:
        function="figures.search.convergence_figure",
        labeled={
            "runs": [
                tuple(name.split("/"))
                for name in expand("{scenario}/{method}/{labels}_{run}", **SEARCH_RUNS)
            ],
            "architectures": ARCHITECTURES,
        },
    message:
        "Drawing the convergence of the optimizers"


use rule facet_geometry_figure as family_map_figure with:
    input:
        orbits=rules.families.output[0],
    output:
        **figure_files("fig12_family_map", "family_map"),
    log:
        log_of("figures/family_map"),
        times=benchmark_of("family_map_figure"),
    params:
        function="figures.space.family_map_figure",
    message:
        "Drawing the map of the family members"


use rule facet_geometry_figure as orbits_page with:
    input:
        orbits=rules.families.output[0],
        tracked=shared("orbits/tracked", SCENARIOS[0]),
        targets=expand(results("targets/static_{scenario}.nc"), scenario=SCENARIOS),
        architectures=ARCHITECTURE_FILES,
    output:
        report(
            results("figures/orbits_3d.html"),
            caption="../report/figure_orbits_3d.rst",
            category="Figures",
        ),
    log:
        log_of("figures/orbits_page"),
        times=benchmark_of("orbits_page"),
    params:
        function="figures.space.orbits_page.orbits_page",
        labeled={"targets": SCENARIOS, "architectures": ARCHITECTURES},
    message:
        "Writing the interactive page of orbits"


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
