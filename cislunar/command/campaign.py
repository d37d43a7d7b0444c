"""The commands of the campaign: thin calls of Snakemake and of the modules that do the work."""

import io
import logging
import os
import subprocess
import sys
from contextlib import nullcontext, redirect_stdout
from importlib.util import find_spec
from pathlib import Path

import click

from cislunar.command.base import Command, Group, level
from cislunar.errors import ConfigurationError

DIRECTORY = click.option(
    "--directory",
    default=".",
    metavar="FOLDER",
    help="Folder of the repository, with Snakefile, workflow and config [default: here].",
)
CORES = click.option("--cores", type=click.IntRange(min=1), default=2, show_default=True)
CONFIGFILE = click.option(
    "--configfile",
    "configfiles",
    multiple=True,
    metavar="FILE",
    help="Settings that differ from config/config.yaml; seen from the folder.",
)
REST = click.argument("arguments", nargs=-1, type=click.UNPROCESSED, metavar="[-- SNAKEMAKE...]")


def campaign_folder(directory: str, configfiles: tuple[str, ...] = ()) -> Path:
    """The folder, if Snakemake can run in it.

    Raises
    ------
    ConfigurationError
        If there is no Snakefile, no such file of settings, or no Snakemake.
    """
    folder = Path(directory)
    if not (folder / "Snakefile").is_file():
        raise ConfigurationError(
            f"{folder / 'Snakefile'}: no such file; the campaign needs the folder of the "
            "repository, which no wheel brings: go there, or give --directory FOLDER"
        )
    for name in configfiles:
        if not (folder / name).is_file():
            raise ConfigurationError(f"--configfile {folder / name}: no such file")
    if find_spec("snakemake") is None:
        raise ConfigurationError(
            "Snakemake is not installed: pip install -r environment.txt in the repository"
        )
    return folder


def snakemake_command(*arguments: str) -> list[str]:
    """Command line of Snakemake, as talkative as this command."""
    said = {logging.WARNING: ["--quiet", "all"], logging.DEBUG: ["--verbose"]}.get(level(), [])
    # -P: packages come from where they are installed, as with the command `snakemake`.
    return [sys.executable, "-P", "-m", "snakemake", *arguments, *said]


def _configured(configfiles: tuple[str, ...]) -> list[str]:
    return ["--configfile", *configfiles] if configfiles else []


class SnakemakeCommand(Command):
    """A command that hands what stands after -- to Snakemake."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the options, and tell where those of Snakemake go."""
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            raise click.UsageError(
                f"No such option '{error.option_name}'; options of Snakemake follow --: "
                f"{ctx.command_path} -- {error.option_name}",
                ctx,
            ) from None


def _become(folder: Path, command: list[str]) -> None:
    """Go on as that command, which Ctrl-C and the exit code are then those of."""
    os.chdir(folder)
    sys.stdout.flush()
    sys.stderr.flush()
    os.execv(command[0], command)


@click.command(cls=SnakemakeCommand)
@DIRECTORY
@CORES
@CONFIGFILE
@REST
def run(
    directory: str, cores: int, configfiles: tuple[str, ...], arguments: tuple[str, ...]
) -> None:
    """Run the campaign, or of it the files and stages named.

    The same command goes on with a campaign that was interrupted. What stands after -- goes to
    Snakemake as it is.

    \b
    Examples:
      cislunar run
      cislunar run --configfile config/quick.yaml -- task1
      cislunar run -- --dry-run
      cislunar run --cores 4 -- results/figures/fig02_orbit_library.png
    """
    folder = campaign_folder(directory, configfiles)
    # Snakemake takes all words up to the next option for files of settings.
    command = snakemake_command(*_configured(configfiles), "--cores", str(cores))
    _become(folder, [*command, *(("--", *arguments) if _only_names(arguments) else arguments)])


def _only_names(arguments: tuple[str, ...]) -> bool:
    return bool(arguments) and not arguments[0].startswith("-")


