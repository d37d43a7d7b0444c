"""Errors of the positions, the pointing and the clocks of observers, and estimators that consider
or calibrate them."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "errors": ["ERROR_UNITS", "N_PARAMETERS", "OBSERVER_PARAMETERS", "ObserverErrorSigma",
        "ObserverErrors", "ObserverEstimate", "TREATMENTS"],
    "factory": ["navigated"],
    "navigated_estimator": ["NavigatedEstimator"],
    "rates": ["frame_rotation", "observer_velocities"],
    "table": ["errors_of_observers", "load_observer_errors"],
})
# fmt: on
