"""Surveys of a campaign: a realization from configuration and data sets, and their table."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "records": ["ORBIT_STATUSES", "SurveyRecorder"],
    "realization": ["realization_rows", "survey_realization"],
    "table": ["CATALOG_COLUMNS", "QUANTITIES", "catalog_rows"],
})
# fmt: on