@click.command(cls=SnakemakeCommand)
@DIRECTORY
@CORES
@CONFIGFILE
@REST
@click.pass_context
def resume(
    context: click.Context,
    directory: str,
    cores: int,
    configfiles: tuple[str, ...],
    arguments: tuple[str, ...],
) -> None:
    """Go on with a campaign whose Snakemake was killed.

    Takes away the locks that were left behind, then runs as `cislunar run`, which is enough after
    Ctrl-C. Not while another Snakemake runs in the folder: its locks would go, too.

    \b
    Example:
      cislunar resume --configfile config/quick.yaml
    """
    folder = campaign_folder(directory, configfiles)
    unlock = snakemake_command(*_configured(configfiles), "--cores", "1", "--unlock")
    if code := subprocess.run(unlock, cwd=folder, check=False).returncode:
        context.exit(code)
    context.invoke(
        run, directory=directory, cores=cores, configfiles=configfiles, arguments=arguments
    )


@click.command(cls=SnakemakeCommand)
@DIRECTORY
@CONFIGFILE
@click.option("--output", default="report.html", show_default=True, metavar="FILE")
@REST
def report(
    directory: str, configfiles: tuple[str, ...], output: str, arguments: tuple[str, ...]
) -> None:
    """Put figures and tables of a finished campaign in one file.

    \b
    Example:
      cislunar report --configfile config/quick.yaml --output quick.html
    """
    folder = campaign_folder(directory, configfiles)
    _become(
        folder,
        [
            *snakemake_command(*_configured(configfiles), "--report", str(Path(output).absolute())),
            *arguments,
        ],
    )


def _silenced() -> redirect_stdout | nullcontext:
    """What is printed is lost where only results and errors are wanted."""
    return redirect_stdout(io.StringIO()) if level() >= logging.WARNING else nullcontext()


@click.command(cls=Command)
@click.argument("folder", default="results")
@click.option("--delete", is_flag=True, help="Remove what is damaged.")
def verify(folder: str, delete: bool) -> int:
    """Name the results that are damaged.

    Reads every one to its end; the exit code is 1 if one cannot be used.

    \b
    Example:
      cislunar verify results/quick
    """
    from cislunar.campaign.operation import verify

    return verify.main([folder, *(["--delete"] if delete else [])])


@click.group(cls=Group)
def docs() -> None:
    """The documents of the repository.

    \b
    Examples:
      cislunar docs update
      cislunar docs site
    """


@docs.command()
@DIRECTORY
@click.option("--results", default="results", show_default=True, help="Results folder.")
@click.option("--check", is_flag=True, help="Change nothing; exit code 1 where one is outdated.")
def update(directory: str, results: str, check: bool) -> int:
    """Fill the documents with the numbers of a finished campaign.

    \b
    Example:
      cislunar docs update --check
    """
    from cislunar.campaign.documents import update

    folder = str(campaign_folder(directory))
    with _silenced():
        return update.main(
            ["--root", folder, "--results", results, *(["--check"] if check else [])]
        )


@docs.command()
@DIRECTORY
@click.option("--output", default="build/site", show_default=True, help="Folder to write to.")
def site(directory: str, output: str) -> None:
    """Make the site of documents, gallery and reference.

    It runs the gallery: a minute or two at first, then only what has changed. Open index.html in
    the folder.

    \b
    Example:
      cislunar docs site --output site
    """
    folder = campaign_folder(directory)
    if find_spec("sphinx_gallery") is None:
        raise ConfigurationError(
            "Sphinx is not installed: pip install -r environment.txt in the repository"
        )
    said = ["--quiet"] if level() >= logging.WARNING else []
    # -P: packages come from where they are installed, as with the command `sphinx-build`.
    command = [sys.executable, "-P", "-m", "sphinx", *said, "-c", "docs", "."]
    _become(folder, [*command, str(Path(output).absolute())])
