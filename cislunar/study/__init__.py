"""Studies of user-defined observers and targets, in Python, by the command and by the workflow."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "estimation": ["ObservedResult", "estimate"],
    "messages": ["CREATED", "cell_messages", "check_seed"],
    "observed": ["Observed", "read_observations", "reduce_interval"],
    "orbit_text": ["FORM", "Orbit", "member_of", "members_of", "read_orbit"],
    "objects": ["StudyObject", "read_objects"],
    "placement": ["place_objects"],
    "results": ["StudyResult"],
    "settings": ["StudySettings", "study_files", "study_settings"],
    "study": ["Study"],
    "study_file": ["read_study", "write_study"],
})
# fmt: on
