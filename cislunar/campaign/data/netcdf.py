"""Reading and writing data sets: whole or not at all, every variable described."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import xarray as xr

from cislunar.errors import InputFileError

_COMPRESSED_FROM = 1024


def variable(dims, values, units: str, long_name: str, **attributes) -> xr.Variable:
    """A variable with its unit ("1" if there is none), description and further attributes."""
    return xr.Variable(dims, values, {"units": units, "long_name": long_name, **attributes})


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A temporary name for a file that moves into place once it is written to its end."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield temporary
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)
    # The NetCDF library reports a full disk as a RuntimeError.
    except (OSError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputFileError(
            f"cannot write {path}: {reason}; check that the results folder is writable and the "
            "disk not full"
        ) from error


def write_dataset(dataset: xr.Dataset, path: str | Path) -> None:
    """Write a data set to NetCDF-4 under a temporary name, then move it into place.

    A `ValueError` if a variable lacks `units` or `long_name`, an `InputFileError` if the folder,
    created where missing, cannot be written to.
    """
    path = Path(path)
    for name, data in dataset.variables.items():
        lacking = [key for key in ("units", "long_name") if key not in data.attrs]
        if lacking:
            raise ValueError(f"variable {name} of {path.name} lacks {' and '.join(lacking)}")
    encoding = {
        str(name): {"zlib": True, "complevel": 4, "shuffle": True}
        for name, data in dataset.variables.items()
        if data.size >= _COMPRESSED_FROM and np.issubdtype(data.dtype, np.number)
    }
    with whole_file(path) as temporary:
        dataset.to_netcdf(temporary, format="NETCDF4", engine="netcdf4", encoding=encoding)


def write_text(text: str, path: str | Path) -> None:
    """Write a text file whole or not at all, creating its folder.

    An `InputFileError` if the folder cannot be written to.
    """
    with whole_file(Path(path)) as temporary:
        temporary.write_text(text, encoding="utf-8")


def read_dataset(path: str | Path, *, without: Sequence[str] = ()) -> xr.Dataset:
    """Read a NetCDF-4 file into memory, `without` some variables.

    An `InputFileError` if the file is missing, truncated or no NetCDF file.
    """
    path = Path(path)
    if not path.is_file():
        raise InputFileError(f"data set {path}: no such file; let snakemake make it")
    try:
        with xr.open_dataset(path, engine="netcdf4", drop_variables=list(without)) as opened:
            return opened.load()
    except (OSError, RuntimeError, ValueError) as error:
        raise InputFileError(
            f"data set {path} cannot be read ({error}): it is damaged or no NetCDF file; delete it "
            "and run snakemake again"
        ) from error
