"""Positions of Earth, Moon and Sun from SPICE kernels, sampled into tables; time scales."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "bodies": ["BODY_COLUMNS", "BodyTable", "GM_EARTH", "GM_MOON", "GM_SUN", "NODE_SPACING_S",
        "cubic", "hermite", "moon_axes", "read_table", "require_within", "tabulate_bodies"],
    "kernel": ["DEFAULT_KERNEL", "PACKAGED", "kernel_path"],
    "sampling": ["SunMoonEphemeris", "check_coverage", "interpolate_sun", "rotating_frame",
        "sample_ephemeris"],
    "time_scales": ["J2000_JD", "TIME_SYSTEMS", "clock_seconds", "clock_text", "clock_to_tdb",
        "julian_date", "tdb_after", "tdb_seconds", "tdb_since", "tdb_to_clock", "utc_to_tdb"],
})
# fmt: on
