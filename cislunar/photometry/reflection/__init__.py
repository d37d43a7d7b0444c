"""Reflection laws other than the paper's, and tables of measured ones."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "laws": ["directional_hemispherical_reflectance", "reflectance"],
    "tables": ["NO_TABLE", "ReflectanceTable", "load_reflectance_table"],
})
# fmt: on
