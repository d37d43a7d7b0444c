"""What rules have in common whose result is made by one function of the library."""


# Without an output; the other rules add theirs, and `params.function`, to it.
rule result:
    log:
        log_of("result"),
    conda:
        "../envs/cislunar.yaml"
    script:
        "../scripts/result.py"
