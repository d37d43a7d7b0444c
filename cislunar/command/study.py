"""``cislunar study``: user-defined observers and targets from a YAML file."""

import click

from cislunar.command.base import Command


@click.command(cls=Command)
@click.argument("file", type=click.Path(dir_okay=False))
@click.option(
    "--output",
    metavar="FOLDER",
    help="Folder of the results; by default that of the file's name without its ending.",
)
@click.option(
    "--seeds",
    type=click.IntRange(1, 10_000),
    help="Number of realizations, as in the file if omitted.",
)
@click.option("--check", is_flag=True, help="Check the file, and run nothing.")
def study(file: str, output: str | None, seeds: int | None, check: bool) -> None:
    """Track your own targets with your own observers.

    FILE is a study in YAML: `observers` and `targets` with names and orbits, `epoch`, and settings
    that differ from the defaults. The results are a data set, a summary, an OEM, a table of
    states, a TDM of the measurements, and figures.

    \b
    Example of a file:
      epoch: 2027-03-01
      observers: {eye: "Halo_L2_S,period=6.56", gate: "Halo_L1_N,period=9.5"}
      targets: {relay: "Lyap_L2,period=15", others: {family: Halo_L2_S, count: 5}}
      sensor: {limiting_magnitude: 19}
      duration_hours: 12

    \b
    Example:
      cislunar study file.yaml --output results/file
    """
    from pathlib import Path

    from cislunar.runtime.netcdf import make_folder
    from cislunar.study.study_file import read_study, write_study

    chosen = read_study(file)
    click.echo(repr(chosen).strip("<>"))
    if check:
        return
    folder = Path(output) if output else Path(file).with_suffix("")
    make_folder(folder, f"--output {folder}")
    result = chosen.run(seeds)
    paths = write_study(result, folder)
    click.echo(result.summary().round(3).to_string())
    click.echo(f"{len(paths)} files in {folder}")
