"""Initial state and times of a halo orbit, and the message of its states."""

import numpy as np

from cislunar.exchange.oem import oem_text

HALO = np.array([1.14, 0.0, -0.16, 0.0, -0.223, 0.0])
ELAPSED = np.arange(0.0, 86_400.0, 3_600.0)


def written(segment, **options):
    return oem_text([segment], created="2030-01-01T00:00:00", **options)
