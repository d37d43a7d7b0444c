"""Quality of a catalog against the truth."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "characterized": ["CharacterizationQuality", "characterization_quality"],
    "orbits": ["CatalogState", "ORBIT_COLUMNS", "catalog_state", "orbit_table", "right_objects",
        "true_tracklets"],
})
# fmt: on
