"""Benchmark with sealed truth, from detections without identity to a catalog of orbits."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "baseline": ["NearestNeighborCatalog"],
    "files": ["BenchmarkScenario", "PublicData", "read_public_data", "read_scenario",
        "read_truth"],
    "make": ["BenchmarkSize", "SIZES", "make_benchmark"],
    "reference": ["REFERENCE_METHODS", "write_reference"],
    "score": ["SCORE_COLUMNS", "count_passes", "score_submission"],
    "submission": ["Submission", "read_submission"],
})
# fmt: on
