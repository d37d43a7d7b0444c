"""Provenance of a data set: version, revision, settings, seed, units of the system."""

import json
import subprocess
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from cislunar import __version__
from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S


@cache
def git_revision() -> str | None:
    """Revision of the source tree, ``+`` with uncommitted changes; None outside a checkout."""
    here = Path(__file__).resolve().parent

    def git(*arguments: str) -> str | None:
        try:
            done = subprocess.run(
                ["git", "-C", str(here), *arguments],
                capture_output=True,
                text=True,
                check=True,
                timeout=10,
            )
        except (OSError, subprocess.SubprocessError):
            return None
        return done.stdout.strip()

    # An installed package may lie in an environment within a repository that is not its own.
    tracked = git("ls-files", "--error-unmatch", str(Path(__file__).resolve()))
    revision = git("rev-parse", "--short=12", "HEAD") if tracked else None
    if not revision:
        return None
    changed = git("status", "--porcelain", "--untracked-files=no", "--", str(here.parent))
    return revision + ("+" if changed else "")


def provenance(
    title: str, *, settings: Mapping[str, Any] | None = None, seed: int | None = None
) -> dict[str, Any]:
    """Global attributes of a data set; the same inputs give the same attributes. `settings` are the
    part of the configuration on which the data set depends."""
    attributes: dict[str, Any] = {
        "title": title,
        "source": f"cislunar {__version__}",
        "mu": MU,
        "length_unit_km": LENGTH_UNIT_KM,
        "time_unit_s": TIME_UNIT_S,
    }
    revision = git_revision()
    if revision is not None:
        attributes["git_revision"] = revision
    if settings is not None:
        attributes["settings"] = json.dumps(settings, sort_keys=True)
    if seed is not None:
        attributes["seed"] = seed
    return attributes
