"""Random generators of jobs."""

from typing import Any

import numpy as np


def generator(seed: int, *names: Any) -> np.random.Generator:
    """Random generator of one job, independent of those of all other jobs; `names` identify the job
    (scenario, method, run)."""
    words = [byte for name in names for byte in (*str(name).encode(), 0)]
    return np.random.default_rng(np.random.SeedSequence([seed, *words]))
