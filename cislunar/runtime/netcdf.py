"""Data sets in files that are complete or absent; every variable has a unit and a description."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cislunar.errors import ConfigurationError, InputFileError
from cislunar.runtime.settings_words import shown

_COMPRESSED_FROM = 1024
_CHUNK_BYTES = 2**21


def variable(dims, values, units: str, long_name: str, **attributes) -> xr.Variable:
    """A variable with its unit ("1" for none), description and further attributes."""
    return xr.Variable(dims, values, {"units": units, "long_name": long_name, **attributes})


def make_folder(folder: Path, place: str) -> None:
    """Make a folder, if it is missing, before its files are computed; `place` begins the message of
    the `InputFileError` if it cannot be made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputFileError(
            f"{place}: {error.strerror}; give a folder that can be written to"
        ) from error


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """A temporary name for a file that is moved into place once it is complete. Raises
    `InputFileError` if it cannot be written, and `ConfigurationError` if `path` is none."""
    try:
        path = Path(path)
        temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    except (TypeError, ValueError):
        raise ConfigurationError(f"path = {shown(path)}: give the path of a file") from None
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
            f"cannot write {path}: {reason}; check that {path.parent} is a folder that can be "
            "written to, and the disk not full"
        ) from error


class Later(NamedTuple):
    """A variable whose values are written piece by piece: dimensions, type and attributes."""

    dims: tuple[str, ...]
    dtype: str
    attributes: Mapping[str, Any]


def write_dataset(dataset: xr.Dataset, path: str | Path) -> None:
    """Write a data set to NetCDF-4 under a temporary name, then move it into place. The folder is
    created if missing. Raises ValueError if a variable lacks `units` or `long_name`, and
    `InputFileError` if the folder cannot be written to."""
    with whole_file(path) as temporary:
        _write(dataset, temporary, Path(path))


def _write(dataset: xr.Dataset, temporary: Path, path: Path) -> None:
    """Write the temporary file of `path`; ValueError if a variable lacks unit or description."""
    for name, data in dataset.variables.items():
        lacking = [key for key in ("units", "long_name") if key not in data.attrs]
        if lacking:
            raise ValueError(f"variable {name} of {path.name} lacks {' and '.join(lacking)}")
    encoding = {
        str(name): {"zlib": True, "complevel": 4, "shuffle": True}
        for name, data in dataset.variables.items()
        if data.size >= _COMPRESSED_FROM and np.issubdtype(data.dtype, np.number)
    }
    dataset.to_netcdf(temporary, format="NETCDF4", engine="netcdf4", encoding=encoding)


@contextmanager
def growing_dataset(
    dataset: xr.Dataset, path: str | Path, later: Mapping[str, Later], sizes: Mapping[str, int]
) -> Iterator[Mapping[str, Any]]:
    """Write a data set as `write_dataset` does, and variables whose values do not fit in memory.
    Yields, by name, objects that take values as an array does (``[...] = values``); the file is
    moved into place at the end. `sizes` has the lengths of dimensions that the data set lacks."""
    import netCDF4

    with whole_file(path) as temporary:
        _write(dataset, temporary, Path(path))
        with netCDF4.Dataset(temporary, "a") as opened:
            for name in {dim for each in later.values() for dim in each.dims}:
                if name not in opened.dimensions:
                    opened.createDimension(name, sizes[name])
            yield {name: _room_for(opened, name, each) for name, each in later.items()}
        with temporary.open("rb") as file:
            os.fsync(file.fileno())


def _room_for(opened: Any, name: str, each: Later) -> Any:
    """A variable without values in an open file, compressed in chunks of a few MB."""
    shape = [opened.dimensions[dim].size for dim in each.dims]
    dtype, compressed = np.dtype(each.dtype), {}
    if np.prod(shape) >= _COMPRESSED_FROM:
        # one index of the first axis, as it is written; as many of the second as fit
        first = [1] if len(shape) > 1 else []
        along, *rest = shape[len(first) :]
        fitting = _CHUNK_BYTES // int(dtype.itemsize * np.prod(rest))
        chunk = (*first, max(1, min(along, fitting)), *rest)
        compressed = {"zlib": True, "complevel": 4, "shuffle": True, "chunksizes": chunk}
    # the fill value that xarray writes
    missing = np.nan if dtype.kind == "f" else None
    made = opened.createVariable(name, dtype, each.dims, fill_value=missing, **compressed)
    made.set_auto_mask(False)
    made.setncatts(each.attributes)
    return made


def write_text(text: str, path: str | Path) -> None:
    """Write a text file, complete or not at all, creating its folder. Raises `InputFileError` if
    the folder cannot be written to."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def read_dataset(path: str | Path, *, without: Sequence[str] = ()) -> xr.Dataset:
    """Read a NetCDF-4 file into memory, except the variables `without`. Raises `InputFileError` if
    the file is missing, truncated or no NetCDF file."""
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
