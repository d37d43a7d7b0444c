"""Visibility of static targets from satellites over time."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "counts": ["VisibilityCounts", "VisibilitySettings", "count_visibility", "observation_times"],
    "kernel": ["count_observations", "count_observers", "mark_observations"],
    "phasing": ["distinct_phases"],
    "shade": ["lost_observations", "shade_of"],
    "tracks": ["architecture_tracks", "satellite_tracks"],
})
# fmt: on
