"""Copies of the workflow, Snakemake run in them; configurations read and changed."""

import copy
import shutil
import subprocess
import sys
from pathlib import Path

import yaml

from cislunar.campaign.settings.reading import checked, merged, with_types

ROOT = Path(__file__).resolve().parents[1]
QUICK = ("--configfile", "config/quick.yaml")


def run(*command, cwd=ROOT):
    """Run a module of this Python; returns the text of both streams and the exit code."""
    done = subprocess.run(
        [sys.executable, "-m", *map(str, command)],
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    return done.stdout, done.returncode


def snakemake(folder, *arguments):
    """Run Snakemake in a copy of the workflow."""
    return run("snakemake", *arguments, cwd=folder)


def copy_workflow(folder):
    """Copy the files that Snakemake needs besides the installed package."""
    shutil.copy(ROOT / "Snakefile", folder)
    for name in ("workflow", "config"):
        shutil.copytree(ROOT / name, folder / name)
    return folder


def read_campaign(*more):
    """The checked configuration, changed by more files, as by ``--configfile``."""
    config = {}
    for name in ("config.yaml", "variants.yaml", *more):
        config = merged(config, read_settings(name))
    return checked(with_types(config))


def with_change(config, key, value):
    """The configuration with one key, given by its path, set to a value."""
    changed = copy.deepcopy(config)
    *path, last = key.split(".")
    inner = changed
    for part in path:
        inner = inner[part]
    inner[last] = value
    return changed


def read_settings(name):
    """The content of a file of ``config``."""
    return yaml.safe_load((ROOT / "config" / name).read_text(encoding="utf-8"))
