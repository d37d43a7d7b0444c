"""``cislunar benchmark``: a benchmark with sealed truth, from detections to a catalog."""

import click

from cislunar.command.base import Group, progress


@click.group(cls=Group)
def benchmark() -> None:
    """Catalogs from detections, scored against a sealed truth.

    \b
    Examples:
      cislunar benchmark make small
      cislunar benchmark reference small --method survey-catalog --output mine
      cislunar benchmark score mine --truth small
    """


@benchmark.command()
@click.argument("folder", metavar="DIR")
@click.option(
    "--size",
    type=click.Choice(["small", "medium", "large"]),
    default="small",
    show_default=True,
    help="20 objects for 12 hours, 202 for a day, or 1000 for a week.",
)
@click.option("--seed", type=click.IntRange(min=0), help="Of the truth; a fixed seed if omitted.")
def make(folder: str, size: str, seed: int | None) -> None:
    """Make a benchmark in a new folder DIR.

    The folder has the exposures, the detections, the observers and what is known, and the sealed
    truth in its folder truth.

    \b
    Example:
      cislunar benchmark make small --size small
    """
    from cislunar.benchmark import make_benchmark

    given = {} if seed is None else {"seed": seed}
    scenario = make_benchmark(folder, size, **given, progress=progress("blocks of the survey"))
    click.echo(f"benchmark {scenario.size}: {len(scenario.observers)} observers, {folder}")


@benchmark.command()
@click.argument("folder", metavar="DIR")
@click.option(
    "--method",
    type=click.Choice(["survey-catalog", "nearest-neighbor"]),
    default="survey-catalog",
    show_default=True,
    help="Catalog of a survey of this library, or the simple baseline.",
)
@click.option("--output", required=True, metavar="FOLDER", help="Folder of the submission.")
def reference(folder: str, method: str, output: str) -> None:
    """Make a reference catalog from the public files of a benchmark.

    \b
    Example:
      cislunar benchmark reference small --method nearest-neighbor --output simple
    """
    from cislunar.benchmark import write_reference

    write_reference(folder, output, method, progress=progress("scoring epochs"))
    click.echo(f"submission in {output}")


@benchmark.command()
@click.argument("submission")
@click.option("--truth", required=True, metavar="DIR", help="Folder of the benchmark.")
@click.option("--output", metavar="FOLDER", help="Folder for score.csv, score.png and score.pdf.")
def score(submission: str, truth: str, output: str | None) -> None:
    """Score a SUBMISSION, a file or a folder, against the sealed truth.

    The table has a column for each scoring epoch.

    \b
    Example:
      cislunar benchmark score mine --truth small --output mine-score
    """
    from pathlib import Path

    from cislunar.benchmark import score_submission

    table = score_submission(submission, truth, progress=progress("scoring epochs"))
    click.echo(table.set_index("epoch_utc").T.map("{:.4g}".format).to_string())
    if output is not None:
        from cislunar.figures import score_figure
        from cislunar.figures.style import save_figure
        from cislunar.runtime.netcdf import write_text

        folder = Path(output)
        write_text(table.to_csv(index=False), folder / "score.csv")
        save_figure(score_figure(table), folder / "score.png", folder / "score.pdf")
        click.echo(f"score.csv, score.png and score.pdf in {folder}")
