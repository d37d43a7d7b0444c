"""Tables from which J of any architecture is evaluated with a few rows: visibility depends only on
(orbit, phase, time, target), and n satellites on an orbit are at the phases j T / n.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ArchitectureTables:
    """Data of every (orbit, satellite count) pair for the cost J.

    Attributes
    ----------
    observations : ndarray of unsigned integers, shape (orbit, satellites, target)
        Number of times each target is observable, summed over the ``n`` satellites of the orbit;
        column ``k`` holds ``n = k + 1``.
    distance : ndarray, shape (orbit, satellites)
        Distance to the Earth plus distance to the Moon, summed over time and satellites,
        nondimensional.
    stability_index : ndarray, shape (orbit,)
        Stability index of each orbit, 1 = linearly stable.
    family : ndarray of str, shape (orbit,)
        Family of each orbit; members of a family are consecutive and ordered along it.
    n_steps : int
        Number of evaluation times.
    """

    observations: NDArray[np.unsignedinteger]
    distance: NDArray[np.float64]
    stability_index: NDArray[np.float64]
    family: NDArray[np.str_]
    n_steps: int

    @property
    def n_orbits(self) -> int:
        """Number of candidate orbits."""
        return self.observations.shape[0]

    @property
    def max_satellites(self) -> int:
        """Largest number of satellites on one orbit."""
        return self.observations.shape[1]

    @property
    def n_targets(self) -> int:
        """Number of static targets."""
        return self.observations.shape[2]
