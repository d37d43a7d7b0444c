"""Estimators of single observers, each with a catalog of its own, and the fusion of their
estimates."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "methods": ["FUSIONS"],
})
# fmt: on
