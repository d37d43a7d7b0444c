"""What all commands share: how much they say, and that an error is one line and exit code 2."""

import logging
import sys
from typing import Any

import click

from cislunar.campaign.data.compilation import announced
from cislunar.campaign.data.progress import Progress, logger, on_terminal, progress_log
from cislunar.campaign.operation.kernels import drop_stale_kernels
from cislunar.errors import CislunarError

FAILED, INTERRUPTED = 2, 130
_LEVEL = "cislunar.level"
_INTERVAL_S = 5.0


def _level_option(names: list[str], level: int, text: str) -> click.Option:
    def note(context: click.Context, option: click.Parameter, given: bool) -> None:
        if given:
            context.meta[_LEVEL] = level

    return click.Option(names, is_flag=True, expose_value=False, callback=note, help=text)


class _Talking(click.Command):
    """A command with ``--quiet`` and ``--verbose``."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        settings.setdefault("context_settings", {})["help_option_names"] = ["-h", "--help"]
        super().__init__(*args, **settings)
        self.params += [
            _level_option(["-q", "--quiet"], logging.WARNING, "Say nothing but results, errors."),
            _level_option(["-v", "--verbose"], logging.DEBUG, "Every step, and where errors rise."),
        ]


class Command(_Talking):
    """A command whose progress goes to the terminal."""

    def invoke(self, context: click.Context) -> Any:
        """Run it."""
        drop_stale_kernels()
        with on_terminal(level()), announced():
            try:
                return super().invoke(context)
            except CislunarError:
                logger.debug("where the error rose:", exc_info=True)
                raise


class Group(_Talking, click.Group):
    """A command of commands; where an error ends the program, it does so in one line."""

    command_class = Command
    group_class = type

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Run it; returns the exit code if not `standalone_mode`."""
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
            code = _failed("out of memory; ask for fewer rows")
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
    """Level of `logging` that the running command was asked for."""
    return click.get_current_context().meta.get(_LEVEL, logging.INFO)


def progress(name: str) -> Progress:
    """Progress of long work: a line now and then, or for each step if verbose."""
    return progress_log(name, 0.0 if level() <= logging.DEBUG else _INTERVAL_S)
