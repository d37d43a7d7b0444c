use rule result as ephemeris with:
    output:
        results("ephemeris/sun.nc"),
    log:
        log_of("ephemeris/sun"),
        times=benchmark_of("ephemeris"),
    params:
        function="campaign.data.sun_dataset",
        settings=settings("epoch_jd", "ephemeris", "visibility"),
    message:
        "Sampling the Sun and the rotating frame from the ephemeris"


use rule ephemeris as ephemeris_of_scenario with:
    output:
        results("ephemeris/sun_{scenario}.nc"),
    log:
        log_of("ephemeris/sun_{scenario}"),
        times=benchmark_of("ephemeris_of_scenario/{scenario}"),
    params:
        settings=settings_of("epoch_jd", "ephemeris", "visibility"),
    message:
        "Sampling the Sun and the rotating frame from the ephemeris (scenario {wildcards.scenario})"


use rule result as bodies with:
    output:
        results("ephemeris/bodies.nc"),
    log:
        log_of("ephemeris/bodies"),
        times=benchmark_of("bodies"),
    params:
        function="campaign.data.bodies_dataset",
        settings=settings("epoch_jd", "ephemeris", "visibility"),
    message:
        "Sampling Earth, Moon and Sun from the ephemeris"


use rule bodies as bodies_of_scenario with:
    output:
        results("ephemeris/bodies_{scenario}.nc"),
    log:
        log_of("ephemeris/bodies_{scenario}"),
        times=benchmark_of("bodies_of_scenario/{scenario}"),
    params:
        settings=settings_of("epoch_jd", "ephemeris", "visibility"),
    message:
        "Sampling Earth, Moon and Sun from the ephemeris (scenario {wildcards.scenario})"
