"""Communication of measurements to the common estimate: contacts, delays, and late reception."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "contact": ["arrivals"],
    "model": ["CommunicationModel"],
    "reception": ["Reception"],
})
# fmt: on
