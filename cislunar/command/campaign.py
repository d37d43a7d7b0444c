"""Commands of the campaign, which call Snakemake and the modules that do the work."""

import logging
import os
import subprocess
import sys
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
    help="Settings that override config/config.yaml; path relative to the folder.",
)
REST = click.argument("arguments", nargs=-1, type=click.UNPROCESSED, metavar="[-- SNAKEMAKE...]")


def campaign_folder(directory: str, configfiles: tuple[str, ...] = ()) -> Path:
    """The folder of the repository, in which Snakemake can run.

    Raises
    ------
    ConfigurationError
        If there is no Snakefile, a file of settings is missing, or Snakemake is not installed.
    InputFileError
        If a file of settings is no YAML, no mapping, or has a key twice.
    """
    folder = Path(directory)
    if not (folder / "Snakefile").is_file():
        raise ConfigurationError(
            f"{folder / 'Snakefile'}: no such file; the campaign needs the folder of the "
            "repository, which the wheel does not contain: go there, or give --directory FOLDER"
        )
    for name in configfiles:
        _require(folder / name, "--configfile", "file")
    if configfiles:
        from cislunar.campaign.settings import read_yaml

        # Snakemake reads them before the Snakefile, and its errors do not name the file
        for name in configfiles:
            read_yaml(folder / name, "a file of settings")
    if find_spec("snakemake") is None:
        raise ConfigurationError(
            "Snakemake is not installed: pip install -r environment.txt in the repository"
        )
    return folder


def _require(path: Path, option: str, kind: str) -> None:
    """Refuse a path that is no file or no folder, as `kind` says."""
    if not (path.is_file() if kind == "file" else path.is_dir()):
        reason = f"is not a {kind}" if path.exists() else f"no such {kind}"
        raise ConfigurationError(f"{option} {path}: {reason}")


def _later_configfiles(arguments: tuple[str, ...]) -> tuple[str, ...]:
    """Files of settings among the arguments for Snakemake, which reports a missing one by a
    traceback before it reads the Snakefile."""
    found, names = [], False
    for argument in arguments:
        option, _, value = argument.partition("=")
        if argument.startswith("-"):
            names = option in ("--configfile", "--configfiles")
            if names and value:
                found, names = [*found, value], False
        elif names:
            found.append(argument)
    return tuple(found)


def snakemake_command(*arguments: str) -> list[str]:
    """Command line of Snakemake, with the verbosity of this command."""
    verbosity = {logging.WARNING: ["--quiet", "all"], logging.DEBUG: ["--verbose"]}.get(level(), [])
    # -P: packages are imported from where they are installed, as by the command `snakemake`.
    return [sys.executable, "-P", "-m", "snakemake", *arguments, *verbosity]


def _configured(configfiles: tuple[str, ...]) -> list[str]:
    return ["--configfile", *configfiles] if configfiles else []


class SnakemakeCommand(Command):
    """A command that passes all arguments after -- to Snakemake."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the options; the error for an unknown one explains where Snakemake's options go."""
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            raise click.UsageError(
                f"No such option '{error.option_name}'; options of Snakemake follow --: "
                f"{ctx.command_path} -- {error.option_name}",
                ctx,
            ) from None


def _become(folder: Path, command: list[str]) -> None:
    """Replace this process by the command, which then receives Ctrl-C and sets the exit code."""
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
    """Run the campaign, or only the given files and stages.

    Without --configfile, this makes the figures, tables and claims of the paper; add
    `-- everything` for all results. With --configfile, it makes all that the files request, except
    surveys and comparisons of association and of maneuvers, which have targets of their own.

    The same command continues an interrupted campaign. Arguments after -- are passed to Snakemake
    unchanged.

    \b
    Examples:
      cislunar run
      cislunar run --configfile config/quick.yaml -- task1
      cislunar run -- --dry-run
      cislunar run --cores 4 -- results/figures/fig02_orbit_library.png
    """
    folder = campaign_folder(directory, (*configfiles, *_later_configfiles(arguments)))
    # Snakemake treats all words up to the next option as files of settings.
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
    """Continue a campaign whose Snakemake process was killed.

    The command removes the remaining locks and then works like `cislunar run`, which is sufficient
    after Ctrl-C. Do not use it while another Snakemake process runs in the folder, because it would
    remove its locks as well.

    \b
    Example:
      cislunar resume --configfile config/quick.yaml
    """
    folder = campaign_folder(directory, (*configfiles, *_later_configfiles(arguments)))
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
    """Collect figures and tables of a finished campaign in one file.

    \b
    Example:
      cislunar report --configfile config/quick.yaml --output quick.html
    """
    folder = campaign_folder(directory, (*configfiles, *_later_configfiles(arguments)))
    _become(
        folder,
        [
            *snakemake_command(*_configured(configfiles), "--report", str(Path(output).absolute())),
            *arguments,
        ],
    )


@click.command(cls=Command)
@click.argument("folder", default="results")
@click.option("--delete", is_flag=True, help="Delete damaged results that a rule has made.")
def verify(folder: str, delete: bool) -> int:
    """List damaged results.

    Every result is read to its end; the exit code is 1 if one cannot be used. With --delete, files
    are removed that Snakemake has recorded as made by a rule, and what killed jobs have left; other
    files are yours and stay.

    \b
    Example:
      cislunar verify results/quick
    """
    from cislunar.campaign import check_results

    return int(not check_results(folder, delete=delete))


@click.group(cls=Group)
def docs() -> None:
    """Documents of the repository.

    \b
    Examples:
      cislunar docs update
      cislunar docs site
    """


@docs.command()
@DIRECTORY
@click.option(
    "--results",
    default="results",
    show_default=True,
    metavar="FOLDER",
    help="Results folder; path relative to the folder of the repository.",
)
@click.option(
    "--check", is_flag=True, help="Change nothing; exit code 1 if a document is outdated."
)
def update(directory: str, results: str, check: bool) -> None:
    """Update the documents with the numbers of a finished campaign.

    \b
    Example:
      cislunar docs update --check
    """
    folder = campaign_folder(directory)
    if not check:
        _require(folder / results, "--results", "folder")
    chosen = ["--results", results, *(["--check"] if check else [])]
    _become(folder, [sys.executable, "-m", "workflow.documents.update", *chosen])


@docs.command()
@DIRECTORY
@click.option("--output", default="build/site", show_default=True, help="Folder to write to.")
def site(directory: str, output: str) -> None:
    """Build the site of documents, gallery and reference.

    The first build runs the gallery, which takes a minute or two; later builds update only what has
    changed. Open index.html in the folder.

    \b
    Example:
      cislunar docs site --output site
    """
    folder = campaign_folder(directory)
    if find_spec("sphinx_gallery") is None:
        raise ConfigurationError(
            "Sphinx is not installed: pip install -r environment.txt in the repository"
        )
    verbosity = ["--quiet"] if level() >= logging.WARNING else []
    # -P: packages are imported from where they are installed, as by the command `sphinx-build`.
    command = [sys.executable, "-P", "-m", "sphinx", *verbosity, "-c", "docs", "."]
    _become(folder, [*command, str(Path(output).absolute())])
