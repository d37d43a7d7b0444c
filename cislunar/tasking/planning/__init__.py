"""Planning: information of pairs of observer and target, and the best tasking."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "assignment": ["EARLY_STOP", "IDLE", "MAX_EVALUATIONS", "METHODS", "assign",
        "total_information", "values_in_field"],
    "brightness": ["facet_margins", "sphere_margins"],
    "detection": ["LearnedDetection"],
    "detection_model": ["DetectionModel"],
    "information": ["TaskingModel", "pair_information"],
    "pending": ["PlannedObservations", "expected_update"],
    "preselection": ["assign_preselected", "preselects"],
    "schedule": ["detection_probabilities", "plan_schedule"],
    "schedule_model": ["ScheduleModel"],
})
# fmt: on
