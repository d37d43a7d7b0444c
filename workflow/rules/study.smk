"""Studies of user-defined observers and targets, as the command `cislunar study` runs them."""


rule study:
    input:
        lambda wildcards: inputs_of_study(wildcards.study),
    output:
        cell=results("studies/{study}/study.nc"),
        summary=results("studies/{study}/summary.csv"),
        states=results("studies/{study}/estimates.oem"),
    log:
        log_of("studies/{study}"),
        times=benchmark_of("study/{study}"),
    conda:
        "../envs/cislunar.yaml"
    resources:
        mem_mb=2000,
    message:
        "Study {wildcards.study}"
    script:
        "../scripts/study.py"
