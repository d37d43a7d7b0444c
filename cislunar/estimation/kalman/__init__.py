"""Recursive estimation: the paper's multiplicative unscented filter, and orbits by angles alone."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "attitude_dispersion": ["rotation_differences"],
    "filtered_orbits": ["corrected_orbits", "orbits_of", "with_orbits"],
    "gaussian_mixture": ["GaussianMixture", "no_mixture", "step_orbit"],
    "mukf": ["MultiplicativeUKF"],
    "mukf_kernels": ["predict", "update"],
    "splitting": ["make_split_work", "use_direction"],
    "translation_filter": ["ACCEPTED", "OUTSIDE_FIELD", "SIZE"],
    "workspace": ["FilterConstants", "covariance_of", "deviations", "filter_constants", "leave_out",
        "make_workspace", "with_new_tracks"],
})
# fmt: on
