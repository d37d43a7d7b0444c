"""Orbit determination from angles: tracklets, admissible regions, least squares, and linking."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "admissible_region": ["AdmissibleRegion", "OrbitBank", "implied_size", "is_admissible",
        "is_bright_as_allowed", "ranges_of", "states_in_rotating_frame", "sample_region",
        "sphere_offsets", "states_at"],
    "angles": ["Angles", "POSITION_COLUMNS", "angles_from_table", "frame_rate", "make_angles",
        "tangent_basis"],
    "attributables": ["Attributables", "TrackletSettings", "attributables", "turned_about_z"],
    "confirmation": ["ConfirmationRule"],
    "growth": ["Grown", "concatenate_fits", "grow", "tracklet_matches"],
    "initial_orbits": ["InitialOrbitSettings", "InitialOrbits", "fits_at", "initial_orbits"],
    "least_squares": ["CONVERGED", "NOT_CONVERGED", "NOT_PROPAGATED", "OrbitFits", "SINGULAR",
        "fit_orbits"],
    "linking": ["LinkedOrbits", "link"],
    "pairs": ["PairSettings", "PairStarts", "pair_starts", "pairs_within"],
    "scores": ["LinkingSettings", "log_scores"],
    "tracklets": ["form_tracklets"],
    "verdicts": ["CONTRADICTORY", "DIRECTION_ONLY", "NO_ORBIT", "ORBIT", "SEVERAL_ORBITS",
        "VerdictSettings", "agrees", "log_evidence", "open_directions", "region_covariance"],
})
# fmt: on
