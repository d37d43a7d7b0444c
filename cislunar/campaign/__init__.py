"""A campaign: settings, data sets and tables around the library."""

import lazy_loader as _lazy

# fmt: off
__getattr__, __dir__, __all__ = _lazy.attach(__name__, submod_attrs={
    "kernels": ["kernel_set", "tracking_files", "tracking_kernels"],
    "result": ["made_result", "write_result"],
    "verify": ["check_results"],
})
# fmt: on
