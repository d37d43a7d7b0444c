"""Orbit determination from angles: tracklets, admissible regions, least squares, and linking."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "admissible_region": ["AdmissibleRegion", "implied_size", "is_admissible", "sample_region",
        "states_in_rotating_frame"],
    "angles": ["Angles", "OBSERVER_POSITION_COLUMNS", "angles_from_table", "exposure_numbers",
        "frame_rate", "make_angles", "tangent_basis"],
    "attribution": ["concatenate_fits", "tracklet_matches"],
    "common_time": ["OrbitStates", "by_radiation", "orbits_at", "propagated", "propagated_each",
        "same_states", "squared_distances"],
    "initial_orbits": ["InitialOrbitSettings", "InitialOrbits", "initial_orbits", "refit_at"],
    "least_squares": ["CONVERGED", "NOT_CONVERGED", "NOT_PROPAGATED", "OrbitFits", "SINGULAR",
        "fit_orbits"],
    "linking": ["LinkedOrbits", "link"],
    "pairs": ["PairSettings", "PairStarts", "pair_starts"],
    "scores": ["ConfirmationRule", "LinkingSettings", "log_scores"],
    "tracklets": ["Attributables", "TrackletSettings", "attributables", "form_tracklets"],
    "verdicts": ["CONTRADICTORY", "DIRECTION_ONLY", "NO_ORBIT", "ORBIT", "SEVERAL_ORBITS",
        "VerdictSettings", "agrees", "determined_by_one", "log_evidence",
        "separation_probability", "undetermined_directions"],
})
# fmt: on
