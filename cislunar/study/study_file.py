"""Studies in YAML files: the arguments of `cislunar.Study`, and the files of results."""

from pathlib import Path

from cislunar.campaign.settings.reading import read_yaml
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.figures.style import save_figure
from cislunar.runtime.netcdf import write_dataset, write_text
from cislunar.runtime.progress import logger, shown
from cislunar.study.results import StudyResult
from cislunar.study.study import Study


def read_study(path: str | Path) -> Study:
    """Read a study from a YAML file.

    Parameters
    ----------
    path : str or Path
        The file: a mapping with ``observers``, ``targets`` and settings, as the arguments of
        `cislunar.Study`. Paths in it are relative to the working folder.

    Returns
    -------
    Study

    Raises
    ------
    ConfigurationError, InputFileError
        If `path` is not a path or the file cannot be read, or for the reasons of `cislunar.Study`.
    """
    given = read_yaml(path, "a study")
    wrong = [key for key in given if not isinstance(key, str)]
    if wrong:
        raise ConfigurationError(f"{path}: the key {wrong[0]!r} is no text; write it in quotes")
    for key in ("observers", "targets"):
        if key not in given:
            raise ConfigurationError(f"{path}: {key} is missing; name them with their orbits")
    try:
        return Study(**given)
    except (ConfigurationError, InputFileError) as error:
        lines = str(error).splitlines()
        raise type(error)("\n".join(f"{path}: {line}" for line in lines)) from error


def write_study(result: StudyResult, folder: str | Path) -> list[Path]:
    """Write the results of a study.

    Parameters
    ----------
    result : StudyResult
    folder : str or Path
        Folder of the files, created if missing: ``study.nc`` (the data set of a cell),
        ``summary.csv``, ``estimates.oem``, ``estimates.csv``, ``observations.tdm`` (none, with a
        warning, if nothing was measured), figures, and ``ephemeris/sun.nc`` (epoch and axes), with
        which ``cislunar export`` makes other formats.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    InputFileError
        If a file cannot be written.
    """
    names = ("study.nc", "summary.csv", "estimates.oem", "estimates.csv", "observations.tdm")
    paths = [Path(folder, name) for name in (*names, "ephemeris/sun.nc")]
    write_dataset(result.cell, paths[0])
    write_dataset(result.sun, paths[-1])
    write_text(result.summary().to_csv(lineterminator="\n"), paths[1])
    result.to_oem(paths[2])
    result.to_csv(paths[3])
    if result.study.observations is None and result.observations().empty:
        empty = paths.pop(4)
        empty.unlink(missing_ok=True)  # that of an earlier run
        with shown():
            logger.warning("warning: %s is not written: nothing was measured", empty)
    else:
        result.to_tdm(paths[4])
    for kind in result.plots:
        both = [Path(folder, f"{kind}.{ending}") for ending in ("png", "pdf")]
        save_figure(result.plot(kind), *both)
        paths += both
    return paths
