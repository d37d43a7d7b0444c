"""Exchange formats: orbit, attitude and tracking data messages, observations of ADES, catalog rows,
tables, and inertial axes."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "ades": ["VERSIONS", "ades_text", "observer_codes", "read_ades"],
    "aem": ["AttitudeSegment", "BODY", "aem_text", "read_aem"],
    "arcs": ["COMMENTS", "EPHEMERIS_COMMENTS", "GEOMETRIC_DIRECTIONS", "arc", "inertial_arc",
        "rotating_arc"],
    "catalog": ["CATALOG_COLUMNS", "is_catalog", "read_catalog"],
    "inertial": ["Epoch", "epoch_at", "icrf_axes", "inertial_covariances",
        "rotating_covariances", "rotating_state_at", "rotating_states"],
    "key_values": ["CENTERS", "EARTH_MOON_CENTER", "FRAMES", "ORIGINS", "dates", "read_text"],
    "observation_files": ["observation_table"],
    "observations": ["OBJECT_NAMES", "POSITION_COLUMNS", "REQUIRED", "checked", "object_of",
        "observation_dates", "require"],
    "ocm": ["Maneuver", "ObjectRecord", "ocm_text", "read_ocm"],
    "oem": ["Segment", "objects_of", "oem_text", "read_oem", "state_at"],
    "state_tables": ["DATE_COLUMNS", "read_segments", "segments_csv"],
    "table_rows": ["Columns", "OWN_FAMILY", "PERIOD", "POSITION", "Row", "VELOCITY", "check_closed",
        "check_state", "listed", "named_rows", "quantity_columns", "read_lines", "read_number",
        "row_names", "row_numbers", "row_period", "row_position", "row_state"],
    "tdm": ["read_tdm", "tdm_text"],
})
# fmt: on
