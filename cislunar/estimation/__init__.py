"""Orbit and attitude estimation: the interface of an estimator and common parts."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "dispersed_orbits": ["TRANSLATION_SIZE", "carry_points", "dispersed_points"],
    "eclipses": ["expected_dimming", "without_dimming"],
    "estimator": ["Abilities", "CHOLESKY_FAILURES", "Estimates", "Estimator", "EstimatorFactory",
        "FLOOR_HITS", "InitialEstimate", "OUT_OF_FIELD", "OrbitEstimates", "Prediction", "Rotation",
        "UPDATES", "abilities_of"],
    "expected": ["expected_directions", "expected_measurements"],
    "initial_sigma": ["InitialSigma", "PAPER_INITIAL_SIGMA", "ProcessNoise"],
    "names": ["ESTIMATORS"],
    "registry": ["estimator_named"],
    "track_arrays": ["covariance_roots"],
    "triangular": ["cholesky", "solve_lower", "solve_transposed"],
    "unscented": ["UNSCENTED_WEIGHTS", "UnscentedWeights", "difference_moments", "information_gain",
        "innovation_moments", "sigma_points", "square_root_update"],
})
# fmt: on
