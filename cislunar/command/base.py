"""Common behavior of all commands: verbosity, and errors as one line with exit code 2."""

import logging
import sys
from typing import Any

import click

from cislunar.errors import CislunarError
from cislunar.runtime import announced, drop_stale_kernels
from cislunar.runtime.progress import Progress, logger, on_terminal, progress_log

FAILED, INTERRUPTED = 2, 130
_LEVEL = "cislunar.level"
_INTERVAL_S = 5.0


def _level_option(names: list[str], level: int, text: str) -> click.Option:
    def note(context: click.Context, option: click.Parameter, given: bool) -> None:
        if given:
            context.meta[_LEVEL] = level

    return click.Option(names, is_flag=True, expose_value=False, callback=note, help=text)


class _WithVerbosity(click.Command):
    """A command with ``--quiet`` and ``--verbose``."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        settings.setdefault("context_settings", {})["help_option_names"] = ["-h", "--help"]
        super().__init__(*args, **settings)
        self.params += [
            _level_option(["-q", "--quiet"], logging.WARNING, "Show only results and errors."),
            _level_option(["-v", "--verbose"], logging.DEBUG, "Show every step, and tracebacks."),
        ]


class Command(_WithVerbosity):
    """A command that shows its progress on the terminal."""

    def invoke(self, context: click.Context) -> Any:
        """Run the command."""
        drop_stale_kernels()
        with on_terminal(level()), announced():
            try:
                return super().invoke(context)
            except CislunarError:
                logger.debug("traceback of the error:", exc_info=True)
                raise


class Group(_WithVerbosity, click.Group):
    """A group of commands; an error ends the program with one line."""

    command_class = Command
    group_class = type

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Run the group; returns the exit code if not `standalone_mode`."""
        try:
            code = super().main(*args, standalone_mode=False, **extra)
        except click.exceptions.NoArgsIsHelpError as error:
            error.show()
            code = FAILED
        except click.UsageError as error:
            path = error.ctx.command_path if error.ctx else self.name
            code = _failed(f"{error.format_message().rstrip('.')} (see: {path} --help)")
        except (CislunarError, click.ClickException) as error:
            code = _failed(error.format_message() if hasattr(error, "show") else str(error))
        except MemoryError:
            code = _failed("out of memory; request fewer rows")
        except click.Abort:
            click.echo("interrupted", err=True)
            code = INTERRUPTED
        if standalone_mode:
            sys.exit(code)
        return code


def _failed(message: str) -> int:
    click.echo(f"error: {' '.join(message.split())}", err=True)
    return FAILED


def level() -> int:
    """Logging level requested for the running command."""
    return click.get_current_context().meta.get(_LEVEL, logging.INFO)


def progress(name: str) -> Progress:
    """Progress of long work: one line every few seconds, or one for each step if verbose."""
    return progress_log(name, 0.0 if level() <= logging.DEBUG else _INTERVAL_S)
