"""Services that every stage shares: progress, compilation, jobs, data-set files, provenance."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "arguments": ["Array", "Flags", "Indices", "UNIT_NORM", "array_of", "count_of",
        "indices_of", "number_of", "number_or_range", "require_choice", "require_kind",
        "require_path", "require_unit", "vectors_of"],
    "compilation": ["announced"],
    "kernels": ["KernelSet", "compile_kernels", "drop_stale_kernels"],
    "netcdf": ["Later", "growing_dataset", "make_folder", "read_dataset", "variable", "whole_file",
        "write_dataset", "write_text"],
    "progress": ["Progress", "counted", "each", "logger", "on_terminal", "progress_log"],
    "seeds": ["generator"],
    "settings_fields": ["Angle", "Count", "Flag", "MOST_STEPS", "NotNegative", "Number", "Partial",
        "Positive", "Section", "Text", "Three", "ThreePositive", "is_multiple", "number", "partial",
        "require_multiple", "setting", "several", "shortened_interval", "whole"],
    "settings_words": ["allowed", "faults", "inner", "pattern", "schema_of", "shown", "types",
        "unreadable"],
    "threads": ["allow_threads", "share_out", "single_threaded_algebra"],
    "worker_client": ["in_worker", "offer_worker", "use_common_instructions"],
})
# fmt: on
