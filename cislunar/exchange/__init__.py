"""Exchange formats: orbit ephemeris messages, catalog rows, tables, and inertial axes."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "arcs": ["COMMENTS", "arc", "rotating_arc"],
    "catalog": ["COLUMNS", "is_catalog", "read_catalog"],
    "csv_lines": ["listed", "read_lines"],
    "inertial": ["Epoch", "epoch_at", "inertial_covariances", "rotating_covariances",
        "rotating_states"],
    "oem": ["Segment", "oem_text", "read_oem", "state_at"],
    "state_tables": ["read_segments", "segments_csv"],
    "table_rows": ["Columns", "PERIOD", "POSITION", "Row", "VELOCITY", "check_closed",
        "check_state", "named_rows", "quantity_columns", "row_names", "row_numbers", "row_period",
        "row_position", "row_state"],
})
# fmt: on
