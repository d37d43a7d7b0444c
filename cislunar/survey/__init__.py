"""Survey for undetected objects: their density, plans of fields, and catalogs from nothing."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "catalog": ["Predictions", "SurveyCatalog"],
    "characterization": ["CharacterizedOrbit", "characterize_orbits", "light_curve"],
    "density": ["ObjectDensity"],
    "fields": ["FieldGrid", "Views", "detection_probability", "views"],
    "hand_over": ["HandOver", "hand_over", "uniform_attitude_sigma"],
    "planning": ["SearchPlanner", "Visits"],
    "priors": ["PriorSources", "in_propagation_frame", "sample_prior"],
    "quality": ["CatalogState", "CharacterizationQuality", "ORBIT_COLUMNS", "catalog_state",
        "characterization_quality", "orbit_table", "true_tracklets"],
    "results": ["BlockRecord", "CatalogRecord", "SurveyResult"],
    "search_worth": ["search_tables"],
    "settings": ["CharacterizationSettings", "DensityPrior", "LineageSettings", "QualitySettings",
        "SOURCES", "SearchSettings", "SurveyModel"],
    "simulation": ["SurveySettings", "run_survey"],
    "true_objects": ["TrueObjects"],
})
# fmt: on
