"""The command `cislunar`: orbits, visibility, and the campaign. Commands import on demand."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "main": ["cislunar"],
})
# fmt: on
