"""Tasking of observers to targets in a closed loop with estimation."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "closed_loop": ["ClosedLoop", "run_closed_loop"],
    "decision": ["decide"],
    "demonstration": ["TrackingProblem", "tracking_problem"],
    "detection_outcomes": ["OBSERVATION_OUTCOMES", "SettingNames", "count_outcomes",
        "outcome_shares", "report_estimated_parameters", "report_outcomes"],
    "histories": ["HISTORIES", "MANEUVER_VARIABLES", "OBSERVATION_COLUMNS", "RECOVERED_VARIABLES",
        "kept_histories", "log_variables"],
    "initial_conditions": ["ESTIMATOR", "INITIAL_RATE_DEG_H", "epoch_states",
        "initial_estimate", "monitored_targets", "stream"],
    "observer_truth": ["ObserverTruth", "draw_observer_errors"],
    "realization": ["OUTCOME_NAMES", "USED"],
    "recording": ["Piece", "collect", "fill"],
    "settings": ["LoopSettings", "RECORDABLE"],
    "state": ["SimulationInputs"],
    "truth": ["TrueMotion", "TruthModel"],
})
# fmt: on
