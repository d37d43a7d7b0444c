"""Exchange formats: orbit, attitude and tracking data messages, observations of ADES, catalog rows,
tables, and inertial axes."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "ades": ["VERSIONS", "ades_text", "read_ades"],
    "aem": ["AttitudeSegment", "BODY", "aem_text", "read_aem"],
    "arcs": ["COMMENTS", "EPHEMERIS_COMMENTS", "arc", "inertial_arc", "rotating_arc"],
    "catalog": ["COLUMNS", "is_catalog", "read_catalog"],
    "csv_lines": ["listed", "read_lines"],
    "inertial": ["CENTERS", "Epoch", "epoch_at", "icrf_axes", "inertial_covariances",
        "rotating_covariances", "rotating_states"],
    "key_values": ["FRAMES"],
    "observations": ["OBJECT_NAMES", "POSITION_COLUMNS", "RANGES", "REQUIRED", "numbers_within",
        "observation_dates", "observation_times", "require"],
    "ocm": ["Maneuver", "ObjectRecord", "ocm_text", "read_ocm"],
    "oem": ["Segment", "oem_text", "read_oem", "state_at"],
    "state_tables": ["read_segments", "segments_csv"],
    "table_rows": ["Columns", "PERIOD", "POSITION", "Row", "VELOCITY", "check_closed",
        "check_state", "named_rows", "quantity_columns", "row_names", "row_numbers", "row_period",
        "row_position", "row_state"],
    "tdm": ["read_tdm", "tdm_text"],
})
# fmt: on
