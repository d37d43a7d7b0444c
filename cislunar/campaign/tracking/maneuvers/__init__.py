"""Maneuvers of cells: true and estimated ones for export, and the table of a study."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "export": ["cell_maneuvers"],
})
# fmt: on
