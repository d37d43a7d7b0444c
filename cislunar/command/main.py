"""The command `cislunar`."""

import click

import cislunar as package
from cislunar.command.base import Group
from cislunar.command.benchmark import benchmark
from cislunar.command.campaign import docs, report, resume, run, verify
from cislunar.command.export import export
from cislunar.command.orbits import orbits
from cislunar.command.propagate import propagate
from cislunar.command.see import see
from cislunar.command.study import study
from cislunar.runtime.worker_client import use_common_instructions


@click.group(cls=Group)
@click.version_option(package.__version__, prog_name="cislunar")
def cislunar() -> None:
    """Cislunar space domain awareness: orbits, visibility, and the campaign.

    \b
    Examples:
      cislunar orbits members Halo_L2_S --jacobi 3.05
      cislunar see --observer Halo_L2_S,period=6.5 --target Lyap_L2,period=15
      cislunar study my_study.yaml
      cislunar run --configfile config/quick.yaml
    """
    use_common_instructions()


_COMMANDS = orbits, propagate, see, study, benchmark, run, resume, verify, report, export, docs
for each in _COMMANDS:
    cislunar.add_command(each)
