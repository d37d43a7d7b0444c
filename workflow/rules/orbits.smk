rule families:
    output:
        results("orbits/families.nc"),
    log:
        log_of("orbits/families"),
    benchmark:
        benchmark_of("orbits/families")
    params:
        settings=settings("orbits"),
    message:
        "Generating the candidate observer orbits"
    script:
        "../scripts/families.py"
