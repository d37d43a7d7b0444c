"""Refusal of faulty files of settings, before Snakemake reads them."""

import os

from cislunar.campaign.settings.reading import read_yaml
from cislunar.errors import CislunarError


def check_config_files(paths):
    """Refuse files that are no mapping or have a key twice: Snakemake names no file, and keeps one
    of two equal keys."""
    try:
        for path in filter(os.path.exists, paths):
            read_yaml(os.path.relpath(path), "a file of settings")
    except CislunarError as error:
        raise SystemExit(f"error: {error}\n(see config/README.md)") from None


if workflow.is_main_process:
    shipped = "config/config.yaml", "config/variants.yaml"
    check_config_files([*shipped, *workflow.overwrite_configfiles])
