"""The value of pointing at a target, counting all targets in the field of view."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def values_in_field(value: Array, direction: Array, half_field: Array) -> Array:
    """Value of each target plus those of its neighbors in the field of view about it.

    A target counts in every field that contains it, also if several observers measure it. The field
    is the circle within the square field of view.

    Parameters
    ----------
    value : ndarray, shape (observer, target)
        Value of an observation of the target alone; not positive if it is not observable.
    direction : ndarray, shape (observer, target, 3)
        Unit vectors from observer to target; NaN for a target without an estimate.
    half_field : ndarray, shape (observer,)
        Half the field of view, rad.

    Returns
    -------
    ndarray, shape (observer, target)
        Unchanged where the target itself is not observable.
    """
    found = value.copy()
    for o, least in enumerate(np.cos(half_field)):
        seen = np.flatnonzero(value[o] > 0.0)
        toward = direction[o, seen]
        found[o, seen] = (toward @ toward.T >= least) @ value[o, seen]
    return found
