"""Effects of the readings of the paper."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "architecture": ["readings_table"],
    "photometry": ["BRIGHTER", "RANGE", "RETURNED", "photometry_table"],
})
# fmt: on
