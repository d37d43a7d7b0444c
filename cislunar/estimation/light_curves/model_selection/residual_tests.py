"""Whether the residuals of a light curve are those of its noise.

Three tests, each at the level of `LEVEL`, tell whether a model explains a light curve, not whether
another one would explain it better:

- Size. The sum of squares of n residuals in standard deviations is chi squared with n - p degrees
  of freedom for p estimated parameters. If the noise variance is known as from nu measurements
  only, that sum over n - p has the F distribution with n - p and nu degrees of freedom.
- Groups. One-way analysis of variance between runs of rows of one observer within 15 minutes
  (Fisher 1925). The mean square between g runs over that within them has the F distribution with g
  and n - g degrees of freedom. A model error that is correlated over a run makes it large.
- Lag. The correlation of successive residuals of a run, over m pairs, is normal with variance
  1 / m.

The last two do not depend on the size of the noise. Fitted parameters take up a part of the noise
and its correlation, so that a correct model is rejected at most as often as stated.
"""

import numpy as np
from scipy.stats import chi2, f, norm

from cislunar.estimation.light_curves.model_selection.correlated import bins_of_rows
from cislunar.estimation.light_curves.row_blocks import WEIGHT
from cislunar.runtime import Array

LEVEL = 1e-3
"""Probability with which each test rejects a correct model."""


def p_values(residual: Array, data: Array, variance: float, freedom: float, fitted: int) -> Array:
    """Probabilities (3,) of residuals that are at least as large or as correlated: of size, groups
    and lag; 1 where there are too few rows for a test. `variance` is that of a row of weight 1,
    mag^2, known as from `freedom` measurements (0 if exactly), and `fitted` the number of estimated
    parameters."""
    n = len(residual)
    standard = residual * np.sqrt(data[:, WEIGHT] / variance)
    found, left = np.ones(3), max(n - fitted, 1)
    total = float(standard @ standard)
    found[0] = f.sf(total / left, left, freedom) if freedom > 0.0 else chi2.sf(total, left)
    runs = bins_of_rows(data, 1)  # without a limit to the rows of a bin
    count, standard = runs.first.size, standard[runs.order]
    size = np.diff(np.append(runs.first, n))
    sums = np.add.reduceat(standard, runs.first)
    between = float(np.sum(sums**2 / size))
    if n > count:
        found[1] = f.sf((between / count) / ((total - between) / (n - count)), count, n - count)
        following = np.ones(n - 1, dtype=bool)
        following[runs.first[1:] - 1] = False
        lagged = float(np.sum((standard[1:] * standard[:-1])[following]))
        found[2] = norm.sf(lagged / (total / n * np.sqrt(n - count)))
    return found


def explains(residual: Array, data: Array, variance: float, freedom: float, fitted: int) -> bool:
    """Whether no test of `p_values` rejects residuals at `LEVEL`."""
    return bool(np.all(p_values(residual, data, variance, freedom, fitted) >= LEVEL))
