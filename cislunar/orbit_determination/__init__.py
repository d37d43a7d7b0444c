"""Orbit determination from angles: tracklets, admissible regions, least squares, and linking."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "admissible_region": ["AdmissibleRegion", "RegionSamples", "implied_size", "is_admissible",
        "is_brightness_admissible", "range_grid", "sample_region", "sphere_magnitude_residuals",
        "states_at_ranges", "states_in_rotating_frame"],
    "angles": ["Angles", "POSITION_COLUMNS", "angles_from_table", "frame_rate", "make_angles",
        "tangent_basis"],
    "attribution": ["OrbitHypotheses", "concatenate_fits", "extend_orbits", "tracklet_matches"],
    "initial_orbits": ["InitialOrbitSettings", "InitialOrbits", "initial_orbits", "refit_at"],
    "least_squares": ["CONVERGED", "NOT_CONVERGED", "NOT_PROPAGATED", "OrbitFits", "SINGULAR",
        "fit_orbits"],
    "linking": ["LinkedOrbits", "link"],
    "pairs": ["PairSettings", "PairStarts", "pair_starts", "pairs_within"],
    "scores": ["ConfirmationRule", "LinkingSettings", "log_scores"],
    "tracklets": ["Attributables", "TrackletSettings", "attributables", "form_tracklets",
        "rotate_about_z"],
    "verdicts": ["CONTRADICTORY", "DIRECTION_ONLY", "NO_ORBIT", "ORBIT", "SEVERAL_ORBITS",
        "VerdictSettings", "agrees", "log_evidence", "region_covariance",
        "separation_probability", "undetermined_directions"],
})
# fmt: on
