"""Studies of user-defined observers and targets, as the command `cislunar study` runs them."""

@cache
def inputs_of_study(name):
    """A study and the files it names; a fault is refused before a job removes earlier results."""
    from cislunar.study.settings import study_files

    path = f"config/studies/{name}.yaml"
    try:
        if workflow.is_main_process:
            # importing it takes seconds, and only a requested study needs it
            from cislunar.study.study_file import read_study

            read_study(path)
        return study_files(path)
    except CislunarError as error:
        raise SystemExit(f"error: {error}") from None


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
