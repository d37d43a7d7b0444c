"""Random numbers of jobs."""

from typing import Any

import numpy as np


def generator(seed: int, *names: Any) -> np.random.Generator:
    """Random numbers of one job, independent of every other job's.

    `names` tell the job from the others (scenario, method, run).
    """
    words = [byte for name in names for byte in (*str(name).encode(), 0)]
    return np.random.default_rng(np.random.SeedSequence([seed, *words]))
