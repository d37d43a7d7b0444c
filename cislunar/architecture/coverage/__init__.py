"""Coverage of static targets: measures, objectives, greedy and local search, certified bound."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "certificate": ["certify_coverage", "greedy_coverage"],
    "gap_objective": ["GapObjective", "certify_gaps"],
    "kernels": ["weighted_sums"],
    "measures": ["Coverage", "coverage", "day_starts", "gaps"],
    "objective": ["CoverageObjective"],
    "tables": ["CoverageTables", "coverage_tables"],
})
# fmt: on
